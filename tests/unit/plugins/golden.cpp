#include "../../reference_data.hpp"
#include "../../reference_table.hpp"
#include "law_driver.hpp"
#include "strains.hpp"

#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace cleave::plugins::test {
namespace {

/// Young's modulus 1000 Pa, Poisson's ratio 0.3.
constexpr double mu = 1000 / 2.6, lambda = 300 / (1.3 * 0.4);

struct Row {
  std::string name, variant;
  Tensor F, P, tau;
  double psi;
};

std::filesystem::path reference_file(const std::string& name) { return reference_data() / "golden" / name; }

std::vector<Row> read(const std::filesystem::path& file) {
  std::vector<Row> rows;
  for (const auto& row : read_reference_table(file)) {
    const auto matrix = [&](const std::string& prefix) {
      Tensor a;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) a(i, j) = std::stod(row.at(prefix + std::to_string(i) + std::to_string(j)));
      return a;
    };
    rows.push_back({row.at("case"), row.at("variant"), matrix("F"), matrix("P"), matrix("tau"), std::stod(row.at("psi"))});
  }
  return rows;
}

void expect_same(const Tensor& actual, const Tensor& expected, const std::string& what) {
  EXPECT_LE((actual - expected).cwiseAbs().maxCoeff(), 1e-9 * std::max(expected.cwiseAbs().maxCoeff(), 1e-3 * mu)) << what;
}

/// Compares psi, tau and P = tau F^-T of one row.
void compare(const Instance& law, const Row& row, double g) {
  LawDriver<double> driver;
  driver.input(CLEAVE_FIELD_F, {row_major(row.F)}).constant(CLEAVE_FIELD_DEGRADATION, {g});
  driver.output(CLEAVE_FIELD_ENERGY, 1).output(CLEAVE_FIELD_TAU, 6);
  ASSERT_EQ(driver.run(evaluate<double>(law), law.handle(), 1), CLEAVE_OK);
  const std::string what = row.name + " " + row.variant;
  if (std::isnan(row.psi)) {
    EXPECT_EQ(driver.status(0), CLEAVE_STATUS_FATAL) << what;
    return;
  }
  EXPECT_EQ(driver.status(0), CLEAVE_STATUS_OK) << what;
  EXPECT_NEAR(driver.value(CLEAVE_FIELD_ENERGY, 0)[0], row.psi, 1e-9 * std::max(std::abs(row.psi), 1e-3 * mu)) << what;
  const Tensor tau = tensor(driver.value(CLEAVE_FIELD_TAU, 0));
  expect_same(tau, row.tau, what + ": tau");
  expect_same(tau * row.F.transpose().inverse(), row.P, what + ": P");
}

TEST(GoldenValues, SplitNeoHookean) {
  const auto file = reference_file("neohookean_borden.csv");
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there; set CLEAVE_DATA_DIR";
  auto registry = built_plugins();
  // The reference takes 0.666666 for 2/3.
  const Instance law(registry.load("elasticity/split-neo-hookean"),
                     {{"shear_modulus", mu}, {"bulk_modulus", lambda + 0.666666 * mu}}, {});
  const auto rows = read(file);
  ASSERT_GE(rows.size(), 20u);
  for (const Row& row : rows) compare(law, row, std::stod(row.variant.substr(2)));
}

TEST(GoldenValues, FixedCorotated) {
  const auto file = reference_file("corotated.csv");
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there; set CLEAVE_DATA_DIR";
  auto registry = built_plugins();
  const Instance law(registry.load("elasticity/fixed-corotated"), stiff(1000, 0.3), {});
  const auto rows = read(file);
  ASSERT_GE(rows.size(), 20u);
  for (const Row& row : rows) compare(law, row, 1);
}

}  // namespace
}  // namespace cleave::plugins::test
