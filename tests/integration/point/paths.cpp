#include "point_testing.hpp"

#include <gmock/gmock.h>

namespace cleave::testing {
namespace {

using ::testing::HasSubstr;

using Paths = PointTest;

Table completed(const Result& result) {
  EXPECT_EQ(result.status, 0) << result.err;
  return result.table();
}

Matrix3 cauchy(const Table& table, std::size_t row) { return table.matrix(row, "tau") / table.number(row, "J"); }

/// Largest stress of a step besides the axial one.
double lateral(const Matrix3& stress) {
  Matrix3 rest = stress;
  rest(0, 0) = 0;
  return rest.cwiseAbs().maxCoeff();
}

TEST_F(Paths, UniaxialStressBeginsWithYoungsModulus) {
  const Table table = completed(run(along(neo_hookean(), "uniaxial-stress", 1e-6, 10)));
  ASSERT_EQ(table.rows.size(), 11u) << "rest and ten steps";
  EXPECT_EQ(table.text(0, "step"), "0");
  EXPECT_EQ(table.text(10, "step"), "10");
  EXPECT_NEAR(table.last("tau00") / 1e-6, E, 1e-5 * E);
  EXPECT_NEAR((table.last("F11") - 1) / 1e-6, -nu, 1e-5);
}

TEST_F(Paths, UniaxialStressHasNoLateralStress) {
  for (const double amplitude : {0.5, -0.5}) {
    const Table table = completed(run(along(neo_hookean(), "uniaxial-stress", amplitude, 20)));
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      EXPECT_LT(lateral(table.matrix(i, "tau")), 1e-9 * E) << "step " << i;
      EXPECT_NEAR(table.number(i, "F00"), 1 + amplitude * double(i) / 20, 1e-15);
    }
    EXPECT_GT(std::abs(table.last("tau00")), 0.3 * E);
  }
}

TEST_F(Paths, UniaxialStressIsFoundInOneLargeStep) {
  const Table small = completed(run(along(neo_hookean(), "uniaxial-stress", 3, 100)));
  const Table large = completed(run(along(neo_hookean(), "uniaxial-stress", 3, 1)));
  EXPECT_NEAR(small.last("tau00"), large.last("tau00"), 1e-8 * E);
}

TEST_F(Paths, UniaxialStressOfAnInclinedFiberShearsFreely) {
  app::PointOptions options;
  options.laws.elasticity = "point-fibrous";
  options.laws.sets = {"elasticity.youngs_modulus=1e6", "elasticity.poissons_ratio=0.3", "elasticity.fiber_stiffness=1e7"};
  options.laws.fiber = "2,1,0.5";
  const Table table = completed(run(along(options, "uniaxial-stress", 0.2, 20)));
  for (std::size_t i = 0; i < table.rows.size(); ++i) EXPECT_LT(lateral(table.matrix(i, "tau")), 1e-9 * E) << "step " << i;
  EXPECT_GT(std::abs(table.last("F01")), 0.01);
  EXPECT_EQ(table.last("F10"), 0) << "axis 0 keeps its direction";
}

TEST_F(Paths, UniaxialStrainIsTheClosedForm) {
  const Table table = completed(run(along(neo_hookean(), "uniaxial-strain", -0.3, 6)));
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const double J = 1 - 0.05 * double(i), shape = mu * std::pow(J, -2. / 3) * (J * J - 1) / 3, mean = kappa / 2 * (J * J - 1);
    EXPECT_NEAR(table.number(i, "tau00"), 2 * shape + mean, 1e-12 * E);
    EXPECT_NEAR(table.number(i, "tau11"), -shape + mean, 1e-12 * E);
    EXPECT_NEAR(table.number(i, "tau22"), -shape + mean, 1e-12 * E);
  }
}

TEST_F(Paths, HydrostaticFollowsThePressureLaw) {
  for (const double amplitude : {0.2, -0.2}) {
    const Table table = completed(run(along(neo_hookean(), "hydrostatic", amplitude, 8)));
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      const double J = std::pow(1 + amplitude * double(i) / 8, 3);
      EXPECT_NEAR(table.number(i, "J"), J, 1e-14);
      EXPECT_LT((table.matrix(i, "tau") - kappa / 2 * (J * J - 1) * Matrix3::Identity()).norm(), 1e-12 * E);
    }
  }
}

TEST_F(Paths, SimpleShearIsSymmetricAndLinearInTheShearStress) {
  const Table table = completed(run(along(neo_hookean(), "simple-shear", 2, 10)));
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const double gamma = 0.2 * double(i);
    EXPECT_DOUBLE_EQ(table.number(i, "F01"), gamma);
    EXPECT_EQ(table.text(i, "tau01"), table.text(i, "tau10"));
    EXPECT_NEAR(table.number(i, "tau01"), mu * gamma, 1e-12 * E);
    EXPECT_NEAR(table.number(i, "tau00"), 2 * mu * gamma * gamma / 3, 1e-12 * E);
  }
  // Reversing the shear reverses the shear stress alone.
  const Table back = completed(run(along(neo_hookean(), "simple-shear", -2, 10)));
  EXPECT_NEAR(back.last("tau01"), -table.last("tau01"), 1e-12 * E);
  EXPECT_NEAR(back.last("tau00"), table.last("tau00"), 1e-12 * E);
}

TEST_F(Paths, TriaxialKeepsItsConfinement) {
  app::PointOptions options = along(neo_hookean(), "triaxial", -0.2, 10);
  options.confinement = 2e5;
  const Table table = completed(run(options));
  EXPECT_LT((cauchy(table, 0) + 2e5 * Matrix3::Identity()).norm(), 1e-9 * E) << "step 0 is the confined state";
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    EXPECT_LT(lateral(cauchy(table, i) + 2e5 * Matrix3::Identity()), 1e-9 * E) << "step " << i;
    EXPECT_NEAR(table.number(i, "F00"), table.number(0, "F00") * (1 - 0.02 * double(i)), 1e-14);
  }
  EXPECT_LT(cauchy(table, 10)(0, 0), -3e5);
}

TEST_F(Paths, VonMisesElementYieldsAtItsYieldStress) {
  app::PointOptions options = neo_hookean();
  options.laws.plasticity = "point-von-mises";
  options.laws.sets.push_back("plasticity.yield_stress=1e4");

  const Table tension = completed(run(along(options, "uniaxial-stress", 0.5, 50)));
  for (std::size_t i = 0; i < tension.rows.size(); ++i) {
    EXPECT_LT(lateral(tension.matrix(i, "tau")), 1e-9 * E) << "step " << i;
    if (tension.text(i, "yielded") == "1") {
      EXPECT_NEAR(tension.number(i, "tau00"), 1e4, 1e-9 * E) << "step " << i;
    }
  }
  EXPECT_EQ(tension.text(0, "yielded"), "0");
  EXPECT_EQ(tension.text(50, "yielded"), "1");
  EXPECT_NEAR(tension.last("Fe00"), 1.01, 1e-3) << "the rest of the stretch of 1.5 has flowed";
  EXPECT_EQ(tension.last("marker0_out"), 1 + 49) << "the first step reaches 1e4 Pa within one percent strain";
  const double elastic_limit = tension.number(50, "J");
  EXPECT_NEAR(tension.last("F00") * tension.last("F11") * tension.last("F22"), elastic_limit, 1e-9) << "flow keeps the volume";

  const Table shear = completed(run(along(options, "simple-shear", 0.5, 50)));
  // In finite shear the normal stresses carry a little of q.
  EXPECT_NEAR(shear.last("tau01"), 1e4 / std::sqrt(3), 1e-3 * 1e4);

  const Table pressure = completed(run(along(options, "hydrostatic", -0.3, 50)));
  EXPECT_EQ(pressure.last("marker0_out"), 1) << "pressure does not yield";
}

TEST_F(Paths, SmallAndLargeIncrementsOfFlowMeet) {
  app::PointOptions options = neo_hookean();
  options.laws.plasticity = "point-von-mises";
  options.laws.sets.push_back("plasticity.yield_stress=1e4");
  const Table coarse = completed(run(along(options, "uniaxial-stress", 0.2, 10)));
  const Table fine = completed(run(along(options, "uniaxial-stress", 0.2, 200)));
  EXPECT_NEAR(coarse.last("tau00"), fine.last("tau00"), 1e-8 * E);
  EXPECT_NEAR(coarse.last("F11"), fine.last("F11"), 1e-6);
}

TEST_F(Paths, ATensileBarBreaksAsTheClosedFormSays) {
  // D = E e^2/(2 w) and d = D/(1+D) in small strain: the stress E e/(1+D)^2 peaks where D = 1/3, d = 1/4.
  const double peak_strain = 1e-4, w = 1.5 * E * peak_strain * peak_strain;
  app::PointOptions options = neo_hookean();
  options.laws.damage = "point-tensile-energy";
  options.laws.sets.push_back("damage.critical_energy=" + std::to_string(w));
  const Table table = completed(run(along(options, "uniaxial-stress", 4 * peak_strain, 400)));
  std::size_t peak = 0;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    if (table.number(i, "tau00") > table.number(peak, "tau00")) peak = i;
    const double D = table.number(i, "D"), d = table.number(i, "d");
    EXPECT_NEAR(d, D / (1 + D), 1e-12);
    EXPECT_LT(lateral(table.matrix(i, "tau")), 1e-9 * E);
  }
  EXPECT_NEAR(table.number(peak, "F00") - 1, peak_strain, 0.011 * peak_strain);
  EXPECT_NEAR(table.number(peak, "tau00"), 9. / 16 * E * peak_strain, 1e-3 * E * peak_strain);
  EXPECT_NEAR(table.number(peak, "d"), 0.25, 0.005);
}

TEST_F(Paths, ALocalLawIsAskedForItsOwnDamage) {
  app::PointOptions options = neo_hookean();
  options.laws.damage = "point-local";
  options.laws.sets.push_back("damage.limit=1000");
  const Table table = completed(run(along(options, "uniaxial-stress", 1e-2, 50)));
  EXPECT_EQ(table.number(2, "d"), 0);
  for (std::size_t i = 6; i < table.rows.size(); ++i) EXPECT_NEAR(cauchy(table, i)(0, 0), 1000, 1e-9 * E) << "step " << i;
  EXPECT_EQ(table.text(50, "d"), table.text(50, "d_out"));
  EXPECT_GT(table.last("d"), 0.6);
}

TEST_F(Paths, SingleAgreesWithDouble) {
  app::PointOptions options = along(neo_hookean(), "uniaxial-stress", 0.3, 10);
  const Table exact = completed(run(options));
  options.laws.precision = "single";
  const Table rounded = completed(run(options));
  for (std::size_t i = 0; i < exact.rows.size(); ++i) {
    EXPECT_NEAR(exact.number(i, "tau00"), rounded.number(i, "tau00"), 1e-4 * E);
    EXPECT_NEAR(exact.number(i, "F11"), rounded.number(i, "F11"), 1e-4);
  }
}

TEST_F(Paths, APathThatLeavesTheLawsDomainSaysSoAndEnds) {
  const Result result = run(along(neo_hookean(), "uniaxial-strain", -1.5, 10));
  EXPECT_EQ(result.status, 3);
  const Table table = result.table();
  ASSERT_EQ(table.rows.size(), 8u) << "step 7 has a stretch of -0.05";
  EXPECT_EQ(table.text(6, "status"), "ok");
  EXPECT_EQ(table.text(7, "status"), "fatal");
  EXPECT_NEAR(table.number(7, "F00"), -0.05, 1e-15);
  EXPECT_EQ(table.text(7, "tau00"), "nan");
  EXPECT_THAT(result.err, HasSubstr("error: the path ended at step 7 of 10: no usable state was found there"));
}

}  // namespace
}  // namespace cleave::testing
