#include "output/frame.hpp"
#include "run_directory.hpp"

#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include <cmath>
#include <cstring>
#include <map>
#include <numbers>
#include <sstream>

namespace cleave::output {
namespace {

namespace tree = boost::property_tree;

std::string decoded(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  unsigned bits = 0;
  int count = 0;
  for (const char c : text) {
    const std::size_t digit = digits.find(c);
    if (digit == std::string::npos) continue;
    bits = bits << 6 | static_cast<unsigned>(digit);
    if ((count += 6) >= 8) bytes += static_cast<char>(bits >> (count -= 8) & 255);
  }
  return bytes;
}

struct Array {
  std::string type, text;
  int components = 1;

  template <class T>
  std::vector<T> values() const {
    const std::string bytes = decoded(text);
    std::uint64_t size = 0;
    EXPECT_GE(bytes.size(), sizeof size);
    std::memcpy(&size, bytes.data(), sizeof size);
    EXPECT_EQ(size, bytes.size() - sizeof size);
    std::vector<T> result(size / sizeof(T));
    std::memcpy(result.data(), bytes.data() + sizeof size, size);
    return result;
  }
};

std::map<std::string, Array> arrays(const tree::ptree& section) {
  std::map<std::string, Array> found;
  for (const auto& [tag, node] : section)
    if (tag == "DataArray")
      found[node.get<std::string>("<xmlattr>.Name")] = {node.get<std::string>("<xmlattr>.type"), node.data(),
                                                        node.get("<xmlattr>.NumberOfComponents", 1)};
  return found;
}

class VtkFrames : public RunDirectory, public testing::WithParamInterface<int> {
 protected:
  tree::ptree parsed(const std::string& name) {
    tree::ptree document;
    tree::read_xml((directory / name).string(), document);
    return document.get_child("VTKFile");
  }
};

TEST_P(VtkFrames, HoldTheParticlesAndTheirAttributes) {
  const ParticleFrame frame = random_frame(1001, GetParam());
  Writer(directory, {"vtp"}, false).frame(frame);
  const tree::ptree document = parsed("vtp/frame_0007.vtp");
  EXPECT_EQ(document.get<std::string>("<xmlattr>.type"), "PolyData");
  EXPECT_EQ(document.get<std::string>("<xmlattr>.byte_order"), "LittleEndian");
  EXPECT_EQ(document.get<std::string>("<xmlattr>.header_type"), "UInt64");
  const tree::ptree& piece = document.get_child("PolyData.Piece");
  EXPECT_EQ(piece.get<int>("<xmlattr>.NumberOfPoints"), 1001);
  EXPECT_EQ(piece.get<int>("<xmlattr>.NumberOfVerts"), 1001);

  const auto field = arrays(document.get_child("PolyData.FieldData"));
  EXPECT_EQ(field.at("TimeValue").values<double>(), std::vector<double>{frame.time});
  EXPECT_EQ(field.at("frame").values<std::int32_t>(), std::vector<std::int32_t>{7});
  EXPECT_EQ(field.at("cell_size").values<double>(), std::vector<double>{0.5});
  std::istringstream codes(field.at("bodies").text);
  std::string names;
  for (int code; codes >> code;) names += code == 0 ? '|' : static_cast<char>(code);
  EXPECT_EQ(names, "left half|right <half> & \"rest\"|");

  const auto point = arrays(piece.get_child("PointData"));
  EXPECT_EQ(point.at("id").type, "Int64");
  const auto ids = point.at("id").values<std::int64_t>();
  const auto body = point.at("body").values<std::int32_t>();
  EXPECT_EQ(point.at("body").type, "Int32");
  EXPECT_EQ(point.at("damage").values<float>(), frame.attributes[0].values);
  EXPECT_EQ(point.at("fiber").components, 3);
  EXPECT_EQ(point.at("fiber").values<float>(), frame.attributes[1].values);
  EXPECT_EQ(point.at("F").components, 9);
  EXPECT_EQ(point.at("F").values<float>(), frame.attributes[3].values);
  EXPECT_EQ(point.at("v_").values<float>(), frame.attributes[4].values);

  const std::vector<float> velocity = point.at("velocity").values<float>(), radius = point.at("pscale").values<float>(),
                           stress = point.at("stress").values<float>();
  const auto positions = arrays(piece.get_child("Points")).at("Points");
  EXPECT_EQ(positions.type, "Float64");
  const std::vector<double> coordinates = positions.values<double>();
  ASSERT_EQ(ids.size(), 1001u);
  ASSERT_EQ(body.size(), 1001u);
  ASSERT_EQ(coordinates.size(), 3u * 1001);
  ASSERT_EQ(velocity.size(), 3u * 1001);
  ASSERT_EQ(stress.size(), 6u * 1001);
  const std::size_t vtk_order[] = {0, 1, 2, 3, 5, 4};  // xx yy zz xy yz xz
  for (std::size_t i = 0; i < 1001; ++i) {
    ASSERT_EQ(ids[i], static_cast<std::int64_t>(i));
    ASSERT_EQ(body[i], i < 668 ? 0 : 1);
    for (std::size_t c = 0; c < 3; ++c) {
      ASSERT_EQ(coordinates[3 * i + c], frame.positions[i][static_cast<int>(c)]);
      ASSERT_EQ(velocity[3 * i + c], frame.velocities[i][static_cast<int>(c)]);
    }
    for (std::size_t c = 0; c < 6; ++c) ASSERT_EQ(stress[6 * i + c], frame.attributes[2].values[6 * i + vtk_order[c]]);
    const double volume =
        GetParam() == 2 ? std::numbers::pi * std::pow(radius[i], 2) : 4 * std::numbers::pi / 3 * std::pow(radius[i], 3);
    ASSERT_NEAR(volume, frame.volumes[i], 1e-6 * frame.volumes[i]);
  }

  const auto vertices = arrays(piece.get_child("Verts"));
  const std::vector<std::int64_t> connectivity = vertices.at("connectivity").values<std::int64_t>(),
                                  offsets = vertices.at("offsets").values<std::int64_t>();
  ASSERT_EQ(connectivity.size(), 1001u);
  ASSERT_EQ(offsets.size(), 1001u);
  for (std::int64_t i = 0; i < 1001; ++i) {
    ASSERT_EQ(connectivity[static_cast<std::size_t>(i)], i);
    ASSERT_EQ(offsets[static_cast<std::size_t>(i)], i + 1);
  }
}

INSTANTIATE_TEST_SUITE_P(Dimensions, VtkFrames, testing::Values(2, 3));

using VtkSeries = VtkFrames;

TEST_F(VtkSeries, FlatParticlesLieInThePlane) {
  ParticleFrame frame = random_frame(3, 2);
  frame.positions[1].z() = 4;
  Writer(directory, {"vtp"}, false).frame(frame);
  const auto positions = arrays(parsed("vtp/frame_0007.vtp").get_child("PolyData.Piece.Points")).at("Points").values<double>();
  EXPECT_EQ(positions[5], 0);
}

TEST_F(VtkSeries, AnEmptyFrameIsAFrame) {
  Writer(directory, {"vtp", "vdb", "ply"}, false).frame(random_frame(0));
  EXPECT_EQ(parsed("vtp/frame_0007.vtp").get<int>("PolyData.Piece.<xmlattr>.NumberOfPoints"), 0);
}

TEST_F(VtkSeries, TheIndexListsEachFrameAtItsTimeAfterEachFrame) {
  Writer writer(directory, {"vtp"}, false);
  for (const int index : {0, 1, 2, 2, 12345}) {
    ParticleFrame frame = random_frame(2);
    frame.index = index;
    frame.time = 0.1 * index;
    writer.frame(frame);
    std::vector<std::pair<double, std::string>> listed;
    const tree::ptree document = parsed("particles.pvd");
    for (const auto& [tag, node] : document.get_child("Collection"))
      listed.emplace_back(node.get<double>("<xmlattr>.timestep"), node.get<std::string>("<xmlattr>.file"));
    ASSERT_FALSE(listed.empty());
    EXPECT_EQ(listed.back().first, 0.1 * index);
    for (const auto& [time, file] : listed) EXPECT_TRUE(std::filesystem::exists(directory / file)) << file;
  }
  EXPECT_EQ(parsed("particles.pvd").get_child("Collection").size(), 4u);
  EXPECT_TRUE(std::filesystem::exists(directory / "vtp/frame_12345.vtp"));
}

}  // namespace
}  // namespace cleave::output
