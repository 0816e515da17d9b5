#include "scene/mesh_io.hpp"
#include "scene_testing.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <random>

namespace cleave::scene {
namespace {

using testing::HasSubstr;

const std::string tetrahedron_obj =
    "# a tetrahedron\nmtllib none.mtl\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv +0 1e0 0\nv 0 0 1\nvt 0 0\nvn 0 0 1\ng part\n"
    "f 1 3 2\nf 1/1 2/1 4/1\nf 1//1 4//1 3//1\nf -3/1/1 -2/-1/-1 -1/1/1 # last\n";

double enclosed_volume(const TriangleMesh& mesh) {
  double volume = 0;
  for (const auto& t : mesh.triangles) {
    const auto v = [&](std::size_t i) { return mesh.vertices[static_cast<std::size_t>(t[i])]; };
    volume += v(0).dot(v(1).cross(v(2))) / 6;
  }
  return volume;
}

/// Appends the bytes of numbers in the order asked for.
class Bytes {
 public:
  explicit Bytes(std::endian order = std::endian::little) : order_(order) {}
  template <class T>
  Bytes& put(T value) {
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), &value, sizeof(T));
    if (order_ != std::endian::native) std::reverse(raw.begin(), raw.end());
    text.append(raw.data(), raw.size());
    return *this;
  }
  std::string text;

 private:
  std::endian order_;
};

const std::array<Vector3, 4> tetrahedron_vertices = {Vector3(0, 0, 0), Vector3(1, 0, 0), Vector3(0, 1, 0), Vector3(0, 0, 1)};
const std::array<std::array<int, 3>, 4> tetrahedron_faces = {{{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};

std::string binary_ply(std::endian order) {
  Bytes bytes(order);
  bytes.text =
      std::string("ply\r\nformat binary_") + (order == std::endian::big ? "big" : "little") +
      "_endian 1.0\r\ncomment odd types\r\nelement vertex 4\r\nproperty uchar red\r\nproperty double x\r\n"
      "property float32 y\r\nproperty short z\r\nproperty list uchar float extra\r\nelement material 2\r\n"
      "property uint16 id\r\nelement face 4\r\nproperty int8 flag\r\nproperty list ushort uint vertex_index\r\nend_header\r\n";
  for (const Vector3& v : tetrahedron_vertices) {
    bytes.put<std::uint8_t>(255).put<double>(v[0]).put<float>(static_cast<float>(v[1]));
    bytes.put<std::int16_t>(static_cast<std::int16_t>(v[2])).put<std::uint8_t>(2).put<float>(1).put<float>(2);
  }
  bytes.put<std::uint16_t>(1).put<std::uint16_t>(2);
  for (const auto& face : tetrahedron_faces) {
    bytes.put<std::int8_t>(-1).put<std::uint16_t>(3);
    for (const int corner : face) bytes.put<std::uint32_t>(static_cast<std::uint32_t>(corner));
  }
  return bytes.text;
}

const std::string ascii_ply =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
    "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 nan\n1 0 0 nan\n0 1 0 nan\n0 0 1 nan\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

std::string binary_stl(const std::string& header = "exported") {
  Bytes bytes;
  bytes.text = header;
  bytes.text.resize(80, '\0');
  bytes.put<std::uint32_t>(4);
  for (const auto& face : tetrahedron_faces) {
    for (int i = 0; i < 3; ++i) bytes.put<float>(0);
    for (const int corner : face) {
      for (const double component : tetrahedron_vertices[static_cast<std::size_t>(corner)])
        bytes.put(static_cast<float>(component));
    }
    bytes.put<std::uint16_t>(0);
  }
  return bytes.text;
}

std::string ascii_stl() {
  std::string text = "solid a tetrahedron\n";
  for (const auto& face : tetrahedron_faces) {
    text += "  facet normal nan nan nan\n    OUTER LOOP\n";
    for (const int corner : face) {
      const Vector3& v = tetrahedron_vertices[static_cast<std::size_t>(corner)];
      text += "      vertex " + std::to_string(v[0]) + " " + std::to_string(v[1]) + " " + std::to_string(v[2]) + "\n";
    }
    text += "    endloop\n  endfacet\n";
  }
  return text + "endsolid a tetrahedron\n";
}

struct MeshFile {
  std::string name, bytes;
};

std::vector<MeshFile> tetrahedra() {
  std::string dos = tetrahedron_obj;
  for (std::size_t at = 0; (at = dos.find('\n', at)) != std::string::npos; at += 2) dos.replace(at, 1, "\r\n");
  return {{"plain.obj", tetrahedron_obj},
          {"dos.OBJ", dos},
          {"continued.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 \\\n 3 \\\r\n 4"},
          {"faces_first.obj", "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"},
          {"ascii.ply", ascii_ply},
          {"little.ply", binary_ply(std::endian::little)},
          {"big.ply", binary_ply(std::endian::big)},
          {"ascii.stl", ascii_stl()},
          {"binary.stl", binary_stl()},
          {"says_solid.stl", binary_stl("solid but binary")},
          {"trailing.stl", binary_stl() + "more"}};
}

TEST(MeshFiles, OfEveryFormatGiveTheSameTetrahedron) {
  const TemporaryDirectory directory;
  for (const MeshFile& file : tetrahedra()) {
    SCOPED_TRACE(file.name);
    const TriangleMesh mesh = read_mesh(directory.write(file.name, file.bytes));
    EXPECT_EQ(mesh.vertices.size(), 4u);
    EXPECT_EQ(mesh.triangles.size(), 4u);
    EXPECT_NEAR(enclosed_volume(mesh), 1.0 / 6, 1e-6);
  }
}

TEST(MeshFiles, KeepTheAreaOfConcavePolygons) {
  const TemporaryDirectory directory;
  // An arrowhead and a comb: fans from the first corner would leave them.
  const std::string arrow = "v 0 0 0\nv 2 1 0\nv 0 2 0\nv 0.5 1 0\nf 1 2 3 4\nf 4 1 2 3\nf 3 4 1 2\n";
  const std::string comb =
      "v 0 0 1\nv 5 0 1\nv 5 3 1\nv 4 3 1\nv 4 1 1\nv 3 1 1\nv 3 3 1\nv 2 3 1\nv 2 1 1\nv 1 1 1\nv 1 3 1\nv 0 3 1\n"
      "f 12 11 10 9 8 7 6 5 4 3 2 1\n";
  const auto absolute_area = [](const TriangleMesh& mesh) {
    double area = 0;
    for (const auto& t : mesh.triangles) {
      const auto v = [&](std::size_t i) { return mesh.vertices[static_cast<std::size_t>(t[i])]; };
      area += (v(1) - v(0)).cross(v(2) - v(0)).norm() / 2;
    }
    return area;
  };
  EXPECT_NEAR(absolute_area(read_mesh(directory.write("arrow.obj", arrow))), 3 * 1.5, 1e-12);
  const TriangleMesh combed = read_mesh(directory.write("comb.obj", comb));
  EXPECT_EQ(combed.triangles.size(), 10u);
  EXPECT_NEAR(absolute_area(combed), 5 + 6, 1e-12);
}

struct BadMesh {
  std::string name, bytes, message;
};

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

std::vector<BadMesh> bad_meshes() {
  const std::string three = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  Bytes nan_stl;
  nan_stl.text = binary_stl();
  nan_stl.text.replace(84 + 12, 4, Bytes().put(std::numeric_limits<float>::quiet_NaN()).text);
  const std::string little = binary_ply(std::endian::little);
  return {
      {"empty.obj", "", "empty.obj: the mesh has no faces"},
      {"points.obj", three, "points.obj: the mesh has no faces"},
      {"letters.obj", "v 0 0 zero\n", "letters.obj:1: expected a vertex coordinate, found 'zero'"},
      {"short.obj", "\nv 0 0\n", "short.obj:2: expected a vertex coordinate, found the end of the line"},
      {"infinite.obj", "v 0 0 1e999\n", "infinite.obj:1: a vertex coordinate is not finite: '1e999'"},
      {"nan.obj", "v 0 nan 1\n", "nan.obj:1: a vertex coordinate is not finite"},
      {"two.obj", three + "f 1 2\n", "two.obj:4: a face needs at least three corners"},
      {"beyond.obj", three + "f 1 2 4\nf 1 2 3\n", "beyond.obj:4: the face uses vertex 4, but the file has only 3"},
      {"zero.obj", three + "f 0 1 2\n", "zero.obj:4: vertex indices count from 1"},
      {"back.obj", three + "f -1 -2 -4\n", "back.obj:4: the face counts back beyond the first vertex: -4"},
      {"huge.obj", three + "f 1 2 4000000000\n", "huge.obj:4: vertex index too large"},
      {"overflow.obj", three + "f 1 2 99999999999999999999999\n", "overflow.obj:4: expected a face corner"},
      {"corner.obj", three + "f 1 2 x\n", "corner.obj:4: expected a face corner like 1, 1/2, 1//3 or 1/2/3, found 'x'"},
      {"slashes.obj", three + "f 1/1/1/1 2 3\n", "slashes.obj:4: expected a face corner"},
      {"fraction.obj", three + "f 1.5 2 3\n", "fraction.obj:4: expected a face corner"},

      {"empty.ply", "", "empty.ply:1: a PLY file must start with 'ply'"},
      {"magic.ply", "plyx\n", "magic.ply:1: a PLY file must start with 'ply'"},
      {"format.ply", replaced(ascii_ply, "ascii", "utf8"), "format.ply:2: unknown format 'utf8'"},
      {"no_format.ply", replaced(ascii_ply, "format ascii 1.0\n", ""), "no_format.ply:9: the header has no 'format' line"},
      {"endless.ply", replaced(ascii_ply, "end_header", "comment"), "endless.ply:11: unknown header line '0'"},
      {"type.ply", replaced(ascii_ply, "float x", "quad x"), "type.ply:4: unknown property type 'quad'"},
      {"coordinates.ply", replaced(ascii_ply, "float z", "float w"), "must have the properties x, y and z"},
      {"count.ply", replaced(ascii_ply, "vertex 4", "vertex -4"), "count.ply:3: the number of elements must be a whole number"},
      {"many.ply", replaced(ascii_ply, "vertex 4", "vertex 2000000000"),
       "many.ply:19: expected a value, found the end of the file"},
      {"no_vertices.ply", replaced(ascii_ply, "element vertex", "element point"), "must declare one element 'vertex'"},
      {"no_list.ply", replaced(ascii_ply, "vertex_indices", "neighbours"),
       "the faces must have one list property vertex_indices"},
      {"index.ply", replaced(ascii_ply, "3 1 2 3", "3 1 2 4"),
       "index.ply:18: a face uses a vertex that does not exist; the file has 4"},
      {"negative.ply", replaced(ascii_ply, "3 1 2 3", "3 1 2 -1"), "negative.ply:18: a face uses a vertex that does not exist"},
      {"fraction.ply", replaced(ascii_ply, "3 1 2 3", "3 1 2 0.5"),
       "fraction.ply:18: a face uses a vertex that does not exist"},
      {"line.ply", replaced(ascii_ply, "3 1 2 3", "2 1 2"), "line.ply:18: a face needs at least three corners"},
      {"long.ply", replaced(ascii_ply, "3 1 2 3", "4000000 1 2 3"), "long.ply:18: a list is longer than the rest of the file"},
      {"text.ply", replaced(ascii_ply, "0 1 0 nan", "0 one 0 nan"), "text.ply:13: expected a value, found 'one'"},
      {"no_faces.ply", replaced(ascii_ply, "face 4", "face 0"), "no_faces.ply: the mesh has no faces"},
      {"truncated.ply", little.substr(0, little.size() - 5), "the file ends too early"},
      {"list.ply", little.substr(0, little.size() - 14) + std::string(14, '\xff'),
       "a list is longer than the rest of the file"},

      {"empty.stl", "", "empty.stl: not an STL file"},
      {"other.stl", "hello", "other.stl: not an STL file"},
      {"nothing.stl", "solid nothing\nendsolid\n", "nothing.stl: the mesh has no faces"},
      {"word.stl", replaced(ascii_stl(), "endloop", "end loop"), "word.stl:7: expected solid, facet"},
      {"two.stl", replaced(ascii_stl(), "      vertex 0.000000 0.000000 0.000000\n", ""),
       "two.stl:6: a facet needs three vertices"},
      {"four.stl", replaced(ascii_stl(), "endloop", "vertex 0 0 0"), "four.stl:7: a facet has more than three vertices"},
      {"outside.stl", "solid\nvertex 0 0 0\n", "outside.stl:2: 'vertex' outside a loop"},
      {"cut.stl", ascii_stl().substr(0, ascii_stl().find("  endfacet")), "the file ends inside a facet"},
      {"number.stl", replaced(ascii_stl(), "vertex 0.000000", "vertex ?"),
       "number.stl:4: expected a vertex coordinate, found '?'"},
      {"truncated.stl", binary_stl().substr(0, 200), "truncated.stl: byte 200: the file ends in facet 3 of 4"},
      {"nan.stl", nan_stl.text, "nan.stl: byte 96: a vertex coordinate is not finite"},

      {"mesh.fbx", "", "mesh.fbx: not a mesh file; its name must end in .obj, .ply or .stl"},
  };
}

TEST(MeshFiles, ThatAreMalformedAreRefusedWithTheirPlace) {
  const TemporaryDirectory directory;
  for (const BadMesh& bad : bad_meshes()) {
    SCOPED_TRACE(bad.name);
    const std::filesystem::path file = directory.write(bad.name, bad.bytes);
    EXPECT_THAT(input_error([&] { read_mesh(file); }), HasSubstr(bad.message));
  }
}

TEST(MeshFiles, ThatCannotBeReadAreNamed) {
  const TemporaryDirectory directory;
  EXPECT_THAT(input_error([&] { read_mesh(directory.path() / "absent.obj"); }), HasSubstr("absent.obj: no such file"));
  std::filesystem::create_directory(directory.path() / "folder.obj");
  EXPECT_THAT(input_error([&] { read_mesh(directory.path() / "folder.obj"); }), HasSubstr("folder.obj: is a directory"));
}

// Whatever happens to a file, the readers give a mesh whose corners exist or an InputError.
TEST(MeshFiles, SurviveDamage) {
  const TemporaryDirectory directory;
  std::mt19937 random(3);
  int refused = 0;
  for (const MeshFile& whole : tetrahedra()) {
    for (int trial = 0; trial < 200; ++trial) {
      std::string bytes = whole.bytes;
      for (std::uint32_t change = random() % 4; change-- > 0;) bytes[random() % bytes.size()] = static_cast<char>(random());
      if (trial % 3 == 0) bytes.resize(random() % bytes.size());
      const std::filesystem::path file = directory.write(whole.name, bytes);
      refused += !input_error([&] {
                    const TriangleMesh mesh = read_mesh(file);
                    for (const auto& triangle : mesh.triangles) {
                      for (const int corner : triangle) ASSERT_LT(static_cast<std::size_t>(corner), mesh.vertices.size());
                    }
                  }).empty();
    }
  }
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace cleave::scene
