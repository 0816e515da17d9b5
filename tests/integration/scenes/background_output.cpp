// Frames are written while the simulation goes on. Nothing that can be read afterwards may tell.

#include "program.hpp"

#include <algorithm>
#include <cstdio>

namespace cleave::test {
namespace {

constexpr const char* scene = R"(
[simulation]
dimension = 2
cell_size = 0.05
end_time = 0.3
frame_rate = 40
gravity = [0, -9.81]
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "rubber"
shape = { type = "box", center = [0, 0.5], size = [0.6, 0.6] }
[[collider]]
shape = { type = "half-space", point = [0, 0], normal = [0, 1] }
[output]
formats = ["vtp", "ply"]
)";

class BackgroundOutput : public Program {
 protected:
  BackgroundOutput() { write("scene.toml", scene); }
  std::map<std::string, std::string> files(const std::string& run) const {
    std::map<std::string, std::string> found;
    for (const auto& entry : fs::recursive_directory_iterator(directory / run))
      if (entry.is_regular_file() && entry.path().extension() != ".checkpoint")  // these hold times and threads
        found[fs::relative(entry.path(), directory / run).string()] = contents(entry.path());
    return found;
  }
  std::map<std::string, double> stages(const std::string& run) const {
    std::map<std::string, double> seconds;
    const auto summary = json(directory / run / "summary.json");
    for (const auto& [name, value] : summary.get_child("stage_seconds")) seconds[name] = value.get_value<double>();
    return seconds;
  }
};

TEST_F(BackgroundOutput, GivesTheFilesOfTheForeground) {
  for (const char* threads : {"1", "2"})
    ASSERT_EQ(cleave(std::string("run scene.toml --quiet --threads ") + threads + " --out " + threads).status, 0);
  auto in_foreground = files("1"), in_background = files("2");
  for (auto* found : {&in_foreground, &in_background}) {
    found->erase("summary.json");
    found->erase("frames.csv");
  }
  EXPECT_EQ(in_foreground, in_background);
  EXPECT_EQ(in_foreground.size(), 2u * 13 + 2);
  auto rows = table(directory / "1/frames.csv"), rows_in_background = table(directory / "2/frames.csv");
  const auto seconds = numbers(rows_in_background.at("wall_seconds"));
  EXPECT_TRUE(std::is_sorted(seconds.begin(), seconds.end()));
  rows.erase("wall_seconds");
  rows_in_background.erase("wall_seconds");
  EXPECT_EQ(rows, rows_in_background);
  EXPECT_EQ(json(directory / "2/summary.json").get<int>("frames"), 13);
  EXPECT_GT(stages("2").at("output in the background"), 0);
  EXPECT_FALSE(stages("1").contains("output in the background")) << "one thread does one thing at a time";
}

TEST_F(BackgroundOutput, AFailedRunHasAllFramesBeforeAndItsLastState) {
  const Outcome run = cleave(
      "run scene.toml --threads 2 --out run --set simulation.time_step=0.0125 --set simulation.gravity=[0,-500] "
      "--set simulation.end_time=3");
  ASSERT_EQ(run.status, 3) << run.err;
  const auto summary = json(directory / "run/summary.json");
  const auto rows = table(directory / "run/frames.csv").at("frame");
  EXPECT_EQ(summary.get<std::string>("status"), "failed");
  EXPECT_EQ(summary.get<std::size_t>("frames"), rows.size());
  std::size_t frames = 0;
  for (const auto& [name, text] : files("run")) {
    EXPECT_FALSE(name.ends_with(".partial")) << name;
    frames += name.ends_with(".ply");
  }
  EXPECT_EQ(frames, rows.size());
  EXPECT_TRUE(fs::exists(directory / "run/failed_state.csv"));
}

TEST_F(BackgroundOutput, AFullDiskEndsTheRunWithTheFilesName) {
  for (const char* threads : {"1", "2"}) {
    // the largest file is to be 16 KiB, in units of 512 bytes
    const Outcome run = cleave(std::string("run scene.toml --out run --threads ") + threads, "trap '' XFSZ; ulimit -f 32;");
    EXPECT_EQ(run.status, 2) << run.err;
    EXPECT_NE(run.err.find("cannot write run/vtp/frame_0000.vtp: File too large"), std::string::npos) << run.err;
    EXPECT_EQ(table(directory / "run/frames.csv").size(), 0u) << "no row of a frame that is not there";
  }
}

TEST_F(BackgroundOutput, AnInterruptedRunHasItsLastFrame) {
  const Outcome run =
      cleave("run scene.toml --threads 2 --out run --set simulation.end_time=1000", "timeout --preserve-status --signal=INT 2");
  ASSERT_EQ(run.status, 130) << run.err;
  const auto rows = table(directory / "run/frames.csv").at("frame");
  EXPECT_EQ(json(directory / "run/summary.json").get<std::size_t>("frames"), rows.size());
  char name[32];
  std::snprintf(name, sizeof name, "frame_%04zu", rows.size() - 1);
  EXPECT_TRUE(fs::exists(directory / "run/ply" / (std::string(name) + ".ply")));
  EXPECT_NE(contents(directory / "run/particles.pvd").find(name), std::string::npos);
}

}  // namespace
}  // namespace cleave::test
