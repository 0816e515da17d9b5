#include "scene/lattice_tetrahedra.hpp"
#include "scene/primitives.hpp"
#include "scene/tetgen_tetrahedra.hpp"
#include "scene/tetrahedra.hpp"
#include "scene_testing.hpp"

#include <map>
#include <set>

namespace cleave::scene {
namespace {

using testing::HasSubstr;

constexpr double degrees = 180 / EIGEN_PI;

ShapeSpec box(const Vector3& size) {
  ShapeSpec spec;
  spec.size = size;
  return spec;
}

ShapeSpec sphere(double radius) {
  ShapeSpec spec;
  spec.type = ShapeSpec::Type::sphere;
  spec.radius = radius;
  return spec;
}

ShapeSpec torus(double radius, double tube_radius) {
  ShapeSpec spec = sphere(radius);
  spec.type = ShapeSpec::Type::torus;
  spec.tube_radius = tube_radius;
  spec.axis = Vector3(1, 2, 3);
  return spec;
}

ShapeSpec combined(ShapeSpec::Type type, std::vector<ShapeSpec> children) {
  ShapeSpec spec;
  spec.type = type;
  spec.children = std::move(children);
  return spec;
}

TetrahedralMesh cut(const ShapeSpec& shape, double edge_length,
                    TetrahedraSpec::Method method = TetrahedraSpec::Method::lattice) {
  TetrahedraSpec spec;
  spec.edge_length = edge_length;
  spec.method = method;
  return build_tetrahedra(spec, &shape);
}

/// Volume that the surface encloses, by the divergence theorem; its area; and its Euler characteristic. Fails unless it is
/// closed and orientable without branches: each edge once in each direction.
struct Surface {
  double volume = 0, area = 0;
  long euler = 0;
};

Surface surface(const TetrahedralMesh& mesh) {
  Surface s;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  std::set<std::uint32_t> vertices;
  const auto triangles = surface_of(mesh);
  for (const auto& t : triangles) {
    const Vector3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    s.volume += a.dot(b.cross(c)) / 6;
    s.area += (b - a).cross(c - a).norm() / 2;
    for (std::size_t i = 0; i < 3; i++) edges[{t[i], t[(i + 1) % 3]}]++;
    vertices.insert(t.begin(), t.end());
  }
  int branches = 0;
  for (const auto& [edge, count] : edges) {
    const auto back = edges.find({edge.second, edge.first});
    branches += count != 1 || back == edges.end();
  }
  EXPECT_EQ(branches, 0);
  s.euler = long(vertices.size()) - long(edges.size() / 2) + long(triangles.size());
  return s;
}

void expect_positive_volumes(const TetrahedralMesh& mesh) {
  for (const double volume : volumes(mesh)) ASSERT_GT(volume, 0);
}

TEST(LatticeTetrahedra, FillABoxExactly) {
  const Vector3 size(1, 0.5, 0.26);
  ShapeSpec shape = box(size);
  shape.center = Vector3(3, -2, 1);
  const TetrahedralMesh mesh = cut(shape, 0.1);
  const Surface s = surface(mesh);
  EXPECT_NEAR(measure(mesh).volume, size.prod(), 1e-12);
  EXPECT_NEAR(s.volume, size.prod(), 1e-12);
  EXPECT_NEAR(s.area, 2 * (0.5 + 0.26 + 0.13), 1e-12);
  EXPECT_EQ(s.euler, 2);
  Box bounds;
  for (const Vector3& x : mesh.vertices) bounds.extend(x);
  EXPECT_EQ(bounds.min(), shape.center - size / 2);
  EXPECT_EQ(bounds.max(), shape.center + size / 2);
  expect_positive_volumes(mesh);
}

TEST(LatticeTetrahedra, TurnWithTheShape) {
  ShapeSpec shape = box(Vector3(1, 0.5, 0.25));
  shape.scale = Vector3(1, 2, 1);
  shape.rotation = Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()).toRotationMatrix();
  shape.translation = Vector3(4, 5, 6);
  const TetrahedralMesh mesh = cut(shape, 0.1);
  EXPECT_NEAR(measure(mesh).volume, 0.25, 1e-12);
  EXPECT_NEAR(surface(mesh).area, 2 * (1 + 0.25 + 0.25), 1e-12);
  for (const Vector3& x : mesh.vertices) EXPECT_LE(build_shape(shape, 1)->distance(x), 1e-12);
}

// Inside, edges are those of a body-centred lattice: the cube's and half of its diagonals, twelve tetrahedra to a cube.
TEST(LatticeTetrahedra, AreOfTheSizeAskedFor) {
  const TetrahedralMesh mesh = cut(box(Vector3::Ones()), 0.1);
  const MeshMeasures m = measure(mesh);
  EXPECT_NEAR(m.longest_edge, 0.1, 1e-12);
  EXPECT_NEAR(m.least_dihedral_angle * degrees, 45, 1e-9);
  EXPECT_NEAR(m.greatest_dihedral_angle * degrees, 90, 1e-9);
  const auto all = volumes(mesh);
  const auto whole = std::count_if(all.begin(), all.end(), [](double v) { return std::abs(v - 1e-3 / 12) < 1e-12; });
  EXPECT_EQ(whole, 3 * 4 * 10 * 10 * 9);
}

TEST(LatticeTetrahedra, FillAPlateWithOneLayer) {
  const TetrahedralMesh mesh = cut(box(Vector3(1, 1, 0.01)), 0.05);
  EXPECT_NEAR(measure(mesh).volume, 0.01, 1e-12);
  EXPECT_EQ(surface(mesh).euler, 2);
  expect_positive_volumes(mesh);
}

struct Curved {
  const char* name;
  ShapeSpec shape;
  double volume;
  long euler;
};

TEST(LatticeTetrahedra, ConvergeToCurvedBodiesOfTheirTopology) {
  ShapeSpec capsule = sphere(0.4);
  capsule.type = ShapeSpec::Type::capsule;
  capsule.height = 1;
  capsule.axis = Vector3(2, -1, 1);
  const double pi = EIGEN_PI;
  for (const Curved& body :
       {Curved{"sphere", sphere(1), 4 * pi / 3, 2}, Curved{"torus", torus(1, 0.4), 2 * pi * pi * 0.16, 0},
        Curved{"capsule", capsule, pi * 0.16 * (1 + 4 * 0.4 / 3), 2},
        Curved{"shell", combined(ShapeSpec::Type::difference, {sphere(1), sphere(0.5)}), 4 * pi / 3 * (1 - 0.125), 4}}) {
    SCOPED_TRACE(body.name);
    const TetrahedralMesh coarse = cut(body.shape, 0.2), fine = cut(body.shape, 0.1);
    for (const TetrahedralMesh* mesh : {&coarse, &fine}) {
      EXPECT_EQ(surface(*mesh).euler, body.euler);
      EXPECT_EQ(measure(*mesh).pieces, 1u);
      EXPECT_NEAR(surface(*mesh).volume, measure(*mesh).volume, 1e-10);
    }
    const double error = std::abs(measure(fine).volume / body.volume - 1);
    EXPECT_LT(error, 0.012);
    EXPECT_LT(error, 0.45 * std::abs(measure(coarse).volume / body.volume - 1));  // a quarter, to second order
    for (const auto& t : surface_of(fine))
      for (const auto v : t) EXPECT_NEAR(build_shape(body.shape, 1)->distance(fine.vertices[v]), 0, 1e-8);
  }
}

// The bounds of Labelle and Shewchuk (2007), theorem 1: 10.7 and 164.8 degrees in a lattice of cubes.
TEST(LatticeTetrahedra, HaveBoundedDihedralAngles) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int trial = 0; trial < 30; trial++) {
    ShapeSpec shape = trial % 2 ? torus(1, 0.4) : sphere(1);
    shape.axis = Vector3(uniform(generator), uniform(generator), 0.1 + uniform(generator));
    // whole numbers of equal cubes on all sides
    const double edge = 0.13 + 0.2 * uniform(generator);
    const auto body = make_primitive(shape);
    const TetrahedralMesh mesh = lattice_tetrahedra(*body, edge);
    const MeshMeasures m = measure(mesh);
    EXPECT_GT(m.least_dihedral_angle * degrees, 10.7);
    EXPECT_LT(m.greatest_dihedral_angle * degrees, 164.8);
    expect_positive_volumes(mesh);
  }
}

TEST(LatticeTetrahedra, SayWhyAShapeCannotBeCut) {
  ShapeSpec half_space;
  half_space.type = ShapeSpec::Type::half_space;
  EXPECT_THAT(input_error([&] { cut(half_space, 0.1); }), HasSubstr("unbounded and cannot be cut into tetrahedra"));
  EXPECT_THAT(input_error([&] { cut(sphere(1), 1e-4); }), HasSubstr("edges of 0.0001 m are too short for a shape 2 x 2 x 2 m"));
  ShapeSpec away = sphere(1);
  away.center = Vector3(3, 0, 0);
  EXPECT_THAT(input_error([&] {
                cut(combined(ShapeSpec::Type::intersection, {sphere(1), away}), 0.1);
              }),
              HasSubstr("is empty"));
  away.center = Vector3(1.99, 1.9, 0);
  const ShapeSpec nothing = combined(ShapeSpec::Type::intersection, {sphere(1), away});
  EXPECT_THAT(input_error([&] { cut(nothing, 0.1); }), HasSubstr("no tetrahedron lies inside the shape"));
}

TEST(TetrahedralMeshes, PartsThatTouchInPointsOrEdgesAreSeparated) {
  // three tetrahedra: the first two share an edge, the third touches them in a vertex
  TetrahedralMesh mesh{{Vector3(0, 0, 0), Vector3(0, 0, 1), Vector3(1, 0, 0), Vector3(0, 1, 0), Vector3(-1, 0, 0),
                        Vector3(0, -1, 0), Vector3(1, 0, -1), Vector3(0, 1, -1), Vector3(-1, -1, -1)},
                       {{0, 2, 3, 1}, {0, 4, 5, 1}, {0, 6, 8, 7}}};
  EXPECT_EQ(separate_touching_parts(mesh), 3u);
  EXPECT_EQ(mesh.vertices.size(), 12u);
  EXPECT_EQ(measure(mesh).pieces, 3u);
  EXPECT_EQ(surface(mesh).euler, 6);
  EXPECT_EQ(mesh.tetrahedra[0], (std::array<std::uint32_t, 4>{0, 2, 3, 1}));
  EXPECT_EQ(separate_touching_parts(mesh), 0u);
}

TEST(TetrahedralMeshes, AreMeasured) {
  const double a = 2, height = a * std::sqrt(2.0 / 3);
  const TetrahedralMesh regular{
      {Vector3(0, 0, 0), Vector3(a, 0, 0), Vector3(a / 2, a * std::sqrt(3) / 2, 0), Vector3(a / 2, a / std::sqrt(12), height)},
      {{0, 1, 2, 3}}};
  const MeshMeasures m = measure(regular);
  EXPECT_NEAR(m.volume, a * a * a / (6 * std::sqrt(2)), 1e-14);
  EXPECT_NEAR(m.shortest_edge, a, 1e-14);
  EXPECT_NEAR(m.mean_edge, a, 1e-14);
  EXPECT_NEAR(m.longest_edge, a, 1e-14);
  EXPECT_NEAR(m.least_dihedral_angle, std::acos(1.0 / 3), 1e-14);
  EXPECT_NEAR(m.greatest_dihedral_angle, std::acos(1.0 / 3), 1e-14);
  EXPECT_EQ(surface_of(regular).size(), 4u);
  EXPECT_NEAR(surface(regular).volume, m.volume, 1e-14);
}

TEST(TetrahedralMeshes, OfFilesArePlacedAsShapesAre) {
  const TemporaryDirectory directory;
  TetrahedraSpec spec;
  ShapeSpec& file = spec.file.emplace();
  file.type = ShapeSpec::Type::mesh;
  file.file = directory.write("a.mesh",
                              "MeshVersionFormatted 1\nDimension 3\nVertices 4\n0 0 0 0\n2 0 0 0\n0 1 0 0\n0 0 1 0\n"
                              "Tetrahedra 1\n1 2 3 4 0\n");
  file.file_size = 4;
  file.centered = true;
  file.center = Vector3(1, 0, 0);
  file.scale = Vector3(1, 1, 3);
  file.rotation = Eigen::AngleAxisd(EIGEN_PI / 2, Vector3::UnitZ()).toRotationMatrix();
  file.translation = Vector3(0, 0, 7);
  const TetrahedralMesh mesh = build_tetrahedra(spec, nullptr);
  EXPECT_NEAR(measure(mesh).volume, 8 * 3 * 2.0 / 6, 1e-12);
  EXPECT_NEAR((mesh.vertices[0] - Vector3(1, -1, 4)).norm(), 0, 1e-12);
  EXPECT_NEAR((mesh.vertices[1] - Vector3(1, 3, 4)).norm(), 0, 1e-12);
}

/// A cube with a cubic cavity, as triangles.
std::string hollow_cube() {
  std::string text;
  const int faces[12][3] = {{1, 3, 2}, {2, 3, 4}, {5, 6, 7}, {6, 8, 7}, {1, 2, 5}, {2, 6, 5},
                            {3, 7, 4}, {4, 7, 8}, {1, 5, 3}, {3, 5, 7}, {2, 4, 6}, {4, 8, 6}};
  for (const double half : {1.0, 0.5})
    for (int corner = 0; corner < 8; corner++)
      text += "v " + std::to_string(corner & 1 ? half : -half) + " " + std::to_string(corner & 2 ? half : -half) + " " +
              std::to_string(corner & 4 ? half : -half) + "\n";
  for (const auto& f : faces) {
    text += "f " + std::to_string(f[0]) + " " + std::to_string(f[1]) + " " + std::to_string(f[2]) + "\n";
    text += "f " + std::to_string(f[0] + 8) + " " + std::to_string(f[2] + 8) + " " + std::to_string(f[1] + 8) + "\n";
  }
  return text;
}

constexpr auto tetgen = TetrahedraSpec::Method::tetgen;

TEST(TetGen, KeepsSurfacesAndCavities) {
  if (!tetgen_available()) GTEST_SKIP() << "the program around TetGen is not built";
  const TemporaryDirectory directory;
  ShapeSpec shape;
  shape.type = ShapeSpec::Type::mesh;
  shape.file = directory.write("hollow.obj", hollow_cube());
  const TetrahedralMesh mesh = cut(shape, 0.3, tetgen);
  EXPECT_NEAR(measure(mesh).volume, 8 - 1, 1e-9);
  EXPECT_NEAR(surface(mesh).area, 24 + 6, 1e-9);
  EXPECT_EQ(surface(mesh).euler, 4);
  EXPECT_GT(measure(mesh).least_dihedral_angle * degrees, 5);
  for (const double volume : volumes(mesh)) EXPECT_LE(volume, 0.3 * 0.3 * 0.3 / (6 * std::sqrt(2)) * (1 + 1e-9));
  expect_positive_volumes(mesh);
}

TEST(TetGen, FillsShapesThatAreNoMeshes) {
  if (!tetgen_available()) GTEST_SKIP() << "the program around TetGen is not built";
  EXPECT_NEAR(measure(cut(box(Vector3(1, 2, 3)), 0.5, tetgen)).volume, 6, 1e-9);
  const TetrahedralMesh ring = cut(torus(1, 0.4), 0.25, tetgen);
  EXPECT_EQ(surface(ring).euler, 0);
  EXPECT_NEAR(measure(ring).volume, 2 * EIGEN_PI * EIGEN_PI * 0.16, 0.2);
}

TEST(TetGen, SaysWhatItCannotMesh) {
  const TemporaryDirectory directory;
  if (!tetgen_available()) {
    EXPECT_THAT(input_error([&] { cut(sphere(1), 0.5, tetgen); }),
                HasSubstr("lib/cleave/meshers/tetgen, which is built where TetGen's library is installed (Debian: "
                          "libtet1.5-dev); use method = \"lattice\""));
    return;
  }
  ShapeSpec crossing;
  crossing.type = ShapeSpec::Type::mesh;
  std::string text;
  for (const double shift : {0.0, 0.3}) {
    const auto vertex = [&](double x, double y, double z) {
      text += "v " + std::to_string(x + shift) + " " + std::to_string(y + shift) + " " + std::to_string(z + shift) + "\n";
    };
    vertex(0, 0, 0), vertex(2, 0, 0), vertex(0, 2, 0), vertex(0, 0, 2);
  }
  for (const int first : {1, 5})
    for (const auto& face : tetrahedron_faces)
      text += "f " + std::to_string(first + face[0]) + " " + std::to_string(first + face[1]) + " " +
              std::to_string(first + face[2]) + "\n";
  crossing.file = directory.write("crossing.obj", text);
  EXPECT_THAT(input_error([&] { cut(crossing, 0.5, tetgen); }),
              HasSubstr("crossing.obj: the surface intersects itself; mend it, or use method = \"lattice\""));
}

}  // namespace
}  // namespace cleave::scene
