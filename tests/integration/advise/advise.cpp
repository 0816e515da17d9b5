// `cleave advise`: each advice where a scene gives reason for it, none where it does not, and what following one brings.

#include "program.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace cleave::test {
namespace {

/// A block of rubber that falls 5 mm onto the floor: strains of some per cent, which breaks and moulds nothing strong.
constexpr const char* scene = R"toml(
[simulation]
cell_size = 0.02
end_time = 0.1
gravity = [0, 0, -9.81]
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "rubber"
sampling = "regular"
shape = { type = "box", center = [0, 0, 0.055], size = [0.1, 0.1, 0.1] }
[[collider]]
name = "floor"
shape = { type = "half-space", normal = [0, 0, 1] }
[output]
formats = []
)toml";

class Advise : public Program {
 protected:
  Advise() { write("scene.toml", scene); }

  nlohmann::json advised(const std::string& options = "") const {
    const Outcome run = cleave("advise scene.toml --json " + options);
    EXPECT_EQ(run.status, 0) << run.err;
    return nlohmann::json::parse(run.out);
  }

  /// The advice of these words; null if it is not given.
  static nlohmann::json find(const nlohmann::json& all, const std::string& what) {
    for (const auto& advice : all.at("advice"))
      if (advice.at("what").get<std::string>().find(what) != std::string::npos) return advice;
    return nullptr;
  }

  static std::string set_of(const nlohmann::json& advice) {
    std::string options;
    for (const auto& set : advice.at("set")) options += " --set '" + set.get<std::string>() + "'";
    return options;
  }

  std::string with(const std::string& text, const std::string& before, const std::string& addition) const {
    std::string changed = text;
    return changed.insert(changed.find(before), addition);
  }
};

TEST_F(Advise, LeavesASceneAloneThatIsRight) {
  const auto all = advised();
  EXPECT_TRUE(all.at("advice").empty()) << all;
  EXPECT_EQ(all.at("forecast").at("particles"), 1000);
  EXPECT_EQ(all.at("forecast").at("bound"), "elastic wave");
  EXPECT_EQ(cleave("advise scene.toml").out.find("nothing to advise") == std::string::npos, false);
}

TEST_F(Advise, StepsThatAreShorterThanTheyNeedToBe) {
  const auto fixed = find(advised("--set simulation.time_step=1e-4"), "take automatic steps");
  ASSERT_FALSE(fixed.is_null());
  // dx/c of a pressure wave in rubber, times cfl
  const double bound = 0.4 * 0.02 / std::sqrt(1e5 * 0.7 / (1.3 * 0.4) / 1000);
  EXPECT_NEAR(fixed.at("speedup").get<double>(), bound / 1e-4, 0.2 * bound / 1e-4);
  EXPECT_TRUE(find(advised("--set simulation.time_step=6e-4"), "take automatic steps").is_null());
  EXPECT_FALSE(find(advised("--set simulation.maximum_time_step=1e-4"), "let steps be").is_null());
  EXPECT_TRUE(find(advised("--set simulation.maximum_time_step=1e-2"), "let steps be").is_null());
  const auto careful = find(advised("--set simulation.cfl=0.1"), "cfl");
  ASSERT_FALSE(careful.is_null());
  EXPECT_DOUBLE_EQ(careful.at("speedup").get<double>(), 4);
}

TEST_F(Advise, FollowedSavesTheStepsItPromisesAndKeepsTheMotion) {
  const std::string given = " --set simulation.time_step=1e-4";
  const auto advice = find(advised(given), "take automatic steps");
  ASSERT_FALSE(advice.is_null());
  ASSERT_EQ(cleave("run scene.toml --out before" + given).status, 0);
  const Outcome after = cleave("run scene.toml --out after" + given + set_of(advice));
  ASSERT_EQ(after.status, 0) << after.err;
  const double before_steps = json(directory / "before/summary.json").get<double>("steps"),
               after_steps = json(directory / "after/summary.json").get<double>("steps");
  EXPECT_NEAR(before_steps / after_steps, advice.at("speedup").get<double>(), 0.25 * before_steps / after_steps);
  const auto z = [&](const char* run) { return numbers(table(directory / run / "frames.csv").at("center_of_mass_z")).back(); };
  EXPECT_NEAR(z("before"), z("after"), 1e-3) << "of 0.055 m";
}

TEST_F(Advise, LawsThatTheSceneCannotReach) {
  const auto write_law = [&](const std::string& laws) { write("scene.toml", with(scene, "[[body]]", laws + "\n")); };
  write_law("plasticity = { plugin = \"von-mises\", yield_stress = 1e6 }");
  const auto stiff = find(advised(), "leave out plasticity/von-mises");
  ASSERT_FALSE(stiff.is_null());
  EXPECT_EQ(stiff.at("remove")[0], "material.rubber.plasticity");
  EXPECT_GT(stiff.at("speedup").get<double>(), 1) << "recorded costs";
  write_law("plasticity = { plugin = \"von-mises\", yield_stress = 300 }");
  EXPECT_TRUE(find(advised(), "leave out").is_null());
  write_law("damage = { plugin = \"rankine\", failure_stress = 1e6, softening = 0.1 }");
  EXPECT_FALSE(find(advised(), "leave out damage/rankine").is_null());
  write_law("damage = { plugin = \"rankine\", failure_stress = 300, softening = 0.1 }");
  EXPECT_TRUE(find(advised(), "leave out").is_null());
}

TEST_F(Advise, PrecisionByWhatStrainsLose) {
  // 1e-6 of the strain of a block under its weight is less than what single precision resolves
  const std::string stiff = "--set material.rubber.elasticity.youngs_modulus=1e11";
  EXPECT_FALSE(find(advised(stiff), "double precision").is_null());
  EXPECT_TRUE(find(advised(stiff + " --set simulation.precision=double"), "single precision").is_null());
  EXPECT_FALSE(find(advised("--set simulation.precision=double"), "single precision").is_null());
}

TEST_F(Advise, ParticlesAndCells) {
  const auto many = find(advised("--set body.block.particles_per_cell=64"), "8 particles per cell");
  ASSERT_FALSE(many.is_null());
  EXPECT_DOUBLE_EQ(many.at("speedup").get<double>(), 8);
  EXPECT_EQ(many.at("set")[0], "body.block.particles_per_cell=8");
  EXPECT_FALSE(find(advised("--set body.block.particles_per_cell=1"), "8 particles per cell").is_null());
  EXPECT_FALSE(find(advised("--set simulation.cell_size=0.05"), "smaller cells, if body block bends").is_null());
}

TEST_F(Advise, TwoDimensionsWhereNothingChangesAlongTheThird) {
  std::string text = scene;
  text.replace(text.find("[0, 0, -9.81]"), 13, "[0, -9.81, 0]");
  text.replace(text.find("[0, 0, 0.055], size = [0.1, 0.1, 0.1]"), 37, "[0, 0.055, 0], size = [0.1, 0.1, 0.4]");
  text.replace(text.find("normal = [0, 0, 1]"), 18, "normal = [0, 1, 0]");
  write("scene.toml", text);
  const auto flat = find(advised(), "two dimensions");
  ASSERT_FALSE(flat.is_null());
  EXPECT_EQ(cleave("validate scene.toml" + set_of(flat)).status, 0);
  EXPECT_TRUE(find(advised("--set body.block.shape.size.2=0.2"), "two dimensions").is_null()) << "too short";
  EXPECT_TRUE(find(advised("--set simulation.gravity.2=1"), "two dimensions").is_null());
  EXPECT_TRUE(find(advised("--set body.block.shape.rotate='{ axis = [1, 0, 0], angle = 5 }'"), "two dimensions").is_null());
}

TEST_F(Advise, WhatNothingTouchesAndNothingIsMadeOf) {
  write("scene.toml", std::string(scene) + R"toml(
[[collider]]
name = "far wall"
shape = { type = "half-space", point = [5, 0, 0], normal = [-1, 0, 0] }
[[material]]
name = "steel"
density = 8000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e11, poissons_ratio = 0.3 }
)toml");
  const auto all = advised();
  EXPECT_FALSE(find(all, "remove collider far wall").is_null()) << all;
  EXPECT_TRUE(find(all, "remove collider floor").is_null());
  EXPECT_FALSE(find(all, "remove material steel").is_null());
  EXPECT_TRUE(find(advised("--set body.block.velocity=[50,0,0]"), "far wall").is_null());
}

TEST_F(Advise, LengthsOfDamageAgainstCells) {
  write("scene.toml",
        with(scene, "[[body]]", "damage = { plugin = \"phase-field\", strength = 100, length_scale = 0.005, mobility = 1 }\n"));
  // l = 2 l0 = 0.01 m is half a cell
  const auto finer = find(advised(), "take smaller cells");
  ASSERT_FALSE(finer.is_null());
  EXPECT_EQ(finer.at("set")[0], "simulation.cell_size=0.005");
  EXPECT_TRUE(find(advised("--set simulation.cell_size=0.005"), "cells").is_null());
  // 10 cells of l, in a block 20 cells thick, of which 8 stay: the innermost particles are a quarter of a cell off the middle
  const auto coarser =
      find(advised("--set simulation.cell_size=0.005 --set material.rubber.damage.length_scale=0.025"), "take larger cells");
  ASSERT_FALSE(coarser.is_null());
  EXPECT_EQ(coarser.at("set")[0], "simulation.cell_size=0.0122");
  EXPECT_NEAR(coarser.at("speedup").get<double>(), std::pow(0.0975 / 8 / 0.005, 4), 1e-2);
}

TEST_F(Advise, LengthsOfDamageThatFollowTheCells) {
  write("scene.toml", with(scene, "[[body]]", "damage = { plugin = \"phase-field\", strength = 100, mobility = 1 }\n"));
  const auto fixed = find(advised(), "give damage a length in metres");
  ASSERT_FALSE(fixed.is_null());
  EXPECT_EQ(fixed.at("set")[0], "material.rubber.damage.length_scale=0.02") << "l = 2 l0, two cells of 0.02 m";
  EXPECT_TRUE(find(advised(set_of(fixed)), "cells").is_null());
  const auto wide = find(advised("--set material.rubber.damage.length_scale_cells=0.75"), "give damage a length in metres");
  ASSERT_FALSE(wide.is_null());
  EXPECT_TRUE(wide.at("set").empty()) << "not beside the other one";
  EXPECT_TRUE(find(advised("--set material.rubber.damage.length_scale_cells=1"), "cells").is_null());
}

TEST_F(Advise, IntegratorsByWhatTheirStepsCost) {
  // steps of the same length: of frames
  const std::string implicit = "--set simulation.integrator=implicit ",
                    soft = "--set material.rubber.elasticity.youngs_modulus=1e4 ";
  const auto cheaper = find(advised(implicit + soft + "--set simulation.frame_rate=600"), "take symplectic steps");
  ASSERT_FALSE(cheaper.is_null());
  // 1 + 2 evaluations at 1.3 + a product at 1.1, docs/implicit.md; steps of 1.7 ms, and 2.2 ms as elastic waves allow
  EXPECT_NEAR(cheaper.at("speedup").get<double>(), 4.7, 0.01);
  const std::string stiff = "--set material.rubber.elasticity.youngs_modulus=1e11 ";
  EXPECT_TRUE(find(advised(implicit + stiff), "take symplectic steps").is_null());
  const auto longer = find(advised(stiff), "choose the integrator");
  ASSERT_FALSE(longer.is_null());
  EXPECT_EQ(longer.at("set")[0], "simulation.integrator=auto");
  EXPECT_TRUE(find(advised(stiff + "--set simulation.maximum_time_step=1e-5"), "choose the integrator").is_null());
}

TEST_F(Advise, DamageThatBoundsTheSteps) {
  const std::string law = "damage = { plugin = \"anisotropic\", critical_stress = 100, viscosity = ";
  const auto write_law = [&](const std::string& viscosity) {
    write("scene.toml", with(scene, "[[body]]", law + viscosity + ", length_scale = 0.04, structural_alpha = [] }\n"));
  };
  write_law("1e-3");
  const auto bounded = find(advised(), "integrate damage implicitly");
  ASSERT_FALSE(bounded.is_null());
  EXPECT_EQ(bounded.at("set")[0], "material.rubber.damage.integration=implicit");
  EXPECT_NE(advised(set_of(bounded)).at("forecast").at("bound"), "explicit damage");
  write_law("1");
  EXPECT_TRUE(find(advised(), "integrate damage").is_null());
}

TEST_F(Advise, FramesThatBoundTheSteps) {
  const auto fewer = find(advised("--set simulation.frame_rate=10000"), "write fewer frames");
  ASSERT_FALSE(fewer.is_null());
  const double bound = 0.4 * 0.02 / std::sqrt(1e5 * 0.7 / (1.3 * 0.4) / 1000);
  EXPECT_NEAR(fewer.at("speedup").get<double>(), 1e4 * bound, 0.2e4 * bound);
  EXPECT_TRUE(find(advised("--set simulation.frame_rate=1000"), "write fewer frames").is_null());
}

TEST_F(Advise, ScenesThatDoNotFitTheMachine) {
  const auto large = advised("--set simulation.cell_size=1e-6");
  EXPECT_FALSE(large.contains("forecast")) << "10^15 cells are not sampled";
  ASSERT_EQ(large.at("advice").size(), 1u);
  EXPECT_EQ(large.at("advice")[0].at("what"), "take larger cells");
}

/// Nothing but accuracy bounds the steps of implicit finite elements: what the scene sets is right.
TEST_F(Advise, LeavesStepsAloneThatOnlyAccuracyBounds) {
  write("scene.toml", contents(std::filesystem::path(CLEAVE_SCENES) / "fem_qr_recover.toml"));
  const auto all = advised();
  EXPECT_TRUE(all.at("advice").empty()) << all;
  EXPECT_EQ(all.at("forecast").at("bound"), "maximum");
}

TEST_F(Advise, TakesCostsThatTheUserRecorded) {
  write("scene.toml", with(scene, "[[body]]", "plasticity = { plugin = \"von-mises\", yield_stress = 1e6 }\n"));
  write("costs.json", R"json({"dimension": 3, "results": [
    {"laws": {"elasticity/split-neo-hookean": {}, "plasticity/von-mises": {}}, "precision": "single", "threads": 1, "fastest_ns": 3000},
    {"laws": {"elasticity/split-neo-hookean": {}}, "precision": "single", "threads": 2, "fastest_ns": 500}]})json");
  const auto advice = find(advised("--costs costs.json"), "leave out plasticity/von-mises");
  ASSERT_FALSE(advice.is_null());
  EXPECT_DOUBLE_EQ(advice.at("speedup").get<double>(), 3);
  write("costs.json", "{}");
  const Outcome wrong = cleave("advise scene.toml --costs costs.json");
  EXPECT_EQ(wrong.status, 2);
  EXPECT_NE(wrong.err.find("costs.json: error: is no record of `cleave bench steps --json`"), std::string::npos) << wrong.err;
}

}  // namespace
}  // namespace cleave::test
