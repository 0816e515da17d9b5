#include "common/error.hpp"
#include "render/run_frames.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <random>

namespace cleave::render {
namespace {

namespace fs = std::filesystem;

class Frames : public testing::Test {
 protected:
  Frames() {
    std::string name = (fs::temp_directory_path() / "cleave-frames-XXXXXX").string();
    directory = mkdtemp(name.data());
  }
  ~Frames() override { fs::remove_all(directory); }

  static output::ParticleFrame frame() {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> any(-1, 1);
    output::ParticleFrame f;
    f.index = 4;
    f.time = 0.625;
    f.cell_size = 0.1;
    f.bodies = {"left one", "right"};
    f.body_ends = {30, 50};
    for (int i = 0; i < 50; i++) {
      f.positions.push_back(Eigen::Vector3f(any(random), any(random), any(random)).cast<double>());
      f.velocities.push_back({any(random), any(random), any(random)});
      f.volumes.push_back(1e-3f * (1 + any(random) / 2));
    }
    for (const int components : {1, 3, 6, 9}) {
      output::Attribute a{"q" + std::to_string(components), components, "Pa", {}};
      for (int i = 0; i < 50 * components; i++) a.values.push_back(any(random));
      f.attributes.push_back(a);
    }
    return f;
  }

  fs::path directory;
};

TEST_F(Frames, AreReadAsTheyWereWritten) {
  const output::ParticleFrame f = frame();
  for (const char* format : {"vdb", "vtp", "ply"}) {
    const fs::path run = directory / format;
    output::Writer(run, {format}, false).frame(f);
    const RunFrames frames(run);
    ASSERT_EQ(frames.indices(), std::vector<int>{4}) << format;
    EXPECT_EQ(frames.attribute_names(4), (std::set<std::string>{"q1", "q3", "q6", "q9"})) << format;
    const output::ParticleFrame read = frames.load(
        4, [](const std::string& name) { return name != "q9"; }, 3);
    EXPECT_EQ(read.time, f.time) << format;
    EXPECT_EQ(read.cell_size, f.cell_size) << format;
    EXPECT_EQ(read.bodies, f.bodies) << format;
    EXPECT_EQ(read.body_ends, f.body_ends) << format;
    ASSERT_EQ(read.particles(), 50u) << format;
    for (std::size_t i = 0; i < 50; i++) {
      EXPECT_LT((read.positions[i] - f.positions[i]).norm(), 1e-7) << format;
      EXPECT_EQ(read.velocities[i], f.velocities[i]) << format;
      EXPECT_NEAR(read.volumes[i], f.volumes[i], 1e-6f * f.volumes[i]) << format;
    }
    ASSERT_EQ(read.attributes.size(), 3u) << format;
    for (const output::Attribute& a : read.attributes)
      for (const output::Attribute& b : f.attributes)
        if (a.name == b.name) {
          EXPECT_EQ(a.values, b.values) << format << " " << a.name;
        }
  }
}

TEST_F(Frames, HoldTheSurfacesOfBodies) {
  output::ParticleFrame f = frame();
  output::BodyMesh mesh;
  mesh.body = 1;
  mesh.vertices = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
  mesh.piece = {0, 0, 0, 0};
  mesh.damage = {0, 0.25f, 0.5f, 1};
  mesh.pieces = 1;
  mesh.triangles = {0, 2, 1, 0, 1, 3};
  f.meshes = {mesh};
  for (const char* format : {"ply", "vtp"}) {
    output::Writer(directory, {}, false, nullptr, std::vector<std::string>{format}).frame(f);
    const output::ParticleFrame read = RunFrames(directory).load(
        4, [](const std::string&) { return true; }, 3);
    EXPECT_EQ(read.particles(), 0u);
    ASSERT_EQ(read.meshes.size(), 1u) << format;
    EXPECT_EQ(read.meshes[0].body, 1);
    EXPECT_EQ(read.meshes[0].vertices, mesh.vertices);
    EXPECT_EQ(read.meshes[0].damage, mesh.damage);
    EXPECT_EQ(read.meshes[0].triangles, mesh.triangles);
    EXPECT_EQ(read.bodies.at(1), "right");  // of bodies without a surface the file may not say the names
    fs::remove_all(directory / "meshes");
  }
}

TEST_F(Frames, AreRefusedByNameWhenTheyAreDamaged) {
  for (const char* format : {"vdb", "vtp", "ply"}) {
    const fs::path run = directory / format;
    output::Writer(run, {format}, false).frame(frame());
    const RunFrames frames(run);
    fs::path file;
    for (const auto& entry : fs::recursive_directory_iterator(run))
      if (entry.path().filename().string().starts_with("frame_0004")) file = entry.path();
    const auto whole = fs::file_size(file);
    for (const auto size : {whole * 3 / 4, whole / 3, std::uintmax_t(10), std::uintmax_t(0)}) {
      fs::resize_file(file, size);
      try {
        frames.load(
            4, [](const std::string&) { return true; }, 3);
        ADD_FAILURE() << format << " cut to " << size;
      } catch (const InputError& e) {
        EXPECT_NE(std::string(e.what()).find(file.string()), std::string::npos) << e.what();
      }
    }
  }
  EXPECT_THROW(RunFrames(directory / "none"), InputError);
  EXPECT_THROW(RunFrames{directory}, InputError);
}

}  // namespace
}  // namespace cleave::render
