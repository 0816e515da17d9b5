#include "point_testing.hpp"

#include <gmock/gmock.h>

namespace cleave::testing {
namespace {

using ::testing::HasSubstr;

/// Bars pulled slowly, the closed forms of the damage laws.
class DamagedBar : public PointTest {
 protected:
  static std::string text(double x) {
    std::ostringstream stream;
    stream.precision(17);
    stream << x;
    return stream.str();
  }
  static app::PointOptions with(app::PointOptions options, const std::string& law, std::vector<std::string> sets) {
    options.laws.damage = law;
    for (const std::string& set : sets) options.laws.sets.push_back("damage." + set);
    return options;
  }
  static app::PointOptions fixed_corotated() {
    app::PointOptions options = neo_hookean();
    options.laws.elasticity = "fixed-corotated";
    return options;
  }
  static Table pulled(const app::PointOptions& options, double strain, int steps) {
    const Result result = run(along(options, "uniaxial-stress", strain, steps));
    EXPECT_EQ(result.status, 0) << result.err;
    return result.table();
  }
  static std::size_t peak(const Table& table) {
    std::size_t at = 0;
    for (std::size_t i = 0; i < table.rows.size(); ++i)
      if (table.number(i, "tau00") > table.number(at, "tau00")) at = i;
    return at;
  }
};

TEST_F(DamagedBar, PhaseFieldCarriesItsStrength) {
  // l0 = 1 mm and G chosen so that the peak strain sqrt(G/(6 l0 E)) is 1e-4; the strength is then 9/16 E 1e-4.
  const double length = 1e-3, strain = 1e-4, G = 6 * length * E * strain * strain, strength = 9. / 16 * E * strain;
  const std::vector<std::vector<std::string>> sets = {
      {"energy_release_rate=" + text(G), "length_scale=" + text(length)},
      {"strength=" + text(strength), "length_scale=" + text(length)},
      {"energy_release_rate=" + text(G), "strength=" + text(strength)},
  };
  for (const auto& elastic : {neo_hookean(), fixed_corotated()})
    for (const auto& set : sets) {
      const Table table = pulled(with(elastic, "phase-field", set), 2 * strain, 200);
      const std::size_t at = peak(table);
      EXPECT_NEAR(table.number(at, "tau00"), strength, 0.005 * strength) << set[0];
      EXPECT_NEAR(table.number(at, "F00") - 1, strain, 0.02 * strain) << set[0];
      EXPECT_NEAR(table.number(at, "d"), 0.25, 0.01) << set[0];
    }
}

TEST_F(DamagedBar, PhaseFieldKeepsItsLengthInCells) {
  app::PointOptions options = with(neo_hookean(), "phase-field", {"strength=50", "length_scale_cells=2"});
  EXPECT_THAT(run(along(options, "uniaxial-stress", 1e-4, 1)).err,
              HasSubstr("length_scale_cells needs a grid, and there is no cell size here"));
  options.laws.cell_size = 0.01;
  const Table table = pulled(options, 3e-4, 100);
  EXPECT_NEAR(table.number(peak(table), "tau00"), 50, 0.25);
}

TEST_F(DamagedBar, PhaseFieldLeavesItsResidual) {
  const Table table = pulled(with(neo_hookean(), "phase-field", {"strength=10", "length_scale=1e-3"}), 0.01, 50);
  EXPECT_GT(table.last("d"), 0.999);
  const double carried = table.last("tau00"), whole = E * 0.01;
  EXPECT_NEAR(carried, 0.001 * whole, 0.03 * 0.001 * whole);
}

void expect_inverse_cube(const Table& table, double critical, double modulus) {
  const double first = critical / modulus;
  bool failing = false;
  double largest = 0;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const double strain = table.number(i, "F00") - 1, effective = modulus * strain, carried = table.number(i, "tau00");
    largest = std::max(largest, carried);
    if (strain < 0.99 * first) {
      EXPECT_EQ(table.number(i, "d"), 0) << "below the critical stress";
    } else if (strain > 1.01 * first) {
      const double ratio = critical / effective;
      EXPECT_NEAR(table.number(i, "d"), 1 - ratio * ratio, 1e-3);
      EXPECT_NEAR(carried, critical * ratio * ratio * ratio, 1e-3 * critical);
      failing = true;
    }
  }
  EXPECT_TRUE(failing);
  EXPECT_NEAR(largest, critical, 0.005 * critical);
}

TEST_F(DamagedBar, AnisotropicPeaksAtItsCriticalStressAndFallsWithTheCube) {
  const double critical = 1e-4 * E;
  const std::vector<std::string> common = {"critical_stress=" + text(critical), "viscosity=0.1", "residual=0"};
  for (const auto& elastic : {neo_hookean(), fixed_corotated()}) {
    auto isotropic = common;
    isotropic.push_back("structural_alpha=[]");
    expect_inverse_cube(pulled(with(elastic, "damage/anisotropic", isotropic), 2.5e-4, 500), critical, E);
    app::PointOptions across = with(elastic, "anisotropic", common);
    across.laws.fiber = "0,0,1";
    expect_inverse_cube(pulled(across, 2.5e-4, 500), critical, E);
  }
}

TEST_F(DamagedBar, AnisotropicHoldsAlongItsFibers) {
  app::PointOptions along_fiber =
      with(neo_hookean(), "anisotropic", {"critical_stress=100", "viscosity=0.1", "structural_alpha=[-1]"});
  EXPECT_THAT(run(along(along_fiber, "uniaxial-stress", 1e-4, 1)).err, HasSubstr("--fiber"));
  along_fiber.laws.fiber = "1,0,0";
  const Table table = pulled(along_fiber, 0.01, 50);
  EXPECT_EQ(table.last("d"), 0);
  EXPECT_GT(table.last("tau00"), 9000);
}

TEST_F(DamagedBar, RankineSoftensTowardsItsLimit) {
  // H_s = 1: c = sigma_f/sigma, so that the bar carries sigma_f^2/sigma.
  const double failure = 1e-4 * E;
  const std::vector<std::string> sets = {"failure_stress=" + text(failure), "softening=1", "residual=0"};
  const Table table = pulled(with(neo_hookean(), "rankine", sets), 3e-4, 300);
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const double effective = E * (table.number(i, "F00") - 1);
    const double expected = effective > failure ? failure * failure / effective : effective;
    EXPECT_NEAR(table.number(i, "tau00"), expected, 1e-3 * failure) << "step " << i;
  }
  EXPECT_NEAR(table.last("d"), 2. / 3, 1e-3);
}

TEST_F(DamagedBar, TheHistoryComesFromItsColumnAndDrives) {
  const std::string stretched = "1.01,0,0,0,1,0,0,0,1", at_rest = "1,0,0,0,1,0,0,0,1";
  const Table table = evaluate(with(neo_hookean(), "phase-field", {"strength=100", "length_scale=1e-3"}),
                               header + ",history\n" + stretched + ",0\n" + at_rest + ",77\n")
                          .table();
  EXPECT_EQ(table.number(0, "history_out"), table.number(0, "psi_plus"));
  EXPECT_EQ(table.number(1, "history_out"), 77);
  EXPECT_NEAR(table.number(1, "D") / table.number(0, "D"), 77 / table.number(0, "psi_plus"), 1e-12);
}

TEST_F(DamagedBar, DamageGrowsAtItsRateUnderAConstantDrivingForce) {
  // eta dd/dt = (1 - d) D - d from rest: d = D/(1 + D) (1 - exp(-(1 + D) t/eta)).
  const double eta = 0.25;
  const auto options = with(neo_hookean(), "anisotropic", {"critical_stress=5", "viscosity=0.25", "structural_alpha=[]"});
  const std::string F = "1.01,0,0,0,1,0,0,0,1";
  const Table table = evaluate(options, header + ",dt,d\n" + F + ",0,0\n" + F + ",0.01,0\n" + F + ",0.1,0\n" + F + ",1e9,0\n" +
                                            F + ",0.01,0.3\n" + F + ",1,1\n")
                          .table();
  const double D = table.number(0, "D");
  ASSERT_GT(D, 1);
  EXPECT_EQ(table.number(0, "d_out"), 0);
  for (std::size_t i : {1, 2})
    EXPECT_NEAR(table.number(i, "d_out"), D / (1 + D) * (1 - std::exp(-(1 + D) * table.number(i, "dt") / eta)), 1e-14);
  EXPECT_NEAR(table.number(3, "d_out"), D / (1 + D), 1e-15);
  EXPECT_NEAR(table.number(4, "d_out"), D / (1 + D) + (0.3 - D / (1 + D)) * std::exp(-(1 + D) * 0.01 / eta), 1e-14);
  EXPECT_EQ(table.number(5, "d_out"), 1) << "damage does not heal";
  EXPECT_THAT(evaluate(options, header + ",dt\n" + F + ",-1\n").err, HasSubstr("dt must be a time of at least 0 s, is -1"));
}

}  // namespace
}  // namespace cleave::testing
