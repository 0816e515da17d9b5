#include "common/error.hpp"
#include "fake_catalog.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cleave::config {
namespace {

using ::testing::ElementsAre;

const std::filesystem::path folder = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/good";

Scene with(const std::vector<std::string>& sets, const std::string& name = "minimal.toml") {
  std::vector<Override> overrides;
  for (const std::string& set : sets) overrides.push_back(parse_override(set));
  return load_scene(folder / name, overrides, testing::FakeCatalog());
}

std::string refusal(const std::string& set) {
  try {
    with({set});
  } catch (const InputError& error) {
    return error.what();
  }
  return "was accepted";
}

TEST(Override, SplitsAtTheFirstEqualsSign) {
  const Override given = parse_override("body.0.shape.file=a=b.obj");
  EXPECT_EQ(given.path, "body.0.shape.file");
  EXPECT_EQ(given.value, "a=b.obj");
}

TEST(Override, WithoutPathOrValueIsRefused) {
  for (const char* text : {"cell_size", "=1", "simulation.=1", ".cell_size=1", ""})
    EXPECT_THROW(parse_override(text), InputError) << text;
}

TEST(Override, ReplacesAValueByIndexOrName) {
  EXPECT_EQ(with({"simulation.cell_size=0.25"}).simulation.cell_size, 0.25);
  EXPECT_EQ(with({"material.0.density=12"}).materials[0].density, 12);
  EXPECT_EQ(with({"material.jelly.density=13"}).materials[0].density, 13);
  EXPECT_EQ(std::get<double>(
                with({"material.jelly.elasticity.youngs_modulus=7"}).materials[0].elasticity.parameters.at("youngs_modulus")),
            7);
  EXPECT_EQ(with({"body.0.shape.radius=0.75"}).bodies[0].shape->radius, 0.75);
  EXPECT_EQ(with({"simulation.gravity.1=-1.5"}, "everything_3d.toml").simulation.gravity, Vector3(0.1, -1.5, 0.2));
}

TEST(Override, AddsAKeyTheSchemaAllows) {
  EXPECT_EQ(with({"simulation.gravity=[0, -9.81, 0]"}).simulation.gravity, Vector3(0, -9.81, 0));
  EXPECT_TRUE(with({"output.surface=true"}).output.surface);
  EXPECT_EQ(with({"body.ball.spin.angular_velocity=[0, 0, 0]"}).bodies[0].spin.angular_velocity, Vector3::Zero());
}

TEST(Override, TakesBareWordsAsText) {
  EXPECT_EQ(with({"simulation.precision=double"}).simulation.precision, Precision::double_precision);
  EXPECT_EQ(with({"simulation.precision=\"double\""}).simulation.precision, Precision::double_precision);
  EXPECT_EQ(with({"body.0.sampling=blue-noise"}).bodies[0].sampling.pattern, scene::SamplingPattern::blue_noise);
}

TEST(Override, ReplacesWholeTables) {
  EXPECT_EQ(with({"body.0.shape={ type = \"box\", size = [1, 2, 3] }"}).bodies[0].shape->size, Vector3(1, 2, 3));
}

TEST(Override, TheLastOneWins) { EXPECT_EQ(with({"simulation.cfl=0.1", "simulation.cfl=0.2"}).simulation.cfl, 0.2); }

TEST(OverrideError, NamesTheOverride) {
  EXPECT_EQ(refusal("material.jely.density=3"),
            "--set material.jely.density: error: no material named 'jely', did you mean 'jelly'?");
  EXPECT_EQ(refusal("material.2.density=3"), "--set material.2.density: error: 'material' has only the elements 0 to 0");
  EXPECT_EQ(refusal("simulation.cell_siz=3"),
            "--set simulation.cell_siz: error: unknown key 'cell_siz' in [simulation], did you mean 'cell_size'?");
  EXPECT_EQ(refusal("simulaton.cell_size=3"),
            "--set simulaton.cell_size: error: unknown key 'simulaton' in the scene, did you mean 'simulation'?");
  EXPECT_EQ(refusal("simulation.cell_size.x=3"),
            "--set simulation.cell_size.x: error: 'cell_size' is 0.1, it has nothing named 'x'");
  EXPECT_EQ(refusal("simulation.cell_size=-1"),
            "--set simulation.cell_size: error: 'cell_size' must be greater than 0 m, is -1");
  EXPECT_EQ(refusal("simulation.cell_size=small"),
            "--set simulation.cell_size: error: 'cell_size' must be a number (m), is the text \"small\"");
  EXPECT_EQ(refusal("simulation.cell_size=1\nend_time = 2"), "--set simulation.cell_size: error: takes one value");
  EXPECT_THAT(refusal("simulation.gravity=[0, 1"),
              ::testing::StartsWith("--set simulation.gravity: error: the value is not TOML: "));
}

}  // namespace
}  // namespace cleave::config
