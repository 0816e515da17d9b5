#include "../../reference_data.hpp"
#include "point_testing.hpp"

namespace cleave::testing {
namespace {

std::filesystem::path golden_directory() { return reference_data() / "golden"; }

constexpr double golden_mu = 384.61538461538464, golden_lambda = 576.92307692307691;

std::string number_text(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", x);
  return text;
}

class Golden : public PointTest {
 protected:
  /// The table with a damage column that gives the degradation of the `variant` ("g=0.25").
  static std::string with_damage(const std::string& text) {
    std::istringstream lines(text);
    std::string result;
    bool header_seen = false;
    for (std::string line; std::getline(lines, line);) {
      if (line.empty() || line[0] == '#') continue;
      if (!header_seen)
        line += ",d";
      else {
        const std::string variant = Table::cells(line)[1];
        const double g = variant.rfind("g=", 0) == 0 ? std::strtod(variant.c_str() + 2, nullptr) : 1;
        line += "," + number_text(1 - std::sqrt(g));
      }
      header_seen = true;
      result += line + "\n";
    }
    return result;
  }

  void compare(const std::string& file, const app::PointOptions& options, std::size_t expected_undefined) {
    const auto path = golden_directory() / file;
    if (!std::filesystem::exists(path))
      GTEST_SKIP() << "no reference values: " << path << " is not there; CLEAVE_DATA_DIR may say where they are";
    const std::string golden_text = read(path);
    const Table golden = Table::parse(golden_text);
    const Result result = evaluate(options, with_damage(golden_text));
    ASSERT_EQ(result.status, 0) << result.err;
    const Table ours = result.table();
    ASSERT_EQ(ours.rows.size(), golden.rows.size());
    ASSERT_GT(golden.rows.size(), 20u);
    std::size_t undefined = 0;
    for (std::size_t i = 0; i < golden.rows.size(); ++i) {
      const std::string where = golden.text(i, "case") + " " + golden.text(i, "variant");
      if (!std::isfinite(golden.number(i, "psi"))) {
        ++undefined;
        EXPECT_EQ(ours.text(i, "status"), "fatal") << where;
        for (const char* column : {"psi", "J", "P00", "tau11", "Fe22", "yielded"})
          EXPECT_EQ(ours.text(i, column), "nan") << where;
        continue;
      }
      EXPECT_EQ(ours.text(i, "status"), "ok") << where;
      EXPECT_NEAR(ours.number(i, "psi"), golden.number(i, "psi"), 1e-9 * std::max(std::abs(golden.number(i, "psi")), 1.0))
          << where;
      EXPECT_NEAR(ours.number(i, "J"), golden.number(i, "detF"), 1e-9 * std::abs(golden.number(i, "detF"))) << where;
      for (const char* stress : {"P", "tau"}) {
        const Matrix3 expected = golden.matrix(i, stress);
        EXPECT_LT((ours.matrix(i, stress) - expected).norm(), 1e-9 * std::max(expected.norm(), 1.0)) << where << " " << stress;
      }
    }
    EXPECT_EQ(undefined, expected_undefined);
    if (expected_undefined > 0) {
      EXPECT_NE(result.err.find(std::to_string(expected_undefined) + " fatal"), std::string::npos) << result.err;
    }
  }
};

TEST_F(Golden, SplitNeoHookeanMatchesThePublishedCode) {
  app::PointOptions options;
  options.laws.elasticity = "split-neo-hookean";
  options.laws.sets = {"elasticity.shear_modulus=" + number_text(golden_mu),
                       "elasticity.bulk_modulus=" + number_text(golden_lambda + 0.666666 * golden_mu)};
  compare("neohookean_borden.csv", options, 4);
}

TEST_F(Golden, FixedCorotatedMatchesThePublishedCodeThroughInversion) {
  app::PointOptions options;
  options.laws.elasticity = "elasticity/fixed-corotated";
  options.laws.sets = {"elasticity.shear_modulus=" + number_text(golden_mu),
                       "elasticity.bulk_modulus=" + number_text(golden_lambda + golden_mu * 2 / 3)};
  compare("corotated.csv", options, 0);
}

}  // namespace
}  // namespace cleave::testing
