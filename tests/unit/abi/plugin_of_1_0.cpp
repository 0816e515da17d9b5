// A plugin built against the headers of ABI 1.0 is found, computes, conforms and runs in a scene.
#include "law_driver.hpp"

#include <cleave/testkit/runner.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace cleave::plugins::test {
namespace {

namespace fs = std::filesystem;
constexpr const char* id = "elasticity/built-for-1-0";
constexpr double mu = 4e4, lambda = 7e4;

Registry registry() { return Registry({CLEAVE_FIXTURE_DIR}); }

TEST(PluginOf10, IsFoundWithAllItSaysOfItself) {
  const auto r = registry();
  ASSERT_EQ(r.found().size(), 1u);
  EXPECT_EQ(r.found()[0].refusal, "");
  const Description* description = r.find(id);
  ASSERT_NE(description, nullptr);
  EXPECT_EQ(description->abi_major, 1u);
  EXPECT_EQ(description->abi_minor, 0u);
  EXPECT_EQ(description->parameters.size(), 2u);
  EXPECT_EQ(description->source, "Bonet & Wood 2008, eq. 6.27");
  EXPECT_TRUE(description->can(CLEAVE_HAS_WAVE_MODULUS));
}

template <class S>
void expect_closed_forms() {
  auto r = registry();
  const Instance law(r.load(id), {{"shear_modulus", mu}, {"lame_parameter", lambda}}, {});
  const double stretch = 1.3, ln_J = std::log(stretch), g = 0.25, accuracy = sizeof(S) == 4 ? 1e-6 : 1e-14;
  LawDriver<S> driver(Placement::scattered);
  driver.input(CLEAVE_FIELD_B, {{stretch * stretch, 1, 1, 0, 0, 0}, {1, 1, 1, 0, 0, 0}})
      .constant(CLEAVE_FIELD_DEGRADATION, {g})
      .output(CLEAVE_FIELD_TAU, 6)
      .output(CLEAVE_FIELD_ENERGY, 1)
      .output(CLEAVE_FIELD_TENSILE_ENERGY, 1);
  ASSERT_EQ(driver.run(evaluate<S>(law), law.handle(), 37), CLEAVE_OK);
  const double psi = mu / 2 * (stretch * stretch - 1 - 2 * ln_J) + lambda / 2 * ln_J * ln_J;
  for (std::uint32_t k = 0; k < 37; k += 2) {
    EXPECT_NEAR(driver.value(CLEAVE_FIELD_TAU, k)[0], g * (mu * (stretch * stretch - 1) + lambda * ln_J), accuracy * mu);
    EXPECT_NEAR(driver.value(CLEAVE_FIELD_TAU, k)[1], g * lambda * ln_J, accuracy * mu);
    EXPECT_NEAR(driver.value(CLEAVE_FIELD_ENERGY, k)[0], g * psi, accuracy * mu);
    EXPECT_NEAR(driver.value(CLEAVE_FIELD_TENSILE_ENERGY, k)[0], psi, accuracy * mu);
  }
  for (std::uint32_t k = 1; k < 37; k += 2)
    for (double component : driver.value(CLEAVE_FIELD_TAU, k)) EXPECT_EQ(component, 0) << "at rest";
}

TEST(PluginOf10, ComputesItsClosedForms) {
  expect_closed_forms<float>();
  expect_closed_forms<double>();
}

TEST(PluginOf10, Conforms) {
  testkit::Options options;
  options.library = CLEAVE_FIXTURE_DIR "/built_for_1_0.so";
  const auto report = testkit::run_checks(options);
  EXPECT_TRUE(report.passed()) << testkit::to_table(report);
}

TEST(PluginOf10, RunsInAScene) {
  std::string name = (fs::temp_directory_path() / "cleave-abi-XXXXXX").string();
  const fs::path directory = mkdtemp(name.data());
  std::ofstream(directory / "scene.toml") << R"([simulation]
cell_size = 0.1
end_time = 0.1
gravity = [0, -9.81, 0]
[[material]]
name = "solid"
density = 1000
elasticity = { plugin = "built-for-1-0", shear_modulus = 1e5, lame_parameter = 1e5 }
[[body]]
name = "block"
material = "solid"
shape = { type = "box", center = [0, 0.2, 0], size = [0.4, 0.4, 0.4] }
[[collider]]
shape = { type = "half-space", normal = [0, 1, 0] }
)";
  const std::string command = "cd '" + directory.string() +
                              "' && CLEAVE_PLUGIN_PATH='" CLEAVE_FIXTURE_DIR "' '" CLEAVE_PROGRAM
                              "' run scene.toml --out out --quiet >log.txt 2>&1";
  const int status = std::system(command.c_str());
  std::stringstream log, summary;
  log << std::ifstream(directory / "log.txt").rdbuf();
  summary << std::ifstream(directory / "out/summary.json").rdbuf();
  fs::remove_all(directory);
  EXPECT_EQ(status, 0) << log.str();
  EXPECT_NE(summary.str().find(id), std::string::npos) << summary.str();
}

}  // namespace
}  // namespace cleave::plugins::test
