// What methods cost beside each other (problem 25): the claims of the papers, on these implementations, as instructions, which
// other programs on the machine do not disturb. Laws in double precision with AVX2; steps in single precision.

#include "count.hpp"
#include "figure.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;
using instructions::count;
using instructions::Workload;

/// Why nothing is counted; empty if it is.
std::string obstacle() {
  if (!long_cases()) return "half a minute: CLEAVE_VERIFY_LONG=1";
  return instructions::obstacle();
}

double instructions_of(const std::string& law, int calls) {
  const fs::path file = fs::temp_directory_path() / fmt::format("cleave-law-calls-{}", getpid());
  const std::string command =
      fmt::format("CLEAVE_ISA=x86-64-v3 valgrind --tool=callgrind --callgrind-out-file='{}' '{}' {} {} >/dev/null 2>&1",
                  file.string(), CLEAVE_LAW_CALLS, law, calls);
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  std::ifstream profile(file);
  double total = 0;
  for (std::string line; std::getline(profile, line);)
    if (line.starts_with("totals:")) total = std::strtod(line.c_str() + 7, nullptr);
  fs::remove(file);
  return total;
}
/// Of a point.
double instructions_of(const std::string& law) {
  constexpr int calls = 40;
  const double each = (instructions_of(law, 1 + calls) - instructions_of(law, 1)) / (256 * calls);
  fmt::print("{}: {:.0f} instructions per point\n", law, each);
  return each;
}

TEST(CostOfLaws, IsLessInClosedForm) {
  if (const std::string reason = obstacle(); !reason.empty()) GTEST_SKIP() << reason;
  report({.row = 25,
          .problem = "stress of fixed corotated by singular values in lanes / of QR with a fiber",
          .quantity = "instructions per point",
          .reference = 3.4,
          .measured = instructions_of("elasticity/corotated-svd") / instructions_of("elasticity/qr"),
          .judged = Judged::at_least,
          .scatter = 0.1});
  report({.row = 25,
          .problem = "return of iterative Cam-Clay in lanes / of NACC",
          .quantity = "instructions per point",
          .reference = 2.33,
          .measured = instructions_of("plasticity/cohesive-cam-clay") / instructions_of("plasticity/nacc"),
          .judged = Judged::shown,
          .scatter = 0.1});
}

constexpr const char* intact =
    R"(material.m={ name = "m", density = 1000, elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 } })";

TEST(CostOfSteps, IsLittleOfDamage) {
  if (const std::string reason = obstacle(); !reason.empty()) GTEST_SKIP() << reason;
  const auto per_particle = [](const char* name, std::vector<std::string> sets) {
    const double each = count({name, "phase_field.toml", std::move(sets)}).per_particle();
    fmt::print("{}: {:.0f} instructions per particle and step\n", name, each);
    return each;
  };
  const double none = per_particle("no damage", {intact});
  const double implicit = per_particle("implicit damage", {}) - none;
  const double explicitly = per_particle("explicit damage", {"material.m.damage.integration=explicit"}) - none;
  const double backward_euler = per_particle("no damage, backward Euler", {intact, "simulation.integrator=implicit",
                                                                           "simulation.maximum_time_step=2.5e-4"}) -
                                none;
  const char* quantity = "instructions per particle and step";
  report({.row = 25,
          .problem = "implicit phase-field solve / backward-Euler solve of the motion in steps of the same length",
          .quantity = quantity,
          .reference = 0.5,
          .measured = implicit / backward_euler,
          .judged = Judged::at_most,
          .scatter = 0.1});
  report({.row = 25,
          .problem = "explicit damage / implicit damage",
          .quantity = quantity,
          .reference = 1,
          .measured = explicitly / implicit,
          .judged = Judged::at_most,
          .scatter = 0.1});
}

}  // namespace
}  // namespace cleave::test
