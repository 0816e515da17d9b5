#include "point_testing.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

namespace cleave::testing {
namespace {

class ReturnMappingPaths : public PointTest {
 protected:
  static app::PointOptions with(const std::string& plasticity, std::initializer_list<std::string> parameters) {
    app::PointOptions options = neo_hookean();
    options.laws.plasticity = plasticity;
    for (const auto& parameter : parameters) options.laws.sets.push_back("plasticity." + parameter);
    return options;
  }
  static Table completed(const Result& result) {
    EXPECT_EQ(result.status, 0) << result.err;
    return result.table();
  }
  static double pressure(const Table& table, std::size_t row) { return -table.matrix(row, "tau").trace() / 3; }
  static double q(const Table& table, std::size_t row) {
    const Matrix3 tau = table.matrix(row, "tau");
    return std::sqrt(1.5) * (tau + pressure(table, row) * Matrix3::Identity()).norm();
  }
  static double radians(double degrees) { return degrees * M_PI / 180; }
};

// ---------------------------------------------------------------- von Mises

TEST_F(ReturnMappingPaths, VonMisesCarriesItsYieldStressInTensionAndAThirdRootOfItInShear) {
  const auto options = with("von-mises", {"yield_stress=1e4"});
  const Table tension = completed(run(along(options, "uniaxial-stress", 0.3, 60)));
  const Table shear = completed(run(along(options, "simple-shear", 0.3, 60)));
  EXPECT_NEAR(tension.last("tau00"), 1e4, 1e-9 * E);
  EXPECT_NEAR(q(shear, 60), 1e4, 1e-9 * E);
  EXPECT_NEAR(shear.last("tau01"), 1e4 / std::sqrt(3), 2e-4 * 1e4) << "the normal stresses of finite shear carry the rest";
  for (std::size_t i = 0; i < shear.rows.size(); ++i) EXPECT_NEAR(pressure(shear, i), 0, 1e-12 * E) << "shear keeps the volume";
}

/// The plastic strain is what is left of the logarithmic one, ln(F00/Fe00), to the order of the elastic strain of 1e-3.
TEST_F(ReturnMappingPaths, VonMisesHardensWithThePlasticStrain) {
  const auto options = with("von-mises", {"yield_stress=1e3", "hardening_modulus=2e3"});
  const Table table = completed(run(along(options, "uniaxial-stress", 0.2, 800)));
  double before = 0;
  for (std::size_t i = 1; i < table.rows.size(); ++i) {
    const double alpha = table.number(i, "equivalent_plastic_strain_out");
    EXPECT_GE(alpha, before) << "step " << i;
    before = alpha;
    if (table.text(i, "yielded") == "1") {
      EXPECT_NEAR(table.number(i, "tau00"), 1e3 + 2e3 * alpha, 1e-9 * E) << "step " << i;
      EXPECT_NEAR(alpha, std::log(table.number(i, "F00") / table.number(i, "Fe00")), 2e-3 * alpha + 1e-6) << "step " << i;
    }
  }
  EXPECT_GT(before, 0.17);
}

// ---------------------------------------------------------------- Drucker-Prager

TEST_F(ReturnMappingPaths, DruckerPragerYieldsOnItsConeInTriaxialCompression) {
  for (const double phi : {20., 35.}) {
    const double slope = 6 * std::sin(radians(phi)) / (3 - std::sin(radians(phi)));
    const std::string angle = "friction_angle=" + std::to_string(phi);
    const Table sand = completed(
        evaluate(with("drucker-prager", {angle}), header + "\n0.85,0,0,0,1.03,0,0,0,1.03\n0.8,0,0,0,1.05,0,0,0,1.05\n"));
    for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(q(sand, i), slope * pressure(sand, i), 1e-12 * E);

    auto options = with("drucker-prager", {angle});
    options.confinement = 1e4;
    const Table table = completed(run(along(options, "triaxial", -0.2, 80)));
    EXPECT_EQ(table.text(0, "yielded"), "0") << "confinement alone";
    EXPECT_EQ(table.text(80, "yielded"), "1");
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
      EXPECT_NEAR(table.number(i, "tau11"), -1e4 * table.number(i, "J"), 1e-9 * E) << "step " << i;
      if (table.text(i, "yielded") == "1") {
        EXPECT_NEAR(q(table, i), slope * pressure(table, i), 1e-9 * E) << "step " << i;
      }
    }
  }
}

TEST_F(ReturnMappingPaths, DruckerPragerDoesNotCarryTensionBeyondItsApex) {
  const double phi = 30, cohesion = 3e3;
  const auto options = with("drucker-prager", {"friction_angle=30", "cohesion=3e3"});
  const Table table = completed(run(along(options, "hydrostatic", 0.05, 20)));
  const double friction = std::sqrt(2. / 3) * 2 * std::sin(radians(phi)) / (3 - std::sin(radians(phi)));
  EXPECT_NEAR(pressure(table, 20), -cohesion / (3 * friction), 1e-9 * E);
  EXPECT_NEAR(table.last("log_volume_gain_out"), std::log(std::pow(1.05, 3) / table.last("J")), 1e-12)
      << "what the elastic strain does not hold is gained";
}

// ---------------------------------------------------------------- non-associated Cam-Clay

constexpr double beta = 0.5, M = 1.8, xi = 3, alpha0 = -0.02;

class CamClayPaths : public ReturnMappingPaths {
 protected:
  static constexpr const char* ellipse[] = {"cohesion=0.5", "friction_slope=1.8", "hardening_factor=3", "alpha0=-0.02"};
  static app::PointOptions perfect() {
    return with("nacc", {ellipse[0], ellipse[1], ellipse[2], ellipse[3], "hardening=false"});
  }
  static app::PointOptions hardening() { return with("nacc", {ellipse[0], ellipse[1], ellipse[2], ellipse[3]}); }
  static double p0(double alpha) { return kappa * (1e-5 + std::sinh(xi * std::max(-alpha, 0.))); }
};

TEST_F(CamClayPaths, PressureAndTensionEndAtTheTips) {
  const Table crushed = completed(run(along(perfect(), "hydrostatic", -0.1, 20)));
  EXPECT_NEAR(pressure(crushed, 20), p0(alpha0), 1e-9 * E);
  const Table torn = completed(run(along(perfect(), "hydrostatic", 0.1, 20)));
  EXPECT_NEAR(pressure(torn, 20), -beta * p0(alpha0), 1e-9 * E);
}

TEST_F(CamClayPaths, ShearAtConstantVolumeEndsOnTheEllipse) {
  // From rest, simple shear stays at p = 0: q = M p0 sqrt(beta/(1 + 2 beta)).
  const Table at_rest = completed(run(along(perfect(), "simple-shear", 0.5, 50)));
  EXPECT_NEAR(pressure(at_rest, 50), 0, 1e-12 * E);
  EXPECT_NEAR(q(at_rest, 50), M * p0(alpha0) * std::sqrt(beta / (1 + 2 * beta)), 1e-9 * E);

  // Compressed to the middle p = (1 - beta) p0/2 of the ellipse, sheared: its peak M p0 (1 + beta)/(2 sqrt(1 + 2 beta)).
  const double p = (1 - beta) * p0(alpha0) / 2, stretch = std::pow(1 - 2 * p / kappa, 1. / 6);
  std::ostringstream F;
  F.precision(17);
  F << header << '\n' << stretch << ',' << 0.4 * stretch << ",0,0," << stretch << ",0,0,0," << stretch << '\n';
  const Table peak = completed(evaluate(perfect(), F.str()));
  EXPECT_NEAR(pressure(peak, 0), p, 1e-9 * E);
  EXPECT_NEAR(q(peak, 0), M * p0(alpha0) * (1 + beta) / (2 * std::sqrt(1 + 2 * beta)), 1e-9 * E);
  EXPECT_NEAR(peak.number(0, "J"), stretch * stretch * stretch, 1e-12);
}

/// All change of volume beyond the tip is plastic: alpha = alpha0 + ln(J_total/J).
TEST_F(CamClayPaths, CompactionHardensAndPullingApartSoftens) {
  const Table packed = completed(run(along(hardening(), "hydrostatic", -0.1, 200)));
  for (std::size_t i = 0; i < packed.rows.size(); ++i) {
    const double J = packed.number(i, "J"), total = std::pow(packed.number(i, "F00"), 3);
    EXPECT_NEAR(packed.number(i, "alpha_out"), alpha0 + std::log(total / J), 1e-12) << "step " << i;
  }
  EXPECT_GT(pressure(packed, 200), 2 * p0(alpha0));

  const Table torn = completed(run(along(hardening(), "hydrostatic", 0.05, 200)));
  EXPECT_GT(torn.last("alpha_out"), 0);
  EXPECT_NEAR(pressure(torn, 200), -beta * 1e-5 * kappa, 1e-9 * E) << "all strength but the floor of p0 is gone";
}

TEST_F(CamClayPaths, ShearWithoutPressureFractures) {
  const Table table = completed(run(along(hardening(), "simple-shear", 0.5, 100)));
  double before = alpha0, peak = 0;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    EXPECT_GE(table.number(i, "alpha_out"), before) << "step " << i;
    before = table.number(i, "alpha_out");
    peak = std::max(peak, q(table, i));
  }
  EXPECT_LT(q(table, 100), 0.01 * peak) << "below the middle of the ellipse shear softens to nothing";
  EXPECT_NEAR(table.last("J"), 1, 1e-12) << "and keeps the volume";
}

}  // namespace
}  // namespace cleave::testing
