#include "scene/mesh_io.hpp"
#include "scene_testing.hpp"

#include <cmath>
#include <numbers>
#include <sstream>

namespace cleave::scene {
namespace {

using std::numbers::pi;
using testing::HasSubstr;

/// Faces of a cube [low, low + edge]^3 as quads; `first_vertex` is how many come before it.
std::string cube_obj(double edge = 1, double low = 0, bool inward = false, int first_vertex = 0, int faces = 6) {
  std::ostringstream text;
  for (int i = 0; i < 8; ++i) {
    text << "v " << low + edge * (i & 1) << ' ' << low + edge * (i >> 1 & 1) << ' ' << low + edge * (i >> 2 & 1) << '\n';
  }
  constexpr int quads[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};
  for (int f = 0; f < faces; ++f) {
    text << 'f';
    for (int i = 0; i < 4; ++i) text << ' ' << first_vertex + quads[f][inward ? 3 - i : i];
    text << '\n';
  }
  return text.str();
}

/// A sphere of latitudes and longitudes; `open_cap` leaves out the top ring of triangles.
std::string sphere_obj(double radius, int rings, bool open_cap = false) {
  std::ostringstream text;
  text.precision(17);
  text << "v 0 0 " << radius << "\nv 0 0 " << -radius << '\n';
  const int segments = 2 * rings;
  for (int i = 1; i < rings; ++i) {
    for (int j = 0; j < segments; ++j) {
      const double latitude = pi * i / rings, longitude = 2 * pi * j / segments;
      text << "v " << radius * std::sin(latitude) * std::cos(longitude) << ' '
           << radius * std::sin(latitude) * std::sin(longitude) << ' ' << radius * std::cos(latitude) << '\n';
    }
  }
  const auto at = [&](int i, int j) { return 3 + (i - 1) * segments + j % segments; };
  for (int j = 0; j < segments; ++j) {
    if (!open_cap) text << "f 1 " << at(1, j) << ' ' << at(1, j + 1) << '\n';
    text << "f 2 " << at(rings - 1, j + 1) << ' ' << at(rings - 1, j) << '\n';
    for (int i = 1; i + 1 < rings; ++i) {
      text << "f " << at(i, j) << ' ' << at(i + 1, j) << ' ' << at(i + 1, j + 1) << ' ' << at(i, j + 1) << '\n';
    }
  }
  return text.str();
}

ShapeSpec mesh_spec(const std::filesystem::path& file) {
  ShapeSpec spec;
  spec.type = ShapeSpec::Type::mesh;
  spec.file = file;
  return spec;
}

double volume_by_counting(const SignedDistance& shape, int samples_across) {
  const Box box = shape.bounds();
  const double step = box.sizes().maxCoeff() / samples_across;
  std::size_t inside = 0;
  for (double z = box.min()[2] + step / 2; z < box.max()[2]; z += step) {
    for (double y = box.min()[1] + step / 2; y < box.max()[1]; y += step) {
      for (double x = box.min()[0] + step / 2; x < box.max()[0]; x += step) inside += shape.distance({x, y, z}) < 0;
    }
  }
  return static_cast<double>(inside) * step * step * step;
}

double distance_to_triangle(const Vector3& p, const Vector3& a, const Vector3& b, const Vector3& c) {
  const Vector3 normal = (b - a).cross(c - a).normalized();
  const Vector3 foot = p - (p - a).dot(normal) * normal;
  const auto on_left = [&](const Vector3& u, const Vector3& v) { return (v - u).cross(foot - u).dot(normal) >= 0; };
  if (on_left(a, b) && on_left(b, c) && on_left(c, a)) return (p - foot).norm();
  const auto to_segment = [&](const Vector3& u, const Vector3& v) {
    const double along = std::clamp((p - u).dot(v - u) / (v - u).squaredNorm(), 0.0, 1.0);
    return (p - u - along * (v - u)).norm();
  };
  return std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
}

double brute_force_distance(const TriangleMesh& mesh, const Vector3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& t : mesh.triangles) {
    const auto v = [&](std::size_t i) { return mesh.vertices[static_cast<std::size_t>(t[i])]; };
    least = std::min(least, distance_to_triangle(p, v(0), v(1), v(2)));
  }
  return least;
}

TEST(MeshShapes, MeasureTheDistanceToTheirTriangles) {
  const TemporaryDirectory directory;
  const auto file = directory.write("sphere.obj", sphere_obj(0.5, 12));
  const TriangleMesh mesh = read_mesh(file);
  const double voxel = 0.02;
  const auto shape = build_shape(mesh_spec(file), voxel);
  EXPECT_GT(shape->band(), 2 * voxel);
  RandomPoints points(0.65);
  int near = 0;
  for (int i = 0; i < 5000; ++i) {
    const Vector3 x = points.next();
    const double expected = brute_force_distance(mesh, x), distance = shape->distance(x);
    ASSERT_LE(std::abs(distance), expected + 0.1 * voxel) << x.transpose();
    if (std::abs(distance) < shape->band()) {
      ++near;
      ASSERT_NEAR(std::abs(distance), expected, 0.1 * voxel) << x.transpose();
      ASSERT_NEAR(shape->normal(x).norm(), 1, 1e-12);
      ASSERT_GT(shape->normal(x).dot(x.normalized()), 0.95);
    } else {
      ASSERT_GE(expected, shape->band() - 0.1 * voxel);
    }
  }
  EXPECT_GT(near, 500);
}

TEST(MeshShapes, AreNegativeFarInsideAndPositiveFarOutside) {
  const TemporaryDirectory directory;
  const auto shape = build_shape(mesh_spec(directory.write("sphere.obj", sphere_obj(0.5, 12))), 0.01);
  EXPECT_LT(shape->distance({0, 0, 0}), -shape->band());
  EXPECT_GT(shape->distance({0.6, 0, 0}), shape->band());
  EXPECT_NEAR(shape->distance({1000, 0, 0}), 999.5, 1e-6);
  EXPECT_GT(shape->distance({1e30, -1e30, 1e30}), 0);
}

TEST(MeshShapes, AreScaledCentredAndTransformed) {
  const TemporaryDirectory directory;
  ShapeSpec spec = mesh_spec(directory.write("cube.obj", cube_obj(4, 100)));
  spec.file_size = 2;
  spec.centered = true;
  spec.center = Vector3(1, 0, 0);
  EXPECT_TRUE(build_shape(spec, 0.05)->bounds().isApprox(Box(Vector3(0, -1, -1), Vector3(2, 1, 1)), 1e-9));
  spec.scale = Vector3(1, 2, 0.5);
  spec.translation = Vector3(0, 10, 0);
  const auto slab = build_shape(spec, 0.05);
  EXPECT_TRUE(slab->bounds().isApprox(Box(Vector3(0, 8, -0.5), Vector3(2, 12, 0.5)), 1e-9));
  // Distances stay exact although the scale is not uniform.
  EXPECT_NEAR(slab->distance({1, 12.1, 0}), 0.1, 1e-6);
  EXPECT_NEAR(slab->distance({1, 10, 0.45}), -0.05, 1e-6);
}

TEST(MeshShapes, DoNotMindWhichWayTrianglesFace) {
  const TemporaryDirectory directory;
  const auto shape = build_shape(mesh_spec(directory.write("inward.obj", cube_obj(1, 0, true))), 0.05);
  EXPECT_LT(shape->distance({0.5, 0.5, 0.5}), 0);
  EXPECT_NEAR(volume_by_counting(*shape, 50), 1, 0.01);
}

TEST(MeshShapes, KeepCavities) {
  const TemporaryDirectory directory;
  const auto hollow = directory.write("hollow.obj", cube_obj(1, 0) + cube_obj(0.5, 0.25, true, 8));
  const auto shape = build_shape(mesh_spec(hollow), 0.02);
  EXPECT_GT(shape->distance({0.5, 0.5, 0.5}), 0);
  EXPECT_LT(shape->distance({0.1, 0.5, 0.5}), 0);
  EXPECT_NEAR(volume_by_counting(*shape, 60), 1 - 0.125, 0.01);
}

TEST(MeshShapes, JoinSeamsOfVerticesAtTheSamePlace) {
  const TemporaryDirectory directory;
  std::string text;  // six quads that share no vertex
  int vertices = 0;
  const TriangleMesh cube = read_mesh(directory.write("cube.obj", cube_obj()));
  for (const auto& t : cube.triangles) {
    for (const int corner : t) {
      const Vector3& v = cube.vertices[static_cast<std::size_t>(corner)];
      text += "v " + std::to_string(v[0]) + " " + std::to_string(v[1]) + " " + std::to_string(v[2]) + "\n";
    }
    text +=
        "f " + std::to_string(vertices + 1) + " " + std::to_string(vertices + 2) + " " + std::to_string(vertices + 3) + "\n";
    vertices += 3;
  }
  EXPECT_NEAR(volume_by_counting(*build_shape(mesh_spec(directory.write("soup.obj", text)), 0.05), 50), 1, 0.01);
}

TEST(MeshShapes, CloseSmallHoles) {
  const TemporaryDirectory directory;
  const auto shape = build_shape(mesh_spec(directory.write("punctured.obj", sphere_obj(0.5, 16, true))), 0.02);
  EXPECT_LT(shape->distance({0, 0, 0}), 0);
  EXPECT_NEAR(volume_by_counting(*shape, 60), 4.0 / 3 * pi * 0.125, 0.02);
}

TEST(MeshShapes, ThatEncloseNothingAreRefused) {
  const TemporaryDirectory directory;
  const auto error_of = [&](const std::string& name, const std::string& text, double voxel) {
    return input_error([&] { build_shape(mesh_spec(directory.write(name, text)), voxel); });
  };
  EXPECT_THAT(error_of("open.obj", cube_obj(1, 0, false, 0, 5), 0.05),
              HasSubstr("open.obj: not closed: 4 open edges around 1 hole"));
  EXPECT_THAT(error_of("sheet.obj", cube_obj(1, 0, false, 0, 1), 0.05), HasSubstr("sheet.obj: not closed: 4 open edges"));
  EXPECT_THAT(error_of("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n", 0.05), HasSubstr("encloses no volume"));
  EXPECT_THAT(error_of("point.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", 0.05),
              HasSubstr("every face of the mesh is degenerate"));
  EXPECT_THAT(error_of("coarse.obj", cube_obj(0.01, 0.02), 1.0), HasSubstr("encloses no volume that voxels of 1 m resolve"));
  EXPECT_THAT(error_of("fine.obj", cube_obj(), 1e-6), HasSubstr("million voxels"));
  EXPECT_THAT(error_of("cube.obj", cube_obj(), 0), HasSubstr("voxel size must be positive"));
}

struct SharedMesh {
  const char *name, *file;
  double size;    ///< m, longest edge after scaling
  double volume;  ///< of the mesh (its holes closed) in units of size^3, by the divergence theorem
  friend std::ostream& operator<<(std::ostream& out, const SharedMesh& mesh) { return out << mesh.name; }
};

class SharedMeshes : public testing::TestWithParam<SharedMesh> {};

TEST_P(SharedMeshes, BecomeSolidsOfTheRightVolume) {
  const std::filesystem::path file = shared_mesh(GetParam().file);
  if (file.empty()) GTEST_SKIP() << GetParam().file << " is not in the data directory (set CLEAVE_DATA_DIR)";
  ShapeSpec spec = mesh_spec(file);
  spec.file_size = GetParam().size;
  spec.centered = true;
  const auto shape = build_shape(spec, GetParam().size / 128);
  EXPECT_NEAR(shape->bounds().sizes().maxCoeff(), GetParam().size, 1e-9);
  EXPECT_NEAR(volume_by_counting(*shape, 100) / std::pow(GetParam().size, 3), GetParam().volume, 0.01 * GetParam().volume);
}

INSTANTIATE_TEST_SUITE_P(All, SharedMeshes,
                         testing::Values(SharedMesh{"Bunny", "stanford-bunny.obj", 0.3, 0.20008},
                                         SharedMesh{"Armadillo", "armadillo.obj", 2, 0.068686},
                                         SharedMesh{"Spot", "spot.obj", 1, 0.14167}),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace cleave::scene
