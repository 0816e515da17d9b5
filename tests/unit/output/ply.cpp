#include "output/frame.hpp"
#include "run_directory.hpp"

#include <cstring>
#include <map>
#include <sstream>

namespace cleave::output {
namespace {

/// Every property of every vertex as a number, by name.
struct Ply {
  std::vector<std::string> comments;
  std::map<std::string, std::string> types;
  std::map<std::string, std::vector<double>> columns;
};

template <class T>
double take(const char*& bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  bytes += sizeof value;
  return static_cast<double>(value);
}

Ply parsed(const std::string& bytes) {
  const std::string end = "end_header\n";
  const std::size_t body = bytes.find(end) + end.size();
  std::istringstream header(bytes.substr(0, body));
  Ply ply;
  std::vector<std::string> order;
  std::size_t vertices = 0;
  std::string line;
  std::getline(header, line);
  EXPECT_EQ(line, "ply");
  std::getline(header, line);
  EXPECT_EQ(line, "format binary_little_endian 1.0");
  while (std::getline(header, line)) {
    std::istringstream words(line);
    std::string word, type, name;
    words >> word;
    if (word == "comment") ply.comments.push_back(line.substr(8));
    if (word == "element") words >> name >> vertices;
    if (word == "property") {
      words >> type >> name;
      EXPECT_TRUE(ply.types.emplace(name, type).second) << name << " twice";
      order.push_back(name);
    }
  }
  const char* next = bytes.data() + body;
  for (std::size_t i = 0; i < vertices; ++i)
    for (const std::string& name : order) {
      const std::string& type = ply.types[name];
      ply.columns[name].push_back(type == "int"      ? take<std::int32_t>(next)
                                  : type == "double" ? take<double>(next)
                                                     : take<float>(next));
    }
  EXPECT_EQ(next, bytes.data() + bytes.size());
  return ply;
}

class PlyFrames : public RunDirectory, public testing::WithParamInterface<int> {};

TEST_P(PlyFrames, HoldTheParticlesAndTheirAttributes) {
  ParticleFrame frame = random_frame(500, GetParam());
  frame.attributes.push_back({"stress_xx", 1, "", std::vector<float>(500, 2)});
  Writer(directory, {"ply"}, false).frame(frame);
  Ply ply = parsed(contents("ply/frame_0007.ply"));
  EXPECT_EQ(ply.comments, (std::vector<std::string>{"time 0.875 s", "frame 7", "cell_size 0.5 m", "body 0 left half",
                                                    "body 1 right <half> & \"rest\""}));
  EXPECT_EQ(ply.types["id"], "int");
  const char* axes[] = {"x", "y", "z"};
  const char* symmetric[] = {"stress_xx_", "stress_yy", "stress_zz", "stress_xy", "stress_xz", "stress_yz"};
  const char* full[] = {"F_xx", "F_xy", "F_xz", "F_yx", "F_yy", "F_yz", "F_zx", "F_zy", "F_zz"};
  for (std::size_t i = 0; i < 500; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      const int axis = static_cast<int>(c);
      ASSERT_EQ(ply.columns[axes[c]][i], static_cast<float>(frame.positions[i][axis]));
      ASSERT_EQ(ply.columns[std::string("v") + axes[c]][i], frame.velocities[i][axis]);
      ASSERT_EQ(ply.columns[std::string("fiber_") + axes[c]][i], frame.attributes[1].values[3 * i + c]);
    }
    ASSERT_EQ(ply.columns["id"][i], static_cast<double>(i));
    ASSERT_EQ(ply.columns["body"][i], i < 334 ? 0 : 1);
    ASSERT_GT(ply.columns["pscale"][i], 0);
    ASSERT_EQ(ply.columns["damage"][i], frame.attributes[0].values[i]);
    for (std::size_t c = 0; c < 6; ++c) ASSERT_EQ(ply.columns[symmetric[c]][i], frame.attributes[2].values[6 * i + c]);
    for (std::size_t c = 0; c < 9; ++c) ASSERT_EQ(ply.columns[full[c]][i], frame.attributes[3].values[9 * i + c]);
    ASSERT_EQ(ply.columns["v_"][i], frame.attributes[4].values[i]);
    ASSERT_EQ(ply.columns["stress_xx"][i], 2);
  }
}

INSTANTIATE_TEST_SUITE_P(Dimensions, PlyFrames, testing::Values(2, 3));

}  // namespace
}  // namespace cleave::output
