#include "../../reference_data.hpp"
#include "../../reference_table.hpp"
#include "hencky_testing.hpp"

#include <regex>

namespace cleave::plugins::test {
namespace {

struct Row {
  std::map<std::string, std::string> cells;
  const std::string& text(const std::string& name) const { return cells.at(name); }
  double number(const std::string& name) const { return std::stod(cells.at(name)); }
  Tensor matrix(const std::string& name) const {
    Tensor a;
    for (int i = 0; i < 9; ++i) a.data()[i] = number(name + std::to_string(i / 3) + std::to_string(i % 3));
    return a;
  }
  /// The number behind `key=` in the variant, or behind a word that ends so.
  double parameter(const std::string& key) const {
    std::smatch found;
    const std::string variant = text("variant");
    if (!std::regex_search(variant, found, std::regex("(^|_)" + key + "=([-+.0-9e]+)"))) throw std::runtime_error(key);
    return std::stod(found[2]);
  }
};

class Golden : public ::testing::Test {
 protected:
  std::vector<Row> read(const std::string& name) {
    std::vector<Row> rows;
    for (auto& cells : read_reference_table(reference_data() / "golden" / name)) rows.push_back({std::move(cells)});
    return rows;
  }
  static constexpr double tolerance = 1e-9;
  static void expect_same(const Tensor& actual, const Tensor& expected, double scale, const std::string& what) {
    EXPECT_LE((actual - expected).cwiseAbs().maxCoeff(), tolerance * std::max(expected.cwiseAbs().maxCoeff(), scale)) << what;
  }
};

#define SKIP_WITHOUT_REFERENCE(file)                                \
  if (!std::filesystem::exists(reference_data() / "golden" / file)) \
  GTEST_SKIP() << (reference_data() / "golden" / file) << " is not there; set CLEAVE_DATA_DIR"

/// The reference takes the logarithm of |s_i|; here a reflection has no strain and is refused.
TEST_F(Golden, StvkHencky) {
  SKIP_WITHOUT_REFERENCE("stvk_hencky.csv");
  const Instance law = stvk_hencky();
  int compared = 0, refused = 0;
  for (const Row& row : read("stvk_hencky.csv")) {
    const Tensor F = row.matrix("F");
    const std::string what = row.text("case") + " " + row.text("variant");
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, {row_major(F)}).output(CLEAVE_FIELD_ENERGY, 1).output(CLEAVE_FIELD_TAU, 6);
    ASSERT_EQ(driver.run(evaluate<double>(law), law.handle(), 1), CLEAVE_OK);
    if (F.determinant() <= 0) {
      EXPECT_EQ(driver.status(0), CLEAVE_STATUS_FATAL) << what;
      ++refused;
      continue;
    }
    ++compared;
    EXPECT_EQ(driver.status(0), CLEAVE_STATUS_OK) << what;
    const double psi = row.number("psi");
    EXPECT_NEAR(driver.value(CLEAVE_FIELD_ENERGY, 0)[0], psi, tolerance * std::max(psi, 1e-3 * mu)) << what;
    const Tensor tau = tensor(driver.value(CLEAVE_FIELD_TAU, 0));
    expect_same(tau, row.matrix("tau"), 1e-3 * mu, what + ": tau");
    expect_same(tau * F.transpose().inverse(), row.matrix("P"), 1e-3 * mu, what + ": P");
  }
  EXPECT_EQ(refused, 4);
  EXPECT_EQ(compared, 40);
}

/// The reference bounds |s| by y, y = sqrt(2/3) tau_y, returns to the surface of before the step, and then softens by
/// y_out = y - xi dgamma, dgamma = sqrt(3/2) da. So its strain is that of perfect plasticity with tau_y = sqrt(3/2) y, and its
/// state follows from ours. Its flag `broken` is a failure criterion and has no counterpart in a return mapping.
TEST_F(Golden, HenckyVonMises) {
  SKIP_WITHOUT_REFERENCE("vonmises_hencky.csv");
  int yielded = 0, compared = 0;
  for (const Row& row : read("vonmises_hencky.csv")) {
    const double y = row.number("yield_in");
    const Instance law = mapping("hencky-von-mises", {{"yield_stress", std::sqrt(1.5) * y}});
    const Mapped mapped = map_one(law, row.matrix("F"), 0);
    const std::string what = row.text("case") + " " + row.text("variant");
    expect_same(mapped.strain, row.matrix("Fe"), 1, what);
    EXPECT_EQ(mapped.yielded, row.text("projected") == "1") << what;
    EXPECT_NEAR(y - row.parameter("xi") * std::sqrt(1.5) * mapped.state, row.number("yield_out"), tolerance * y) << what;
    yielded += mapped.yielded;
    ++compared;
  }
  EXPECT_EQ(compared, 52);
  EXPECT_EQ(yielded, 28);
}

/// The reference's cohesion c is the log stretch of the apex, tr e_a = 3 c: c_c = 9 kappa c_f c. Where it enters a step with a
/// volume gain v, it adds v to the trace it tests but drops v on any return that is not to the apex, and scales
/// dev e - v/3 I in place of dev e; here v goes into the elastic strain, so that the volume stays accounted for.
TEST_F(Golden, HenckyDruckerPrager) {
  SKIP_WITHOUT_REFERENCE("druckerprager_hencky.csv");
  int same = 0, elastic_with_gain = 0, sheared_with_gain = 0;
  for (const Row& row : read("druckerprager_hencky.csv")) {
    const double phi = row.parameter("phi"), sine = std::sin(phi * M_PI / 180);
    const double friction = std::sqrt(2. / 3) * 2 * sine / (3 - sine), gain = row.number("logJp_in");
    EXPECT_NEAR(friction, row.number("alpha_in"), 1e-9);
    const Instance law =
        mapping("hencky-drucker-prager", {{"friction_angle", phi}, {"cohesion", 9 * kappa * friction * row.parameter("c")}});
    const Tensor F = row.matrix("F"), Fe = row.matrix("Fe");
    const Mapped mapped = map_one(law, F, gain);
    const std::string what = row.text("case") + " " + row.text("variant");
    EXPECT_NEAR(mapped.state, row.number("logJp_out"), tolerance) << what;
    if (gain == 0 || mapped.state > 0) {
      expect_same(mapped.strain, Fe, 1, what);
      if (gain == 0) {
        EXPECT_EQ((mapped.strain - F).cwiseAbs().maxCoeff() > 1e-9, row.text("projected") == "1") << what;
      }
      ++same;
    } else if (row.text("projected") == "0") {
      expect_same(mapped.strain, std::exp(gain / 3) * Fe, 1, what);
      ++elastic_with_gain;
    } else {
      EXPECT_NEAR(log_strain_of(mapped.strain).trace(), log_strain_of(F).trace() + gain, tolerance) << what;
      ++sheared_with_gain;
    }
  }
  EXPECT_EQ(same, 30);
  EXPECT_EQ(elastic_with_gain, 13);
  EXPECT_EQ(sheared_with_gain, 9);
}

/// Same surface, flow and hardening; the reference's log J_p is alpha.
TEST_F(Golden, CohesiveCamClay) {
  SKIP_WITHOUT_REFERENCE("modified_camclay_hencky.csv");
  int yielded = 0, compared = 0;
  for (const Row& row : read("modified_camclay_hencky.csv")) {
    const double alpha = row.number("logJp_in");
    const Instance law = mapping("cohesive-cam-clay", {{"cohesion", row.parameter("beta")},
                                                       {"hardening_factor", row.parameter("xi")},
                                                       {"friction_slope", row.parameter("M")},
                                                       {"alpha0", alpha}});
    const Mapped mapped = map_one(law, row.matrix("F"), alpha);
    const std::string what = row.text("case") + " " + row.text("variant");
    EXPECT_EQ(mapped.status, CLEAVE_STATUS_OK) << what;
    expect_same(mapped.strain, row.matrix("Fe"), 1, what);
    EXPECT_EQ(mapped.yielded, row.text("projected") == "1") << what;
    EXPECT_NEAR(mapped.state, row.number("logJp_out"), tolerance) << what;
    yielded += mapped.yielded;
    ++compared;
  }
  EXPECT_EQ(compared, 26);
  EXPECT_EQ(yielded, 19);
}

}  // namespace
}  // namespace cleave::plugins::test
