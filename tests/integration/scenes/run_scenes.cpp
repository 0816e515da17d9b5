// `cleave run` from outside: every shipped scene steps, and every way a run can end has its exit status and its files.

#include "program.hpp"

#include <algorithm>
#include <cmath>

namespace cleave::test {
namespace {

const fs::path scenes = fs::path(CLEAVE_SOURCE_DIR) / "configs/scenes";

class ShippedScene : public Program, public testing::WithParamInterface<std::string> {};

TEST_P(ShippedScene, StepsAndWritesWhatItPromises) {
  const fs::path scene = scenes / (GetParam() + ".toml");
  const Outcome run = cleave("run '" + scene.string() + "' --out run --steps 12 --threads 2");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto summary = json(directory / "run/summary.json");
  EXPECT_EQ(summary.get<std::string>("status"), "done");
  EXPECT_EQ(summary.get<int>("steps"), 12);
  EXPECT_EQ(summary.get<int>("threads"), 2);
  EXPECT_GT(summary.get<int>("particles"), 1000);
  EXPECT_GT(summary.get_child("plugins").size(), 0u);
  int steps = 0;
  for (const auto& [integrator, taken] : summary.get_child("integrators")) steps += taken.get_value<int>();
  const bool discretized = contents(scene).find("discretization") != std::string::npos;
  EXPECT_EQ(steps, discretized ? 0 : 12) << "plugins that step bodies have integrators of their own";
  const auto frames = table(directory / "run/frames.csv");
  ASSERT_GE(frames.at("frame").size(), 2u);
  for (const auto& [name, cells] : frames) {
    if (name == "limited_by") continue;
    for (double x : numbers(cells)) EXPECT_TRUE(std::isfinite(x)) << name;
  }
  // the resolved scene runs again, to the same numbers
  const Outcome again = cleave("run run/scene.toml --out again --steps 12 --quiet");
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(table(directory / "again/frames.csv").at("kinetic_energy"), frames.at("kinetic_energy"));
}

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(scenes))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}
INSTANTIATE_TEST_SUITE_P(All, ShippedScene, testing::ValuesIn(scene_names()), [](const auto& info) { return info.param; });

constexpr const char* small_scene = R"(
[simulation]
dimension = 2
cell_size = 0.1
end_time = 0.5
frame_rate = 20
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
formats = ["vtp", "ply", "vdb"]
)";

class Run : public Program {};

TEST_F(Run, WritesTheFramesAsked) {
  write("scene.toml", small_scene);
  const Outcome run = cleave("run scene.toml --frames 3");
  ASSERT_EQ(run.status, 0) << run.err;
  for (const char* file : {"vtp/frame_0000.vtp", "vtp/frame_0003.vtp", "ply/frame_0003.ply", "points/frame_0003.vdb",
                           "particles.pvd", "frames.csv", "summary.json", "scene.toml"})
    EXPECT_TRUE(fs::exists(directory / "out/scene" / file)) << file;
  EXPECT_FALSE(fs::exists(directory / "out/scene/vtp/frame_0004.vtp"));
  const auto time = numbers(table(directory / "out/scene/frames.csv").at("time"));
  ASSERT_EQ(time.size(), 4u);
  for (std::size_t i = 0; i < time.size(); i++) EXPECT_NEAR(time[i], double(i) / 20, 1e-12);
  EXPECT_NE(run.out.find("bytes per particle"), std::string::npos);
}

TEST_F(Run, FramesDoNotForceTinySteps) {
  write("scene.toml", small_scene);
  ASSERT_EQ(cleave("run scene.toml --quiet").status, 0);
  const auto frames = table(directory / "out/scene/frames.csv");
  const auto steps = numbers(frames.at("steps")), last = numbers(frames.at("time_step"));
  for (std::size_t i = 1; i < steps.size(); i++) EXPECT_GT(last[i], 0.5 * 0.05 / steps[i]) << "frame " << i;
}

TEST_F(Run, OverridesChangeTheScene) {
  write("scene.toml", small_scene);
  const Outcome run = cleave("run scene.toml --steps 1 --set simulation.precision=double --set material.rubber.density=500");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_EQ(json(directory / "out/scene/summary.json").get<std::string>("precision"), "double");
  EXPECT_NEAR(numbers(table(directory / "out/scene/frames.csv").at("mass"))[0], 0.36 * 500, 1);
}

TEST_F(Run, BadInputEndsWithStatusTwoAndThePlace) {
  write("scene.toml", std::string(small_scene) + "surfaces = true\n");
  const Outcome run = cleave("run scene.toml");
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.err.find("scene.toml:20:1: error: "), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("did you mean 'surface'"), std::string::npos) << run.err;
  EXPECT_FALSE(fs::exists(directory / "out")) << "nothing is written for a scene that cannot run";
  EXPECT_EQ(cleave("run missing.toml").status, 2);
  EXPECT_EQ(cleave("run").status, 2);
  EXPECT_EQ(cleave("fly scene.toml").status, 2);
}

TEST_F(Run, FailureNamesStepParticleAndPluginAndKeepsTheState) {
  // a step twenty times too large tears the block apart
  write("scene.toml", small_scene);
  const Outcome run = cleave("run scene.toml --set simulation.time_step=0.05 --set simulation.gravity=[0,-200]");
  EXPECT_EQ(run.status, 3) << run.out << run.err;
  EXPECT_NE(run.err.find("step "), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("particle "), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("body 'block'"), std::string::npos) << run.err;
  const auto state = table(directory / "out/scene/failed_state.csv");
  ASSERT_TRUE(state.contains("x")) << "the failed state is a particle file";
  EXPECT_EQ(state.at("x").size(), 144u);
  EXPECT_EQ(json(directory / "out/scene/summary.json").get<std::string>("status"), "failed");
  EXPECT_TRUE(fs::exists(directory / "out/scene/vtp/frame_0000.vtp")) << "frames before the failure stay";
}

TEST_F(Run, InterruptEndsTheRunInOrder) {
  write("scene.toml", small_scene);
  // timeout sends the signal twice: to the program and to its group
  const Outcome run = cleave("run scene.toml --set simulation.end_time=1000", "timeout --preserve-status --signal=INT 3");
  EXPECT_EQ(run.status, 130) << run.err;
  EXPECT_EQ(json(directory / "out/scene/summary.json").get<std::string>("status"), "interrupted");
}

TEST_F(Run, ForcedInstructionSetsAgree) {
  write("scene.toml", small_scene);
  std::map<std::string, std::vector<double>> energies;
  for (const char* isa : {"x86-64-v2", "x86-64-v3", "x86-64-v4"}) {
    const Outcome run = cleave("run scene.toml --quiet --frames 4 --out " + std::string(isa), std::string("CLEAVE_ISA=") + isa);
    if (run.status == 2 && run.err.find("this processor") != std::string::npos) continue;
    ASSERT_EQ(run.status, 0) << run.err;
    energies[isa] = numbers(table(directory / isa / "frames.csv").at("kinetic_energy"));
  }
  ASSERT_FALSE(energies.empty());
  for (const auto& [isa, energy] : energies)
    for (std::size_t i = 0; i < energy.size(); i++)
      EXPECT_NEAR(energy[i], energies.begin()->second[i], 2e-3 * (1 + energy[i])) << isa;  // fused multiply-adds round apart
}

TEST_F(Run, TwoMaterialsAreStoredApartAndMeetOnTheGrid) {
  // equal bodies of two laws that agree for small strain: pushed together, each gives the other its momentum
  write("scene.toml", R"(
[simulation]
dimension = 2
cell_size = 0.05
end_time = 2.0
frame_rate = 10
precision = "double"
[[material]]
name = "a"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e4, poissons_ratio = 0.3 }
[[material]]
name = "b"
density = 1000
elasticity = { plugin = "fixed-corotated", youngs_modulus = 1e4, poissons_ratio = 0.3 }
[[body]]
name = "left"
material = "a"
sampling = "regular"
shape = { type = "box", center = [-0.5, 0], size = [0.5, 0.5] }
velocity = [0.2, 0]
[[body]]
name = "right"
material = "b"
sampling = "regular"
shape = { type = "box", center = [0.5, 0], size = [0.5, 0.5] }
velocity = [-0.2, 0]
[output]
formats = ["ply"]
)");
  ASSERT_EQ(cleave("run scene.toml --quiet").status, 0);
  const auto frames = table(directory / "out/scene/frames.csv");
  const auto momentum = numbers(frames.at("momentum_x")), kinetic = numbers(frames.at("kinetic_energy")),
             elastic = numbers(frames.at("elastic_energy"));
  for (double p : momentum) EXPECT_NEAR(p, 0, 1e-9);
  EXPECT_LT(*std::min_element(kinetic.begin(), kinetic.end()), 0.7 * kinetic[0]);
  EXPECT_GT(*std::max_element(elastic.begin(), elastic.end()), 0.1 * kinetic[0]);
  EXPECT_GT(kinetic.back(), 0.5 * kinetic[0]);
}

}  // namespace
}  // namespace cleave::test
