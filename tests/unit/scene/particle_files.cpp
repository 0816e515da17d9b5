#include "scene/sampling.hpp"
#include "scene_testing.hpp"

namespace cleave::scene {
namespace {

using testing::HasSubstr;

ParticleSource read(const std::string& text, int dimension = 3, double default_volume = 0.125) {
  const TemporaryDirectory directory;
  return read_particles(directory.write("particles.csv", text), dimension, default_volume);
}

TEST(ParticleFiles, GiveEveryColumn) {
  const ParticleSource p = read(
      "# written by hand\n"
      "volume, x ,y,z,vx,vy,vz,F00,F01,F02,F10,F11,F12,F20,F21,F22,\"alpha\",temperature\n"
      "\n"
      "0.5,1,+2,-3e0,4,5,6,1,0.1,0.2,0.3,1.1,0.4,0.5,0.6,1.2,-0.01,300\n"
      "# a comment\n"
      "0.25,1,2,3,0,0,0,-1,0,0,0,1,0,0,0,1,0,301");
  ASSERT_EQ(p.positions.size(), 2u);
  EXPECT_EQ(p.positions[0], Vector3(1, 2, -3));
  EXPECT_EQ(p.velocities[0], Vector3(4, 5, 6));
  EXPECT_EQ(p.volumes, (std::vector<double>{0.5, 0.25}));
  Matrix3 F;
  F << 1, 0.1, 0.2, 0.3, 1.1, 0.4, 0.5, 0.6, 1.2;
  EXPECT_EQ(p.deformation[0], F);
  EXPECT_EQ(p.deformation[1], Matrix3(Vector3(-1, 1, 1).asDiagonal())) << "which laws may or may not know of";
  ASSERT_EQ(p.states.size(), 2u);
  EXPECT_EQ(p.states.at("alpha"), (std::vector<double>{-0.01, 0}));
  EXPECT_EQ(p.states.at("temperature"), (std::vector<double>{300, 301}));
}

TEST(ParticleFiles, LeaveOutWhatTheyDoNotGive) {
  const ParticleSource p = read("x,y,z\r\n1,2,3\r\n4,5,6\r\n");
  EXPECT_EQ(p.positions, (std::vector<Vector3>{{1, 2, 3}, {4, 5, 6}}));
  EXPECT_EQ(p.volumes, (std::vector<double>{0.125, 0.125}));
  EXPECT_TRUE(p.velocities.empty() && p.deformation.empty() && p.states.empty());
}

TEST(ParticleFiles, MayHaveAByteOrderMarkAndSomeVelocities) {
  const ParticleSource p = read("\xef\xbb\xbfx,y,z,vy\n1,2,3,7\n");
  EXPECT_EQ(p.velocities[0], Vector3(0, 7, 0));
}

TEST(ParticleFiles, InTwoDimensionsNeedOnlyThePlane) {
  const ParticleSource p = read("x,y,F00,F01,F10,F11\n1,2,1.1,0.2,0.3,0.9\n", 2);
  EXPECT_EQ(p.positions[0], Vector3(1, 2, 0));
  Matrix3 F;
  F << 1.1, 0.2, 0, 0.3, 0.9, 0, 0, 0, 1;
  EXPECT_EQ(p.deformation[0], F);
  EXPECT_EQ(read("x,y,F00,F01,F10,F11,F22\n1,2,1,0,0,1,0.8\n", 2).deformation[0](2, 2), 0.8);
}

TEST(ParticleFiles, KeepEveryDigit) {
  EXPECT_EQ(read("x,y,z\n0.1,1e-320,123456789.12345679\n").positions[0], Vector3(0.1, 1e-320, 123456789.12345679));
}

TEST(ParticleFiles, ThatAreMalformedAreRefusedWithLineAndColumn) {
  struct Bad {
    const char *text, *message;
    int dimension = 3;
  };
  for (const Bad& bad : std::initializer_list<Bad>{
           {"", "particles.csv: the particle file is empty"},
           {"# only a comment\n", "particles.csv: the particle file is empty"},
           {"x,y,z\n", "particles.csv: the particle file has a header but no particles"},
           {"1,2,3\n", "particles.csv:1: expected a header with the names of the columns, found the number 1"},
           {"x,y\n1,2\n", "particles.csv:1: the header lacks the column z"},
           {"y,z\n1,2\n", "particles.csv:1: the header lacks the column x"},
           {"x,y,z,x\n", "particles.csv:1: the column 'x' appears twice"},
           {"x,,y,z\n", "particles.csv:1: column 2 of the header has no name"},
           {"x,y,z\n1,2\n", "particles.csv:2: column 'z': the value is missing"},
           {"x,y,z\n1,2,3,4\n", "particles.csv:2: more values than the 3 columns of the header"},
           {"x,y,z\n1,,3\n", "particles.csv:2: column 'y': expected a number, found ''"},
           {"x,y,z\n#\n\n1,2m,3\n", "particles.csv:4: column 'y': expected a number, found '2m'"},
           {"x,y,z\n1;2;3\n", "particles.csv:2: column 'x': expected a number, found '1;2;3'"},
           {"x,y,z\n1,nan,3\n", "particles.csv:2: column 'y': the value is not finite"},
           {"x,y,z\n1,2,-inf\n", "particles.csv:2: column 'z': the value is not finite"},
           {"x,y,z,alpha\n1,2,3,1e999\n", "particles.csv:2: column 'alpha': the value is not finite: 1e999"},
           {"x,y,z,volume\n1,2,3,0\n", "particles.csv:2: column 'volume': must be positive"},
           {"x,y,z,volume\n1,2,3,1\n1,2,3,-1\n", "particles.csv:3: column 'volume': must be positive"},
           {"x,y,z,F00,F11,F22\n", "particles.csv:1: the header lacks the column F01, F02, F10, F12, F20, F21"},
           {"x,y,z\n1,2,3\n", "particles.csv:2: column 'z': must be 0 in two dimensions", 2},
           {"x,y,vz\n1,2,3\n", "particles.csv:2: column 'vz': must be 0 in two dimensions", 2},
           {"x,y,F00,F01,F10,F11,F02\n1,2,1,0,0,1,0.1\n", "particles.csv:2: column 'F02': must be 0 in two dimensions", 2},
           {"x,y,F00,F11\n", "particles.csv:1: the header lacks the column F01, F10", 2}}) {
    EXPECT_THAT(input_error([&] { read(bad.text, bad.dimension); }), HasSubstr(bad.message));
  }
  EXPECT_THAT(input_error([] { read("x,y,z\n1,2,3\n", 3, 0); }), HasSubstr("lacks the column volume"));
  EXPECT_THAT(input_error([] { read_particles("/nowhere/particles.csv", 3, 1); }),
              HasSubstr("/nowhere/particles.csv: no such file"));
}

}  // namespace
}  // namespace cleave::scene
