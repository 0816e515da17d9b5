#include "scene/tetrahedra_io.hpp"
#include "scene_testing.hpp"

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>

namespace cleave::scene {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// Big-endian bytes of numbers, as binary VTK files have them.
template <class... T>
std::string big_endian(T... values) {
  std::string bytes;
  const auto put = [&](auto value) {
    std::array<char, sizeof value> raw;
    std::memcpy(raw.data(), &value, sizeof value);
    if (std::endian::native == std::endian::little) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
  };
  (put(values), ...);
  return bytes;
}

using Files = std::vector<std::pair<std::string, std::string>>;  ///< names and bytes; the last is read

struct Format {
  std::string name;
  Files files;
};

const std::string medit =
    "MeshVersionFormatted 2\n# two tetrahedra\nDimension\n3\n\nVertices\n5\n0 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 1 1\n1 1 1 1\n"
    "Triangles\n1\n1 2 3 9\nTetrahedra 2\n1 2 3 4 0\n2 3 4 5 0 # the second\nCorners 2\n1\n2\nEnd\n";
const std::string node =
    "# made by hand\n5 3 1 1\n1 0 0 0 7.5 1\n2 1 0 0 7.5 1 # corner\n\n3 0 1 0 7.5 1\n4 0 0 1 7.5 1\n5 1 1 1 7.5 0\n";
const std::string ele = "2 4 1\n1 1 2 3 4 0.5\n2 2 3 4 5 0.5\n# end\n";
const std::string node_from_zero = "5 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n4 1 1 1\n";
const std::string ele_from_zero = "2 4 0\n0 0 1 2 3\n1 1 2 3 4\n";
const std::string vtk =
    "# vtk DataFile Version 3.0\ntwo tetrahedra\nASCII\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\nTIME 1 1 double\n0.5\n"
    "POINTS 5 float\n0 0 0  1 0 0  0 1 0\n0 0 1  1 1 1\n\nCELLS 3 14\n3 0 1 2\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 3\n5\n10\n10\n"
    "POINT_DATA 5\nSCALARS x float\n";

std::string vtk_of_version_5() {
  return "# vtk DataFile Version 5.1\nbinary\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n" +
         big_endian(0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 1., 1., 1.) +
         "\nMETADATA\nINFORMATION 0\n\nCELLS 3 8\nOFFSETS vtktypeint64\n" +
         big_endian(std::int64_t(0), std::int64_t(4), std::int64_t(8)) + "\nCONNECTIVITY vtktypeint64\n" +
         big_endian(std::int64_t(0), std::int64_t(1), std::int64_t(2), std::int64_t(3), std::int64_t(1), std::int64_t(2),
                    std::int64_t(3), std::int64_t(4)) +
         "\nCELL_TYPES 2\n" + big_endian(10, 10) + "\n";
}

std::string binary_vtk() {
  return "# vtk DataFile Version 2.0\r\nold\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n" +
         big_endian(0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 1.f, 1.f, 1.f) + "\nCELLS 2 10\n" +
         big_endian(4, 0, 1, 2, 3, 4, 1, 2, 3, 4) + "\nCELL_TYPES 2\n" + big_endian(10, 10) + "\n";
}

/// The grid of the other formats in VTK's XML; `arrays` are the attributes and contents of points, corners, offsets and types.
std::string vtu(const std::string& header, const std::array<std::string, 4>& arrays, const std::string& appended = "") {
  return "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" " + header +
         ">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"5\" NumberOfCells=\"2\">\n<PointData/>\n<Points>\n"
         "<DataArray type=\"Float32\" NumberOfComponents=\"3\" " +
         arrays[0] + "</DataArray>\n</Points>\n<Cells>\n<DataArray type=\"Int32\" Name=\"connectivity\" " + arrays[1] +
         "</DataArray>\n<DataArray type=\"Int64\" Name=\"offsets\" " + arrays[2] +
         "</DataArray>\n<DataArray type=\"UInt8\" Name=\"types\" " + arrays[3] +
         "</DataArray>\n</Cells>\n</Piece>\n</UnstructuredGrid>\n" + appended + "</VTKFile>\n";
}
std::string text_vtu() {
  return vtu("version=\"0.1\"", {">0 0 0 1 0 0 0 1 0 0 0 1 1 1 1", "format=\"ascii\">0 1 2 3 1 2 3 4", ">4 8", ">10\n10"});
}
std::string base64_vtu() {
  return vtu(
      "header_type=\"UInt64\" byte_order=\"LittleEndian\"",
      {"format=\"binary\">\nPAAAAAAAAAAAAAAAAAAAAAAAAAAAAIA/AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAIA/AACAPwAAgD8=\n",
       "format=\"binary\">\nIAAAAAAAAAAAAAAAAQAAAAIAAAADAAAAAQAAAAIAAAADAAAABAAAAA==\n",
       "format=\"binary\">\nEAAAAAAAAAAEAAAAAAAAAAgAAAAAAAAA\n", "format=\"binary\">\nAgAAAAAAAAAKCg==\n"});
}
/// Compressed in blocks of 32 bytes, appended as base64.
std::string compressed_vtu() {
  return vtu("compressor=\"vtkZLibDataCompressor\"",
             {"format=\"appended\" offset=\"0\">", "format=\"appended\" offset=\"72\">", "format=\"appended\" offset=\"128\">",
              "format=\"appended\" offset=\"172\">"},
             "<AppendedData encoding=\"base64\">\n_"
             "AgAAACAAAAAcAAAAEAAAAA8AAAA=eJxjYEAGDfYMaHwADo4Bf3icY2BABg32yBgAFwAC/Q=="
             "AQAAACAAAAAAAAAAFgAAAA==eJxjYGBgYARiJiBmRmOzADEAAPgAEQ=="
             "AQAAACAAAAAQAAAADgAAAA==eJxjYYAADigNAACQAA0="
             "AQAAACAAAAACAAAACgAAAA==eJzj4gIAACAAFQ=="
             "\n</AppendedData>\n");
}
/// Bytes as they are, behind the length of each array.
std::string raw_vtu() {
  std::string bytes;
  const auto append = [&](const auto&... numbers) {
    const auto put = [&](const auto& number) { bytes.append(reinterpret_cast<const char*>(&number), sizeof number); };
    put(std::uint32_t((sizeof numbers + ...)));
    (put(numbers), ...);
  };
  append(0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 1.f, 1.f, 1.f);
  append(0, 1, 2, 3, 1, 2, 3, 4);
  append(std::int64_t(4), std::int64_t(8));
  append(std::uint8_t(10), std::uint8_t(10));
  const auto at = [](int offset) { return "format=\"appended\" offset=\"" + std::to_string(offset) + "\">"; };
  return vtu("byte_order=\"LittleEndian\"", {at(0), at(64), at(100), at(120)},
             "<AppendedData encoding=\"raw\">_" + bytes + "</AppendedData>\n");
}

std::vector<Format> formats() {
  std::string dos = medit;
  for (std::size_t at = 0; (at = dos.find('\n', at)) != std::string::npos; at += 2) dos.replace(at, 1, "\r\n");
  return {{"TetGen from 1", {{"a.ele", ele}, {"a.node", node}}},
          {"TetGen from 0", {{"a.node", node_from_zero}, {"a.ele", ele_from_zero}}},
          {"Medit", {{"a.mesh", medit}}},
          {"Medit with DOS line ends", {{"a.mesh", dos}}},
          {"Medit after a byte order mark", {{"a.MESH", "\xef\xbb\xbf" + medit}}},
          {"VTK", {{"a.vtk", vtk}}},
          {"VTK of version 5", {{"a.vtk", vtk_of_version_5()}}},
          {"binary VTK", {{"a.vtk", binary_vtk()}}},
          {"VTK's XML", {{"a.vtu", text_vtu()}}},
          {"VTK's XML in base64", {{"a.vtu", base64_vtu()}}},
          {"VTK's XML, compressed", {{"a.vtu", compressed_vtu()}}},
          {"VTK's XML with raw bytes", {{"a.vtu", raw_vtu()}}}};
}

std::filesystem::path write(const TemporaryDirectory& directory, const Files& files) {
  std::filesystem::path last;
  for (const auto& [name, bytes] : files) last = directory.write(name, bytes);
  return last;
}

TEST(TetrahedraFiles, OfEveryFormatGiveTheSameMesh) {
  for (const Format& format : formats()) {
    SCOPED_TRACE(format.name);
    const TemporaryDirectory directory;
    std::vector<std::string> notes;
    const TetrahedralMesh mesh = read_tetrahedra(write(directory, format.files), notes);
    ASSERT_EQ(mesh.vertices.size(), 5u);
    EXPECT_EQ(mesh.vertices[4], Vector3(1, 1, 1));
    EXPECT_EQ(mesh.vertices[1], Vector3(1, 0, 0));
    ASSERT_EQ(mesh.tetrahedra.size(), 2u);
    EXPECT_THAT(mesh.tetrahedra[1], ElementsAre(1, 2, 3, 4));
    EXPECT_THAT(volumes(mesh), ElementsAre(testing::DoubleEq(1.0 / 6), testing::DoubleEq(1.0 / 3)));
  }
}

TEST(TetrahedraFiles, SayWhatTheyMend) {
  const TemporaryDirectory directory;
  std::vector<std::string> notes;
  // the second tetrahedron inside out, and a sixth vertex that none uses
  const auto file =
      directory.write("a.mesh",
                      "MeshVersionFormatted 1\nDimension 3\nVertices 6\n0 0 0 0\n1 0 0 0\n5 5 5 0\n0 1 0 0\n0 0 1 0\n1 1 1 0\n"
                      "Tetrahedra 2\n1 2 4 5 0\n4 2 5 6 0\n");
  const TetrahedralMesh mesh = read_tetrahedra(file, notes);
  EXPECT_EQ(mesh.vertices.size(), 5u);
  EXPECT_EQ(mesh.vertices[2], Vector3(0, 1, 0));
  for (const double volume : volumes(mesh)) EXPECT_GT(volume, 0);
  EXPECT_THAT(notes, ElementsAre(file.string() + ": 1 tetrahedron was inside out, the first number 2, and has been turned",
                                 file.string() + ": 1 vertex belongs to no tetrahedron and is left out"));
  notes.clear();
  const TetrahedralMesh turned =
      read_tetrahedra(directory.write("b.mesh",
                                      "MeshVersionFormatted 1\nDimension 3\nVertices 4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"
                                      "Tetrahedra 1\n1 3 2 4 0\n"),
                      notes);
  EXPECT_NEAR(measure(turned).volume, 1.0 / 6, 1e-15);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("b.mesh: all 1 tetrahedra were inside out and have been turned")));
}

struct Bad {
  Files files;
  std::string message;
};

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

std::vector<Bad> bad_files() {
  const auto with_ele = [](const std::string& bytes) { return Files{{"a.node", node}, {"a.ele", bytes}}; };
  const auto with_node = [](const std::string& bytes) { return Files{{"a.ele", ele}, {"a.node", bytes}}; };
  const auto one = [](const char* name, const std::string& bytes) { return Files{{name, bytes}}; };
  const std::string binary = binary_vtk();
  return {
      {{{"a.node", node}}, "a.node: there is no a.ele beside it; TetGen's files come in pairs"},
      {with_node(""), "a.node:1: the file is empty; it must begin with the number of vertices"},
      {with_node("# nothing\n"), "the file is empty"},
      {with_node(replaced(node, "5 3 1 1", "5 2 1 1")), "a.node:2: the dimension must be 3, is '2'"},
      {with_node(replaced(node, "5 3 1 1", "-5 3 1 1")), "a.node:2: the number of vertices must be from 1 to"},
      {with_node(replaced(node, "5 3 1 1", "99999999999999999999 3")), "a.node:2: the number of vertices must be from 1 to"},
      {with_node(replaced(node, "5 3 1 1", "4000000000 3 1 1")), "the file ends after 5 of the 4000000000 vertices"},
      {with_node(replaced(node, "\n3 0 1 0", "\n4 0 1 0")),
       "a.node:6: vertices must be numbered in order, this is 4 and should be 3"},
      {with_node(replaced(node, "\n1 0 0 0", "\n2 0 0 0")),
       "a.node:3: the number of the first vertex must be from 0 to 1, is '2'"},
      {with_node(replaced(node, "0 1 0 7.5", "0 one 0 7.5")), "a.node:6: expected a vertex coordinate, found 'one'"},
      {with_node(replaced(node, "0 1 0 7.5", "0 nan 0 7.5")), "a.node:6: a vertex coordinate is not finite: 'nan'"},
      {with_node(replaced(node, "4 0 0 1 7.5 1", "4 0 0")),
       "a.node:7: expected a vertex coordinate, found the end of the line"},
      {with_node(replaced(node, "by hand", "by h\xffnd")), "a.node:1: not a text in UTF-8 (byte 11 is 0xff)"},
      {with_ele(replaced(ele, "2 4 1", "2 10 1")),
       "a.ele:1: tetrahedra of 10 nodes are not read; write linear ones, of 4 nodes"},
      {with_ele(replaced(ele, "2 2 3 4 5", "2 2 3 4 6")), "a.ele:3: a vertex of the tetrahedron must be from 1 to 5, is '6'"},
      {with_ele(replaced(ele, "2 2 3 4 5", "2 2 3 4 0")), "a.ele:3: a vertex of the tetrahedron must be from 1 to 5, is '0'"},
      {with_ele("3 4 0\n1 1 2 3 4\n"), "the file ends after 1 of the 3 tetrahedra that its first line counts"},
      {with_ele("1 4 0\n1 1 2 3 3\n"), "a.ele: 1 tetrahedron has no volume, the first is number 1; remove them"},
      {with_ele("3 4 0\n1 1 2 3 4\n2 2 3 4 1\n3 2 3 5 4\n"), "a.ele: 1 face belongs to more than two tetrahedra"},
      {with_ele("2 4 0\n1 1 2 3 4\n2 1 2 3 5\n"), "a.ele: 1 tetrahedra overlap with a neighbour"},

      {one("a.mesh", ""), "a.mesh:1: a Medit file must begin with 'MeshVersionFormatted'"},
      {one("a.mesh", replaced(medit, "Dimension\n3", "Dimension\n2")), "a.mesh:4: the dimension must be 3, is '2'"},
      {one("a.mesh", replaced(medit, "Dimension\n3", "")), "'Dimension 3' must come before 'Vertices'"},
      {one("a.mesh", replaced(medit, "Tetrahedra", "Hexahedra")), "the file has no section 'Tetrahedra'"},
      {one("a.mesh", replaced(medit, "Vertices", "Points")), "'Vertices' must come before 'Tetrahedra'"},
      {one("a.mesh", medit.substr(0, medit.find("\nTriangles"))), "the file has no section 'Tetrahedra'"},
      {one("a.mesh", medit.substr(0, medit.find("0 # the"))),
       "expected the reference of a tetrahedron, found the end of the file"},
      {one("a.mesh", replaced(medit, "2 3 4 5 0", "2 3 4 6 0")),
       "a.mesh:18: a vertex of a tetrahedron must be from 1 to 5, is '6'"},
      {one("a.mesh", replaced(medit, "2 3 4 5 0", "2 3 4 5.5 0")),
       "a.mesh:18: expected a vertex of a tetrahedron, a whole number, found '5.5'"},
      {one("a.mesh", replaced(medit, "Tetrahedra 2", "Tetrahedra 4000000000")), "expected a vertex of a tetrahedron"},
      {one("a.mesh", replaced(medit, "Tetrahedra 2", "Tetrahedra 0\n17")), "expected the name of a section, found '17'"},
      {one("a.mesh", medit.substr(0, medit.find("Tetrahedra")) + "Tetrahedra 0\nEnd\n"), "a.mesh: there are no tetrahedra"},
      {one("a.mesh", std::string("\0\0\0\1\0\0\0\3", 8)), "a.mesh:1: not a text in UTF-8 (byte 0 is 0x00)"},

      {one("a.vtu", "<VTKFile>"), "a.vtu:1: is no XML"},
      {one("a.vtu", replaced(text_vtu(), "\"UnstructuredGrid\"", "\"PolyData\"")), "is of type \"PolyData\""},
      {one("a.vtu", replaced(text_vtu(), "version=\"0.1\"", "byte_order=\"BigEndian\"")), "only LittleEndian is read"},
      {one("a.vtu", replaced(compressed_vtu(), "vtkZLib", "vtkLZ4")), "is compressed by vtkLZ4DataCompressor"},
      {one("a.vtu", replaced(text_vtu(), "4</DataArray>", "5</DataArray>")),
       "a cell has corner 5; corners must be from 0 to 4"},
      {one("a.vtu", replaced(text_vtu(), ">4 8", ">4 9")), "its offsets must rise to at most 8"},
      {one("a.vtu", replaced(text_vtu(), "10\n10", "12\n10")), "cell 0 is of type 12"},
      {one("a.vtu", replaced(text_vtu(), "\"offsets\"", "\"ends\"")), "a <Piece> has no \"offsets\" in its <Cells>"},
      {one("a.vtu", replaced(text_vtu(), ">4 8", ">4 x")), "array \"offsets\" holds something that is not a number"},
      {one("a.vtu", replaced(text_vtu(), " 1 1 1<", " 1 1<")), "has 14 coordinates for 5 points"},
      {one("a.vtu", replaced(base64_vtu(), "binary", "hex")), "has the format \"hex\", must be ascii, binary or appended"},
      {one("a.vtu", replaced(base64_vtu(), "PAAAAAAAAAA", "PBAAAAAAAAA")), "ends before its 4156 bytes"},
      {one("a.vtu", replaced(base64_vtu(), "PAAAAAAAAAA", "P?AAAAAAAAA")), "is no base64"},
      {one("a.vtu", replaced(compressed_vtu(), "=eJxjYEAG", "=eJxjYEAH")), "array \"\": block 0 cannot be unpacked"},
      {one("a.vtu", replaced(raw_vtu(), "offset=\"120\"", "offset=\"4000\"")), "needs an offset inside of <AppendedData>"},
      {one("a.vtk", "<VTKFile>"), "a.vtk:1: a legacy VTK file must begin with '# vtk DataFile Version'"},
      {one("a.vtk", replaced(vtk, "UNSTRUCTURED_GRID", "POLYDATA")), "a.vtk:4: expected DATASET UNSTRUCTURED_GRID"},
      {one("a.vtk", replaced(vtk, "ASCII", "HEX")), "a.vtk:3: expected ASCII or BINARY"},
      {one("a.vtk", replaced(vtk, "POINTS 5 float", "POINTS 5 quad")), "word 3 of this line must be a type of numbers"},
      {one("a.vtk", replaced(vtk, "POINTS 5", "POINTS 4000000000")),
       "expected a coordinate, found something that is not a number"},
      {one("a.vtk", replaced(vtk, "4 1 2 3 4", "4 1 2 3 5")), "cell 2 has corner 5; corners must be from 0 to 4"},
      {one("a.vtk", replaced(vtk, "5\n10\n10", "5\n12\n10")),
       "cell 1 is of type 12; volumes must be tetrahedra of four corners, type 10"},
      {one("a.vtk", replaced(vtk, "CELL_TYPES 3\n5\n10\n10", "CELL_TYPES 2\n5\n10")), "there are 2 types for 3 cells"},
      {one("a.vtk", replaced(vtk, "CELLS 3", "CELLS 4")), "CELLS says 4 cells, its 14 numbers hold 3"},
      {one("a.vtk", replaced(vtk, "4 1 2 3 4", "5 1 2 3 4")), "CELLS says 3 cells, its 14 numbers hold 3"},
      {one("a.vtk", replaced(vtk, "4 1 2 3 4\nCELL_TYPES", "4 1 2.5 3 4\nCELL_TYPES")), "must be a whole number, is 2.5"},
      {one("a.vtk", vtk.substr(0, vtk.find("CELL_TYPES"))), "the file ends without CELL_TYPES"},
      {one("a.vtk", binary.substr(0, binary.find("\nCELLS") - 4)), "the file ends within 15 numbers, each a coordinate"},
      {one("a.vtk", replaced(binary, "POINTS 5", "POINTS 4000000000")), "the file ends within 12000000000 numbers"},

      {one("a.msh", ""), "a.msh: not a file of tetrahedra; its name must end in .node or .ele (TetGen)"},
  };
}

TEST(TetrahedraFiles, ThatAreMalformedAreRefusedWithTheirPlace) {
  for (const Bad& bad : bad_files()) {
    SCOPED_TRACE(bad.message);
    const TemporaryDirectory directory;
    const auto file = write(directory, bad.files);
    std::vector<std::string> notes;
    EXPECT_THAT(input_error([&] { read_tetrahedra(file, notes); }), HasSubstr(bad.message));
  }
}

// Whatever happens to a file, the readers give a valid mesh or an InputError.
TEST(TetrahedraFiles, SurviveDamage) {
  const TemporaryDirectory directory;
  std::mt19937 random(3);
  int refused = 0;
  for (const Format& whole : formats()) {
    for (int trial = 0; trial < 200; ++trial) {
      Files files = whole.files;
      std::string& bytes = files.back().second;
      for (std::uint32_t change = random() % 4; change-- > 0;) bytes[random() % bytes.size()] = static_cast<char>(random());
      if (trial % 3 == 0) bytes.resize(random() % bytes.size());
      const auto file = write(directory, files);
      std::vector<std::string> notes;
      refused += !input_error([&] {
                    const TetrahedralMesh mesh = read_tetrahedra(file, notes);
                    for (const auto& tetrahedron : mesh.tetrahedra)
                      for (const auto corner : tetrahedron) ASSERT_LT(corner, mesh.vertices.size());
                    for (const double volume : volumes(mesh)) ASSERT_GT(volume, 0);
                  }).empty();
    }
  }
  EXPECT_GT(refused, 300);
}

TEST(TetrahedraFiles, OfTheReferenceDataAreReadWhole) {
  const auto armadillo = shared_mesh("armadillo-coarse.node"), bunny = shared_mesh("coarse-bunny.mesh");
  if (armadillo.empty() || bunny.empty()) GTEST_SKIP() << "no reference data";
  std::vector<std::string> notes;
  const TetrahedralMesh a = read_tetrahedra(armadillo, notes), b = read_tetrahedra(bunny, notes);
  EXPECT_EQ(a.vertices.size(), 259u);
  EXPECT_EQ(a.tetrahedra.size(), 627u);
  EXPECT_EQ(b.vertices.size(), 699u);
  EXPECT_EQ(b.tetrahedra.size(), 2274u);
  EXPECT_EQ(measure(a).pieces, 1u);
  EXPECT_EQ(measure(b).pieces, 1u);
}

}  // namespace
}  // namespace cleave::scene
