#include "hencky_testing.hpp"

#include <limits>

namespace cleave::plugins::test {
namespace {

const GivenParameters clay{{"cohesion", 0.2}, {"hardening_factor", 3.0}, {"friction_slope", 1.85}, {"alpha0", -0.01}};
const GivenParameters sand{{"friction_angle", 35.0}, {"cohesion", 2.0}};
const GivenParameters metal{{"yield_stress", 30.0}, {"hardening_modulus", 200.0}};

struct Case {
  const char* name;
  GivenParameters parameters;
  double state;
  PressureLaw law = PressureLaw::logarithmic;
  Instance make(double scale = 1) const { return mapping(name, parameters, law, scale); }
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name << ", pressure law " << int(c.law); }

/// Small, moderate and huge strains, stretches that coincide, pure changes of volume.
std::vector<Tensor> trials() {
  std::vector<Tensor> all = deformations(24, 0.5);
  for (const Tensor& F : deformations(8, 1e-4, 11)) all.push_back(F);
  for (const Tensor& F : {diagonal_tensor(1.4, 1.4, 0.6), diagonal_tensor(0.7, 1.2, 0.7), diagonal_tensor(2, 2, 2),
                          diagonal_tensor(0.5, 0.5, 0.5), diagonal_tensor(8, 1, 0.2), diagonal_tensor(1, 1, 1)})
    all.push_back(F);
  return all;
}

class EveryMapping : public ::testing::TestWithParam<Case> {
 protected:
  Instance law_ = GetParam().make();
  std::vector<Mapped> map(const std::vector<Tensor>& strains, cleave_field_id measure = CLEAVE_FIELD_F) {
    return map_all(law_, strains, GetParam().state, measure);
  }
};

TEST_P(EveryMapping, ReturnedStatesStayWhereTheyAre) {
  const auto all = trials();
  const auto first = map(all);
  int yielded = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    ASSERT_EQ(first[k].status, CLEAVE_STATUS_OK) << all[k];
    const Mapped again = map_one(law_, first[k].strain, first[k].state);
    yielded += first[k].yielded;
    // Hardening in tension shrinks Cam-Clay's surface under the state.
    if (std::string(GetParam().name) == "cohesive-cam-clay" && first[k].state > GetParam().state) continue;
    EXPECT_LT((again.strain - first[k].strain).norm(), 1e-12 * first[k].strain.norm()) << all[k];
    EXPECT_NEAR(again.state, first[k].state, 1e-12) << all[k];
  }
  EXPECT_GT(yielded, 20);
}

TEST_P(EveryMapping, PointsInsideAreLeftAloneToTheBit) {
  const Tensor rest = Tensor::Identity() + 1e-9 * deformations(1, 1)[0];
  const Mapped mapped = map_one(law_, rest, GetParam().state);
  EXPECT_FALSE(mapped.yielded);
  EXPECT_EQ(mapped.strain, rest);
  EXPECT_EQ(mapped.state, GetParam().state);
}

TEST_P(EveryMapping, FromFAndFromBAreTheSameAndNoRotationIsAdded) {
  const auto all = trials();
  std::vector<Tensor> b;
  for (const Tensor& F : all) b.push_back(F * F.transpose());
  const auto on_F = map(all), on_b = map(b, CLEAVE_FIELD_B);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Tensor returned = on_F[k].strain * on_F[k].strain.transpose();
    EXPECT_LT((returned - on_b[k].strain).norm(), 1e-11 * returned.norm()) << all[k];
    EXPECT_EQ(on_F[k].yielded, on_b[k].yielded);
    const Tensor V = on_F[k].strain * all[k].inverse();
    EXPECT_LT((V - V.transpose()).norm(), 1e-11 * V.norm()) << all[k];
  }
}

TEST_P(EveryMapping, TurnsWithTheBody) {
  const auto all = trials();
  const Tensor turn = Eigen::AngleAxisd(1.1, Eigen::Vector3d(3, -1, 2).normalized()).toRotationMatrix();
  std::vector<Tensor> b, turned;
  for (const Tensor& F : all) {
    b.push_back(F * F.transpose());
    turned.push_back(turn * b.back() * turn.transpose());
  }
  const auto here = map(b, CLEAVE_FIELD_B), there = map(turned, CLEAVE_FIELD_B);
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_LT((there[k].strain - turn * here[k].strain * turn.transpose()).norm(), 1e-11 * here[k].strain.norm()) << all[k];
    EXPECT_NEAR(there[k].state, here[k].state, 1e-11) << all[k];
  }
}

TEST_P(EveryMapping, ResultIsCoaxialWithTheTrial) {
  const auto all = trials();
  std::vector<Tensor> b;
  for (const Tensor& F : all) b.push_back(F * F.transpose());
  const auto mapped = map(b, CLEAVE_FIELD_B);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Tensor commutator = mapped[k].strain * b[k] - b[k] * mapped[k].strain;
    EXPECT_LT(commutator.norm(), 1e-12 * mapped[k].strain.norm() * b[k].norm()) << all[k];
  }
}

TEST_P(EveryMapping, SinglePrecisionAgrees) {
  const auto all = trials();
  const auto twice = map(all), once = map_all<float>(law_, all, GetParam().state);
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_EQ(once[k].status, CLEAVE_STATUS_OK) << all[k];
    EXPECT_LT((once[k].strain - twice[k].strain).norm(), 1e-4 * twice[k].strain.norm()) << all[k];
    EXPECT_NEAR(once[k].state, twice[k].state, 2e-5) << all[k];
  }
}

TEST_P(EveryMapping, StrainsWithoutLogarithmAreFatalAndNeighboursAreNot) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto mapped =
      map({diagonal_tensor(1.3, 1, 0.8), diagonal_tensor(1, 1, -1), diagonal_tensor(nan, 1, 1), diagonal_tensor(1.3, 1, 0.8)});
  EXPECT_EQ(mapped[0].status, CLEAVE_STATUS_OK);
  EXPECT_EQ(mapped[1].status, CLEAVE_STATUS_FATAL);
  EXPECT_EQ(mapped[2].status, CLEAVE_STATUS_FATAL);
  EXPECT_EQ(mapped[3].strain, mapped[0].strain);
}

/// det b > 0 though two eigenvalues are negative.
TEST_P(EveryMapping, NegativeSquaresOfStretchesAreFatalInLogarithmicStrain) {
  if (GetParam().law == PressureLaw::logarithmic) {  // others are returned on the invariants of b
    EXPECT_EQ(map({diagonal_tensor(1, -1, -2)}, CLEAVE_FIELD_B)[0].status, CLEAVE_STATUS_FATAL);
  }
}

std::string name_of(const ::testing::TestParamInfo<Case>& info) {
  std::string name = info.param.name;
  for (char& c : name)
    if (c == '-') c = '_';
  return name + std::to_string(int(info.param.law));
}
INSTANTIATE_TEST_SUITE_P(Mappings, EveryMapping,
                         ::testing::Values(Case{"hencky-von-mises", metal, 0.01}, Case{"hencky-drucker-prager", sand, 0},
                                           Case{"cohesive-cam-clay", clay, -0.01},
                                           Case{"cohesive-cam-clay", clay, -0.01, PressureLaw::quadratic},
                                           Case{"cohesive-cam-clay", clay, -0.01, PressureLaw::linear}),
                         name_of);

// ---------------------------------------------------------------- von Mises

TEST(HenckyVonMises, LandsOnTheHardenedSurfaceAndKeepsVolumeAndDirection) {
  const Instance law = mapping("hencky-von-mises", metal);
  for (const Tensor& F : trials()) {
    const Mapped mapped = map_one(law, F, 0.01);
    if (!mapped.yielded) continue;
    EXPECT_NEAR(shear(mapped.strain), 30 + 200 * mapped.state, 1e-10 * mu);
    EXPECT_NEAR(mapped.strain.determinant() / F.determinant(), 1, 1e-12);
    // q falls by 3 mu per plastic strain.
    EXPECT_NEAR(shear(F) - shear(mapped.strain), 3 * mu * (mapped.state - 0.01), 1e-10 * mu);
    const Tensor before = deviator(log_strain_of(F)), after = deviator(log_strain_of(mapped.strain));
    EXPECT_NEAR((before.array() * after.array()).sum(), before.norm() * after.norm(), 1e-12);
  }
}

/// Uniaxial yield at tau_y, shear yield at tau_y/sqrt(3): Kirchhoff stress, here from Hencky's solid.
TEST(HenckyVonMises, YieldsAtItsStressInTensionAndAtItsThirdRootInShear) {
  const Instance law = mapping("hencky-von-mises", {{"yield_stress", 30.0}});
  for (double part : {0.999, 1.001}) {
    const double e = part * 30 / 1000, gamma = part * 30 / std::sqrt(3) / (2 * mu);
    const Tensor tension = diagonal_tensor(std::exp(e), std::exp(-0.3 * e), std::exp(-0.3 * e));
    const Tensor pure_shear = diagonal_tensor(std::exp(gamma), std::exp(-gamma), 1);
    EXPECT_EQ(map_one(law, tension, 0).yielded, part > 1);
    EXPECT_EQ(map_one(law, pure_shear, 0).yielded, part > 1);
  }
}

/// A surface that a state rests on must not let rounding pass for plastic strain, step after step.
TEST(HenckyVonMises, RestingOnTheSurfaceInSinglePrecisionIsNoFlow) {
  const Instance law = mapping("hencky-von-mises", {{"yield_stress", 30.0}});
  std::vector<Tensor> b;
  for (const Tensor& F : trials()) b.push_back(F * F.transpose());
  const auto first = map_all<float>(law, b, 0, CLEAVE_FIELD_B);
  for (std::size_t k = 0; k < b.size(); ++k) b[k] = first[k].strain;
  for (const Mapped& again : map_all<float>(law, b, 0, CLEAVE_FIELD_B)) EXPECT_FALSE(again.yielded) << again.strain;
}

// ---------------------------------------------------------------- Drucker-Prager

TEST(HenckyDruckerPrager, LandsOnTheConeAtTheTrialsPressureOrOnItsApex) {
  const Instance law = mapping("hencky-drucker-prager", sand);
  const double sine = std::sin(35 * M_PI / 180), friction = std::sqrt(2. / 3) * 2 * sine / (3 - sine);
  int cone = 0, apex = 0;
  for (const Tensor& F : trials()) {
    const Mapped mapped = map_one(law, F, 0);
    if (!mapped.yielded) continue;
    const double p = pressure(mapped.strain);
    EXPECT_NEAR(std::sqrt(2. / 3) * shear(mapped.strain), 3 * friction * p + 2, 1e-10 * mu);
    if (pressure(F) > -2 / (3 * friction)) {
      EXPECT_NEAR(p, pressure(F), 1e-10 * kappa);
      EXPECT_EQ(mapped.state, 0);
      ++cone;
    } else {
      EXPECT_NEAR(p, -2 / (3 * friction), 1e-10 * kappa);
      EXPECT_NEAR(mapped.state, log_strain_of(F).trace() - log_strain_of(mapped.strain).trace(), 1e-12);
      ++apex;
    }
  }
  EXPECT_GT(cone, 10);
  EXPECT_GT(apex, 10);
}

TEST(HenckyDruckerPrager, RestingOnTheConeInSinglePrecisionIsNoFlow) {
  const Instance law =
      mapping("hencky-drucker-prager", {{"friction_angle", 35.0}, {"cohesion", 2.0}, {"volume_correction", false}});
  std::vector<Tensor> b;
  for (const Tensor& F : trials()) b.push_back(F * F.transpose());
  const auto first = map_all<float>(law, b, 0, CLEAVE_FIELD_B);
  for (std::size_t k = 0; k < b.size(); ++k) b[k] = first[k].strain;
  for (const Mapped& again : map_all<float>(law, b, 0, CLEAVE_FIELD_B)) EXPECT_FALSE(again.yielded) << again.strain;
}

/// q = 6 sin(phi)/(3 - sin(phi)) p in triaxial compression without cohesion.
TEST(HenckyDruckerPrager, TriaxialCompressionFollowsTheFrictionAngle) {
  for (double phi : {10.0, 30.0, 45.0}) {
    const Instance law = mapping("hencky-drucker-prager", {{"friction_angle", phi}});
    const Mapped mapped = map_one(law, diagonal_tensor(0.6, 1.2, 1.2), 0);
    const double sine = std::sin(phi * M_PI / 180);
    EXPECT_NEAR(shear(mapped.strain) / pressure(mapped.strain), 6 * sine / (3 - sine), 1e-12);
  }
}

/// Expanded and brought back in steps, the material is at rest again; without the correction it is compressed.
TEST(HenckyDruckerPrager, WhatOpenedClosesWithoutPressureAndNoVolumeIsLost) {
  for (bool correction : {true, false}) {
    const Instance law = mapping("hencky-drucker-prager", {{"friction_angle", 35.0}, {"volume_correction", correction}});
    Tensor F = Tensor::Identity();
    double state = 0, total = 0;
    const auto move = [&](double stretch) {
      F = diagonal_tensor(stretch, stretch, stretch) * F;
      total += 3 * std::log(stretch);
      const Mapped mapped = map_one(law, F, state);
      F = mapped.strain;
      state = mapped.state;
      if (correction) {
        EXPECT_NEAR(log_strain_of(F).trace() + state, total, 1e-13);
      }
    };
    for (int k = 0; k < 7; ++k) move(1.01);
    EXPECT_NEAR(pressure(F), 0, 1e-12 * kappa);
    // The last step overshoots: only the overshoot may compress.
    for (int k = 0; k < 5; ++k) move(1 / 1.015);
    const double closed = std::min(total, 0.0);
    if (correction) {
      EXPECT_NEAR(pressure(F), -kappa * closed, 1e-12 * kappa);
    } else {
      EXPECT_NEAR(pressure(F), kappa * 15 * std::log(1.015), 1e-12 * kappa);
    }
  }
}

TEST(HenckyDruckerPrager, WithoutFrictionItIsVonMisesAndHasNoApex) {
  const double y = 20;
  const Instance tresca = mapping("hencky-drucker-prager", {{"friction_angle", 0.0}, {"cohesion", y}});
  const Instance mises = mapping("hencky-von-mises", {{"yield_stress", std::sqrt(1.5) * y}});
  for (const Tensor& F : trials()) EXPECT_LT((map_one(tresca, F, 0).strain - map_one(mises, F, 0).strain).norm(), 1e-12);
  const Instance fluid = mapping("hencky-drucker-prager", {{"friction_angle", 0.0}});
  const Mapped mapped = map_one(fluid, diagonal_tensor(1.5, 1, 0.9), 0);
  EXPECT_NEAR(shear(mapped.strain), 0, 1e-12 * mu);
  EXPECT_NEAR(mapped.strain.determinant(), 1.35, 1e-12);
}

TEST(HenckyDruckerPrager, GainIsKeptAsItIsWithoutVolumeCorrection) {
  const Instance law = mapping("hencky-drucker-prager", {{"friction_angle", 35.0}, {"volume_correction", false}});
  EXPECT_EQ(map_one(law, diagonal_tensor(1.1, 1.1, 1.1), 0.25).state, 0.25);
}

// ---------------------------------------------------------------- cohesive Cam-Clay

struct Clay {
  double beta = 0.2, xi = 3, M = 1.85;
  PressureLaw law = PressureLaw::logarithmic;
  GivenParameters parameters() const {
    return {{"cohesion", beta}, {"hardening_factor", xi}, {"friction_slope", M}, {"alpha0", 0.0}};
  }
  double p0(double alpha) const { return kappa * (1e-5 + std::sinh(xi * std::max(-alpha, 0.0))); }

  /// p and q of the stress that the elastic law gives.
  std::pair<double, double> stress(const Tensor& F) const {
    if (law == PressureLaw::logarithmic) return {pressure(F), shear(F)};
    const IsochoricResponse response{mu, kappa, law};
    const double J = F.determinant();
    // The linear law's pressure counts as its maximum below J = 1/2.
    const double counted = law == PressureLaw::linear ? std::max(J, 0.5) : J;
    return {response.pressure(counted), std::sqrt(1.5) * mu * deviator(F * F.transpose()).norm() * std::pow(J, -2. / 3)};
  }
  double y(const Tensor& F, double alpha) const {
    const auto [p, q] = stress(F);
    return q * q * (1 + 2 * beta) + M * M * (p + beta * p0(alpha)) * (p - p0(alpha));
  }
};

class ClayOfEveryPressureLaw : public ::testing::TestWithParam<PressureLaw> {
 protected:
  Clay clay_{.law = GetParam()};
};

TEST_P(ClayOfEveryPressureLaw, LandsOnTheSurfaceOfTheElasticLawsStress) {
  const Instance law = mapping("cohesive-cam-clay", clay_.parameters(), GetParam());
  for (double alpha : {-0.05, -1e-3, 0.0}) {
    const double scale = clay_.M * clay_.M * clay_.p0(alpha) * clay_.p0(alpha);
    for (const Tensor& F : trials()) {
      const Mapped mapped = map_one(law, F, alpha);
      EXPECT_EQ(mapped.yielded, clay_.y(F, alpha) > 0) << F;
      // A strain of order 1 in b resolves pressures of kappa times the rounding.
      if (mapped.yielded) {
        EXPECT_LT(std::abs(clay_.y(mapped.strain, alpha)) / scale, 1e-13 + 4e-15 * kappa / clay_.p0(alpha)) << F;
      }
    }
  }
}

/// dln J = -dgamma tr G and dq = -3 mu' dgamma dy/dq with one dgamma >= 0: the flow is normal to the surface.
TEST_P(ClayOfEveryPressureLaw, FlowIsNormalToTheSurface) {
  const Instance law = mapping("cohesive-cam-clay", clay_.parameters(), GetParam());
  const double alpha = -0.05;
  int compared = 0;
  for (const Tensor& F : trials()) {
    const Mapped mapped = map_one(law, F, alpha);
    const auto [p, q] = clay_.stress(mapped.strain);
    const auto q_trial = clay_.stress(F).second;
    const double center = 0.5 * (1 - clay_.beta) * clay_.p0(alpha);
    if (!mapped.yielded || q < 1e-6 * mu || std::abs(p - center) < 1e-6 * kappa) continue;
    const double mean = (F * F.transpose()).trace() / 3 * std::pow(F.determinant(), -2. / 3);
    const double stiffness = GetParam() == PressureLaw::logarithmic ? mu : mu * mean;
    const double by_volume = std::log(mapped.strain.determinant() / F.determinant()) / (2 * clay_.M * clay_.M * (p - center));
    const double by_shear = (q_trial / q - 1) / (6 * stiffness * (1 + 2 * clay_.beta));
    EXPECT_GT(by_volume, 0) << F;
    EXPECT_NEAR(by_volume, by_shear, 1e-8 * by_shear) << F;
    EXPECT_NEAR(mapped.state - alpha, std::log(F.determinant() / mapped.strain.determinant()), 1e-12) << F;
    ++compared;
  }
  EXPECT_GT(compared, 20);
}

TEST_P(ClayOfEveryPressureLaw, PureChangesOfVolumeReturnToTheTips) {
  const Instance law = mapping("cohesive-cam-clay", clay_.parameters(), GetParam());
  const IsochoricResponse response{mu, kappa, GetParam()};
  const double p0 = clay_.p0(-0.05);
  const Mapped crushed = map_one(law, diagonal_tensor(0.8, 0.8, 0.8), -0.05);
  EXPECT_NEAR(crushed.strain.determinant(), response.jacobian(p0), 1e-13);
  EXPECT_NEAR(crushed.state, -0.05 + std::log(0.512 / response.jacobian(p0)), 1e-12);
  EXPECT_NEAR(map_one(law, diagonal_tensor(1.5, 1.5, 1.5), -0.05).strain.determinant(), response.jacobian(-0.2 * p0), 1e-13);
}

/// Newton's method has to reach the surface from any trial: stretches of 1e-3 to 1e3, p0 down to 1e-5 kappa.
TEST_P(ClayOfEveryPressureLaw, ConvergesFromTheMostDistantTrials) {
  std::vector<Tensor> far;
  for (double x : {-7.0, -2.0, -0.3, 0.0, 0.3, 2.0, 7.0})
    for (double y : {-7.0, -1.0, 0.0, 0.1, 7.0})
      for (double z : {-7.0, 0.0, 3.0}) far.push_back(diagonal_tensor(std::exp(x), std::exp(y), std::exp(z)));
  for (double M : {0.05, 1.0, 2.36})
    for (double beta : {0.0, 0.5, 10.0})
      for (double alpha : {-1.0, -0.1, 0.0}) {
        Clay clay{.beta = beta, .M = M, .law = GetParam()};
        const Instance law = mapping("cohesive-cam-clay", clay.parameters(), GetParam());
        const auto mapped = map_all(law, far, alpha);
        const auto single = map_all<float>(law, far, alpha);
        for (std::size_t k = 0; k < far.size(); ++k) {
          EXPECT_EQ(mapped[k].status, CLEAVE_STATUS_OK) << M << " " << beta << " " << alpha << "\n" << far[k];
          EXPECT_NE(single[k].status, CLEAVE_STATUS_RETRY) << M << " " << beta << " " << alpha << "\n" << far[k];
        }
      }
}

TEST_P(ClayOfEveryPressureLaw, TheUnitOfStressDoesNotMatter) {
  const auto all = trials();
  const auto soft = map_all(mapping("cohesive-cam-clay", clay_.parameters(), GetParam()), all, -0.02);
  const auto stiff = map_all(mapping("cohesive-cam-clay", clay_.parameters(), GetParam(), 1e6), all, -0.02);
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_EQ(soft[k].yielded, stiff[k].yielded);
    EXPECT_LT((soft[k].strain - stiff[k].strain).norm(), 1e-13 * soft[k].strain.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Laws, ClayOfEveryPressureLaw,
                         ::testing::Values(PressureLaw::quadratic, PressureLaw::linear, PressureLaw::logarithmic),
                         [](const auto& info) {
                           return std::string(info.param == PressureLaw::quadratic ? "Quadratic"
                                              : info.param == PressureLaw::linear  ? "Linear"
                                                                                   : "Logarithmic");
                         });

TEST(CohesiveCamClay, CrushingHardensAndTensionSoftensUnlessSwitchedOff) {
  GivenParameters parameters = Clay{}.parameters();
  EXPECT_LT(map_one(mapping("cohesive-cam-clay", parameters), diagonal_tensor(0.8, 0.9, 0.9), -0.01).state, -0.01);
  EXPECT_GT(map_one(mapping("cohesive-cam-clay", parameters), diagonal_tensor(1.2, 1, 1), -0.01).state, -0.01);
  parameters["hardening"] = false;
  EXPECT_EQ(map_one(mapping("cohesive-cam-clay", parameters), diagonal_tensor(1.2, 1, 1), -0.01).state, -0.01);
}

TEST(CohesiveCamClay, FrictionAngleIsAnotherNameOfTheSlope) {
  GivenParameters by_slope = Clay{}.parameters(), by_angle = by_slope;
  by_slope["friction_slope"] = 6 * 0.5 / 2.5;
  by_angle.erase("friction_slope");
  by_angle["friction_angle"] = 30.0;
  const Tensor F = diagonal_tensor(0.8, 1.1, 0.9);
  EXPECT_LT((map_one(mapping("cohesive-cam-clay", by_slope), F, -0.02).strain -
             map_one(mapping("cohesive-cam-clay", by_angle), F, -0.02).strain)
                .norm(),
            1e-13);
}

}  // namespace
}  // namespace cleave::plugins::test
