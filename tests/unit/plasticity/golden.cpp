#include "../../reference_data.hpp"
#include "../../reference_table.hpp"
#include "mapping.hpp"

#include <filesystem>
#include <functional>
#include <map>

namespace cleave::plugins::test {
namespace {

/// Published values are for E = 1000 Pa, nu = 0.3, with 0.666666 for 2/3 in the bulk modulus.
constexpr double golden_mu = 384.61538461538464, golden_kappa = 576.92307692307691 + 0.666666 * golden_mu;
const IsochoricResponse golden_elastic{golden_mu, golden_kappa, PressureLaw::quadratic};

struct Row {
  std::string name, variant;
  Tensor F, returned;
  std::map<std::string, double> number;
};

std::vector<Row> read(const std::filesystem::path& file) {
  std::vector<Row> rows;
  for (const auto& cells : read_reference_table(file)) {
    Row row{cells.at("case"), cells.at("variant"), {}, {}, {}};
    for (const auto& [column, cell] : cells)
      if (column != "case" && column != "variant") row.number[column] = std::stod(cell);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const std::string index = std::to_string(i) + std::to_string(j);
        row.F(i, j) = row.number.at("F" + index);
        row.returned(i, j) = row.number.at("Fe" + index);
      }
    rows.push_back(row);
  }
  return rows;
}

class GoldenReturns : public ::testing::Test {
 protected:
  std::vector<Row> rows(const std::string& name) {
    const auto file = reference_data() / "golden" / name;
    if (!std::filesystem::exists(file)) return {};
    auto all = read(file);
    EXPECT_GE(all.size(), 50u);
    return all;
  }

  /// F and b = F F^T of one return, to 1e-9 of their size.
  void compare(const Row& row, const Mapping& mapping, double state, double expected_state, double state_tolerance) {
    const auto on_F = mapping.of_F({row.F}, state)[0];
    const auto on_b = mapping.of_b(row.F * row.F.transpose(), state);
    const Tensor expected_b = row.returned * row.returned.transpose();
    const std::string what = row.name + " " + row.variant;
    EXPECT_EQ(on_F.status, CLEAVE_STATUS_OK) << what;
    EXPECT_LE((on_b.strain - expected_b).norm(), 1e-9 * expected_b.norm()) << what;
    EXPECT_LE((on_F.strain - row.returned).norm(), 1e-9 * row.returned.norm()) << what;
    EXPECT_NEAR(on_b.state, expected_state, state_tolerance) << what;
    EXPECT_NEAR(on_F.state, expected_state, state_tolerance) << what;
  }
};

double pressure(const Row& row) { return golden_elastic.pressure(row.F.determinant()); }

double value_in(const std::string& variant, const std::string& key) {
  const auto at = variant.find(key);
  return std::stod(variant.substr(at + key.size()));
}

struct CamClay {
  double beta, xi, M, alpha;
  bool hardening;
};
CamClay cam_clay(const Row& row) {
  return {value_in(row.variant, "beta"), value_in(row.variant, "xi"), row.number.at("M_in"), row.number.at("logJp_in"),
          row.variant.find("nohard") == std::string::npos};
}
Mapping nacc(const CamClay& clay) {
  return Mapping("plasticity/nacc",
                 {{"cohesion", clay.beta},
                  {"hardening_factor", clay.xi},
                  {"friction_slope", clay.M},
                  {"alpha0", clay.alpha},
                  {"hardening", clay.hardening},
                  {"closure", std::string("trace")}},
                 golden_elastic);
}

#define REQUIRE_ROWS(rows, name) \
  if (rows.empty()) GTEST_SKIP() << name << " is not there; CLEAVE_DATA_DIR may say where it is"

TEST_F(GoldenReturns, Nacc) {
  for (const std::string file : {"nacc.csv", "nacc_ziran2019_path.csv"}) {
    const auto all = rows(file);
    REQUIRE_ROWS(all, file);
    for (const Row& row : all) {
      const CamClay clay = cam_clay(row);
      const bool other_hardening = row.variant.find("qHard") != std::string::npos;
      const Mapping mapping = nacc(clay);
      const double state = other_hardening ? mapping.of_F({row.F}, clay.alpha)[0].state : row.number.at("logJp_out");
      compare(row, mapping, clay.alpha, state, 1e-9);
    }
  }
}

TEST_F(GoldenReturns, VonMises) {
  const auto all = rows("navm.csv");
  REQUIRE_ROWS(all, "navm.csv");
  // The reference hardens a step late: it flows at the yield stress of the plastic strain before the step.
  for (const Row& row : all) {
    const double alpha = row.number.at("alpha_in"),
                 yield_stress = row.number.at("tauY_in") + value_in(row.variant, "h=") * alpha;
    const Mapping mapping("plasticity/von-mises", {{"yield_stress", yield_stress}, {"closure", std::string("trace")}},
                          golden_elastic);
    compare(row, mapping, alpha, row.number.at("alpha_out"), 1e-9);
  }
}

TEST_F(GoldenReturns, DruckerPrager) {
  const auto all = rows("nadp.csv");
  REQUIRE_ROWS(all, "nadp.csv");
  int beyond_apex = 0, rounding_at_apex = 0;
  for (const Row& row : all) {
    const Mapping mapping("plasticity/drucker-prager",
                          {{"friction_angle", value_in(row.variant, "phi=")},
                           {"cohesion", row.number.at("cohesion_in")},
                           {"volume_correction", false},
                           {"closure", std::string("trace")}},
                          golden_elastic);
    // With cohesion the reference ends the cone at p = -c_c/3 for -c_c/(3 c_f): states of less pressure return elsewhere.
    // A tension that is rounding alone (p = 0 at the apex) is a tip there and a shear return to q = 0 here, which the trace
    // closure takes far apart.
    const double p = pressure(row), cohesion = row.number.at("cohesion_in");
    if (cohesion > 0 && -3 * p > cohesion)
      ++beyond_apex;
    else if (cohesion == 0 && p < 0 && p > -1e-14 * golden_kappa)
      ++rounding_at_apex;
    else
      compare(row, mapping, 0, 0, 0);
  }
  EXPECT_EQ(beyond_apex, 5);
  EXPECT_EQ(rounding_at_apex, 2);
}

}  // namespace
}  // namespace cleave::plugins::test
