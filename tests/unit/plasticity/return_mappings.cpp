#include "mapping.hpp"

#include <cfloat>
#include <limits>

namespace cleave::plugins::test {
namespace {

using namespace std::string_literals;

/// Non-associated Cam-Clay in the test's own words.
struct Ellipse {
  double beta = 0.5, xi = 3, M = 2.36;

  GivenParameters parameters(bool hardening, const char* closure = "exact") const {
    return {{"cohesion", beta}, {"hardening_factor", xi}, {"friction_slope", M},
            {"alpha0", -0.04},  {"hardening", hardening}, {"closure", std::string(closure)}};
  }
  double p0(double alpha, double bulk = kappa) const { return bulk * (1e-5 + std::sinh(xi * std::max(-alpha, 0.))); }
  double y(double p, double q, double p0) const { return q * q * (1 + 2 * beta) + M * M * (p + beta * p0) * (p - p0); }
};
constexpr double packed = -0.04;

Mapping nacc(bool hardening = false, IsochoricResponse elastic = {mu, kappa, PressureLaw::quadratic}) {
  return Mapping("plasticity/nacc", Ellipse().parameters(hardening), elastic);
}
Mapping von_mises(double H = 0, IsochoricResponse elastic = {mu, kappa, PressureLaw::quadratic}) {
  return Mapping("plasticity/von-mises", {{"yield_stress", 20.}, {"hardening_modulus", H}}, elastic);
}
Mapping drucker_prager(double phi = 30, double cohesion = 25, bool correction = true,
                       IsochoricResponse elastic = {mu, kappa, PressureLaw::quadratic}) {
  return Mapping("plasticity/drucker-prager",
                 {{"friction_angle", phi}, {"cohesion", cohesion}, {"volume_correction", correction}}, elastic);
}
double friction(double phi) {
  return std::sqrt(6.) * 2 * std::sin(phi * M_PI / 180) / (3 - std::sin(phi * M_PI / 180));  // 3 c_f
}

struct Case {
  Mapping mapping;
  double state;
  std::string name;
};
/// Every law on every pressure law, without what would move the yield surface in a return.
std::vector<Case> perfect_laws() {
  std::vector<Case> cases;
  for (PressureLaw law : pressure_laws) {
    const IsochoricResponse elastic{mu, kappa, law};
    const std::string on = " on pressure law " + std::to_string(int(law));
    cases.push_back({nacc(false, elastic), packed, "nacc" + on});
    cases.push_back({von_mises(0, elastic), 0, "von-mises" + on});
    cases.push_back({drucker_prager(30, 25, true, elastic), 0, "drucker-prager" + on});
  }
  return cases;
}

/// A third nearly at rest, a third sheared at little change of volume (J = 0.92 to 1.04), a third strained at will.
std::vector<Tensor> trials() {
  std::vector<Tensor> all = deformations(48, 0.5);
  for (std::size_t k = 0; k < all.size(); k += 3) all[k] = Tensor::Identity() + 1e-3 * all[k];
  for (std::size_t k = 1; k < all.size(); k += 3) all[k] *= std::cbrt((0.92 + 0.0025 * double(k)) / all[k].determinant());
  return all;
}

template <class S>
void keeps_volume_and_direction_in_shear(double tolerance) {
  for (const auto& [mapping, state, name] : perfect_laws()) {
    int sheared = 0;
    const auto b = strains(trials());
    const auto points = mapping.template of_b<S>(b, state);
    for (std::size_t i = 0; i < b.size(); ++i) {
      EXPECT_EQ(points[i].status, CLEAVE_STATUS_OK);
      const Tensor s = mapping.deviatoric_stress(b[i]), s_new = mapping.deviatoric_stress(points[i].strain);
      if (!points[i].yielded || s_new.norm() < 1e-4 * s.norm()) continue;
      ++sheared;
      EXPECT_NEAR(points[i].strain.determinant() / b[i].determinant(), 1, tolerance) << name;
      EXPECT_NEAR(mapping.pressure(points[i].strain), mapping.pressure(b[i]), tolerance * kappa) << name;
      EXPECT_LT((s_new - s_new.norm() / s.norm() * s).norm(), tolerance * mu) << name;
    }
    EXPECT_GT(sheared, 10) << name;
  }
}
TEST(ReturnMappings, KeepVolumePressureAndDirectionInShear) { keeps_volume_and_direction_in_shear<double>(1e-12); }
TEST(ReturnMappings, KeepVolumePressureAndDirectionInShearInSinglePrecision) {
  keeps_volume_and_direction_in_shear<float>(1e-5);
}

TEST(ReturnMappings, ARotatedTrialGivesTheRotatedResult) {
  const Tensor turn = Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
  for (const auto& [mapping, state, name] : perfect_laws()) {
    std::vector<Tensor> b = strains(trials()), turned;
    for (const Tensor& x : b) turned.push_back(turn * x * turn.transpose());
    const auto points = mapping.of_b(b, state), others = mapping.of_b(turned, state);
    for (std::size_t i = 0; i < b.size(); ++i) {
      EXPECT_EQ(points[i].yielded, others[i].yielded) << name;
      EXPECT_LT((turn * points[i].strain * turn.transpose() - others[i].strain).norm(), 1e-12) << name;
      EXPECT_NEAR(points[i].state, others[i].state, 1e-12) << name;
    }
  }
}

TEST(ReturnMappings, GiveTheSameFromFAndFromB) {
  for (const auto& [mapping, state, name] : perfect_laws()) {
    const auto F = trials();
    const auto on_F = mapping.of_F(F, state), on_b = mapping.of_b(strains(F), state);
    for (std::size_t i = 0; i < F.size(); ++i) {
      EXPECT_EQ(on_F[i].yielded, on_b[i].yielded) << name;
      EXPECT_LT((on_F[i].strain * on_F[i].strain.transpose() - on_b[i].strain).norm(), 2e-12) << name;
      EXPECT_NEAR(on_F[i].state, on_b[i].state, 1e-12) << name;
    }
  }
}

template <class S>
void do_nothing_to_a_returned_state(double tolerance) {
  for (const auto& [mapping, state, name] : perfect_laws())
    for (const auto& once : mapping.template of_b<S>(strains(trials()), state)) {
      const auto twice = mapping.template of_b<S>(once.strain, once.state);
      EXPECT_LT((twice.strain - once.strain).norm(), tolerance * once.strain.norm()) << name;
      EXPECT_NEAR(twice.state, once.state, tolerance) << name;
    }
}
TEST(ReturnMappings, DoNothingToAReturnedState) { do_nothing_to_a_returned_state<double>(1e-13); }
TEST(ReturnMappings, DoNothingToAReturnedStateInSinglePrecision) { do_nothing_to_a_returned_state<float>(5e-6); }

TEST(ReturnMappings, LeaveElasticTrialsAloneToTheBit) {
  for (const auto& [mapping, state, name] : perfect_laws()) {
    const auto b = strains(trials());
    const auto points = mapping.of_b(b, state);
    int elastic = 0;
    for (std::size_t i = 0; i < b.size(); ++i)
      if (!points[i].yielded) {
        ++elastic;
        EXPECT_EQ(points[i].strain, b[i]) << name;
        EXPECT_EQ(points[i].state, state) << name;
      }
    EXPECT_GT(elastic, 10) << name << ": a third of the trials is nearly at rest";
  }
}

/// The strain of volume ratio J whose deviatoric stress is q, in uniaxial extension.
Tensor at(double J, double q) {
  const double a = 2 * q / (3 * mu), squared = 1.5 * a * a;  // deviator a (1, -1/2, -1/2)
  double x = 1;
  for (int i = 0; i < 20; ++i) x -= (x * x * x - squared / 2 * x + a * a * a / 4 - 1) / (3 * x * x - squared / 2);
  return std::pow(J, 2. / 3) * stretched(x + a, x - a / 2, x - a / 2);
}

TEST(ReturnMappings, YieldJustBeyondTheSurface) {
  const Ellipse ellipse;
  for (double beyond : {-1e-8, 1e-8}) {
    const bool yields = beyond > 0;
    EXPECT_EQ(von_mises().of_b(at(0.9, 20 * (1 + beyond)), 0).yielded, yields);

    const double p = 0.02 * kappa, J = std::sqrt(1 - 2 * p / kappa), cone = std::sqrt(1.5) * (friction(30) * p + 25);
    EXPECT_EQ(drucker_prager().of_b(at(J, cone * (1 + beyond)), 0).yielded, yields);

    const double p0 = ellipse.p0(packed);
    const double rim = ellipse.M * std::sqrt((p + ellipse.beta * p0) * (p0 - p) / (1 + 2 * ellipse.beta));
    EXPECT_EQ(nacc().of_b(at(J, rim * (1 + beyond)), packed).yielded, yields);

    // At the floor of p0, where a tolerance not relative to p0 would be felt first.
    const double floor = 1e-5 * kappa * (1 + 100 * beyond);
    EXPECT_EQ(nacc().of_b(std::cbrt(1 - 2 * floor / kappa) * Tensor::Identity(), 0).yielded, yields);
  }
}

/// Moduli and strengths a million times as large: stresses so, too, and the same strain.
TEST(ReturnMappings, DoNotDependOnTheUnitOfStress) {
  const auto b = strains(trials());
  const double unit = 1e6;
  const IsochoricResponse stiff{unit * mu, unit * kappa, PressureLaw::quadratic};
  const std::pair<Mapping, Mapping> pairs[] = {
      {nacc(true), nacc(true, stiff)},
      {von_mises(50), Mapping("plasticity/von-mises", {{"yield_stress", 20 * unit}, {"hardening_modulus", 50 * unit}}, stiff)},
      {drucker_prager(30, 25), drucker_prager(30, 25 * unit, true, stiff)}};
  for (const auto& [soft, hard] : pairs)
    for (double state : {-1e-6, 0., packed}) {  // Cam-Clay: without strength but for the floor of p0, and packed
      if (state < 0 && &soft != &pairs[0].first) continue;
      const auto points = soft.of_b(b, state), others = hard.of_b(b, state);
      for (std::size_t i = 0; i < b.size(); ++i) {
        EXPECT_EQ(points[i].yielded, others[i].yielded);
        EXPECT_LT((points[i].strain - others[i].strain).norm(), 1e-12);
        EXPECT_NEAR(points[i].state, others[i].state, 1e-10);
      }
    }
}

/// Trials far outside of what a step brings: the result is finite, with positive volume, or the point says that it is not.
template <class S>
void survive_extreme_trials() {
  const Tensor I = Tensor::Identity();
  std::vector<Tensor> b = {I,
                           1e-6 * I,
                           1e6 * I,
                           stretched(1e4, 1e-2, 1e-2),
                           stretched(1e-4, 1e2, 1e2),
                           1e-4 * stretched(4, .5, .5),
                           1e4 * stretched(4, .5, .5),
                           stretched(100, 1, 1),
                           stretched(1, 1, 1e-3),
                           stretched(1 + 1e-7, 1, 1),
                           stretched(1e2, 1, 1e-2)};
  for (const auto& [mapping, state, name] : perfect_laws()) {
    const auto points = mapping.template of_b<S>(b, state);
    for (std::size_t i = 0; i < b.size(); ++i) {
      EXPECT_EQ(points[i].status, CLEAVE_STATUS_OK) << name << " " << i;
      EXPECT_TRUE(points[i].strain.allFinite() && std::isfinite(points[i].state)) << name << " " << i;
      EXPECT_GT(points[i].strain.determinant(), 0) << name << " " << i;
      EXPECT_LE(mapping.q(points[i].strain), mapping.q(b[i]) * (1 + 1e-5) + 1e-5 * mu) << name << " " << i;
    }
    EXPECT_FALSE(points[0].yielded) << name << ": a state at rest";
  }
}
TEST(ReturnMappings, SurviveExtremeTrials) { survive_extreme_trials<double>(); }
TEST(ReturnMappings, SurviveExtremeTrialsInSinglePrecision) { survive_extreme_trials<float>(); }

// ---------------------------------------------------------------- non-associated Cam-Clay

template <class S>
void lands_on_the_ellipse(double tolerance) {
  const Ellipse ellipse;
  const double p0 = ellipse.p0(packed);
  for (PressureLaw pressure_law : pressure_laws) {
    const Mapping law = nacc(false, {mu, kappa, pressure_law});
    int crushed = 0, torn = 0, sheared = 0;
    const auto b = strains(trials());
    const auto points = law.of_b<S>(b, packed);
    for (std::size_t i = 0; i < b.size(); ++i) {
      const double p_trial = law.pressure(b[i]), q_trial = law.q(b[i]);
      const double p = law.pressure(points[i].strain), q = law.q(points[i].strain);
      EXPECT_EQ(points[i].yielded, ellipse.y(p_trial, q_trial, p0) > 0);
      if (!points[i].yielded) continue;
      EXPECT_NEAR(ellipse.y(p, q, p0), 0, tolerance * kappa * kappa);
      if (p_trial > p0 || p_trial < -ellipse.beta * p0) {
        ++(p_trial > p0 ? crushed : torn);
        EXPECT_NEAR(p, p_trial > p0 ? p0 : -ellipse.beta * p0, tolerance * kappa);
        EXPECT_NEAR(q, 0, tolerance * kappa);
      } else {
        ++sheared;
        EXPECT_NEAR(p, p_trial, tolerance * kappa);
      }
    }
    EXPECT_GT(std::min({crushed, torn, sheared}), 2) << "every part of the ellipse is tried";
  }
}
TEST(Nacc, LandsOnTheEllipse) { lands_on_the_ellipse<double>(1e-12); }
TEST(Nacc, LandsOnTheEllipseInSinglePrecision) { lands_on_the_ellipse<float>(1e-5); }

TEST(Nacc, HardensByCompactionAndSoftensByExpansionAtTheTips) {
  const Ellipse ellipse;
  for (PressureLaw pressure_law : pressure_laws) {
    const Mapping law = nacc(true, {mu, kappa, pressure_law});
    const double p0 = ellipse.p0(packed);
    for (double J : {0.7, 1.3}) {
      const auto point = law.of_b(std::pow(J, 2. / 3) * Tensor::Identity(), packed);
      const double J_tip = law.elastic.jacobian(J < 1 ? p0 : -ellipse.beta * p0);
      EXPECT_NEAR(point.strain.determinant(), J_tip * J_tip, 1e-13);
      EXPECT_NEAR(point.state, packed + std::log(J / J_tip), 1e-13);
    }
  }
}

/// The ray from the centre leaves the ellipse where y = 0, found by bisection.
TEST(Nacc, HardensInShearByWhereTheRayFromTheCentreLeavesTheEllipse) {
  const Ellipse ellipse;
  const Mapping law = nacc(true);
  const double p0 = ellipse.p0(packed), center = (1 - ellipse.beta) * p0 / 2;
  const auto b = strains(trials());
  const auto points = law.of_b(b, packed);
  int harder = 0, softer = 0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    const double p = law.pressure(b[i]), q = law.q(b[i]);
    if (!points[i].yielded || p > p0 || p < -ellipse.beta * p0) continue;
    double inside = 0, outside = 1;
    for (int n = 0; n < 60; ++n) {
      const double t = (inside + outside) / 2;
      (ellipse.y(center + t * (p - center), t * q, p0) < 0 ? inside : outside) = t;
    }
    const double J_exit = law.elastic.jacobian(center + inside * (p - center));
    EXPECT_NEAR(points[i].state, packed + std::log(std::sqrt(b[i].determinant()) / J_exit), 1e-12);
    EXPECT_EQ(points[i].state<packed, p> center);
    ++(p > center ? harder : softer);
  }
  EXPECT_GT(std::min(harder, softer), 2);
}

TEST(Nacc, WithoutHardeningAlphaStays) {
  for (const auto& point : nacc(false).of_b(strains(trials()), packed)) EXPECT_EQ(point.state, packed);
}

/// Loosened material keeps the floor p0 = 1e-5 kappa.
TEST(Nacc, LoosenedMaterialHasAnEllipseToReturnTo) {
  const Ellipse ellipse;
  const auto b = strains(trials());
  for (double alpha : {0., 0.3}) {
    const Mapping law = nacc(true);
    const auto points = law.of_b(b, alpha);
    for (std::size_t i = 0; i < b.size(); ++i) {
      EXPECT_EQ(points[i].status, CLEAVE_STATUS_OK);
      const double p = law.pressure(points[i].strain), q = law.q(points[i].strain), p0 = 1e-5 * kappa;
      EXPECT_LT(ellipse.y(p, q, p0), 1e-12 * kappa * p0);
      if (law.pressure(b[i]) > p0) {
        EXPECT_NEAR(p, p0, 1e-14 * kappa);
      }
    }
  }
}

/// sinh(3 0.5) kappa is three times the largest pressure of the quadratic law, and more than any of the linear one.
TEST(Nacc, HardMaterialCanStillBeCrushed) {
  for (PressureLaw pressure_law : pressure_laws) {
    const Mapping law = nacc(true, {mu, kappa, pressure_law});
    for (double alpha : {-0.5, -1000.}) {
      const double J = 0.01;
      const auto point = law.of_b(std::pow(J, 2. / 3) * Tensor::Identity(), alpha);
      EXPECT_TRUE(point.yielded);
      const double largest = pressure_law == PressureLaw::linear ? 0.2475 * kappa : law.elastic.pressure(0.1);
      const double limit = law.elastic.jacobian(std::min(largest, Ellipse().p0(alpha)));
      EXPECT_EQ(point.status, Ellipse().p0(alpha) > largest ? CLEAVE_STATUS_UNRELIABLE : CLEAVE_STATUS_OK);
      EXPECT_NEAR(point.strain.determinant(), limit * limit, 1e-13);
      EXPECT_NEAR(point.state, alpha + std::log(J / limit), 1e-12);
    }
  }
}

TEST(Nacc, FrictionAngleIsTheSlopeOfItsTriaxialCone) {
  GivenParameters by_slope = Ellipse().parameters(true), by_angle = by_slope;
  by_slope["friction_slope"] = 1.2;  // 6 sin(30)/(3 - sin(30)) = 3/2.5
  by_angle.erase("friction_slope");
  by_angle["friction_angle"] = 30.;
  const Mapping slope("plasticity/nacc", by_slope), angle("plasticity/nacc", by_angle);
  const auto b = strains(trials());
  const auto left = slope.of_b(b, packed), right = angle.of_b(b, packed);
  for (std::size_t i = 0; i < b.size(); ++i) EXPECT_LT((left[i].strain - right[i].strain).norm(), 1e-13);
}

TEST(Nacc, BeginsAtAlpha0) { EXPECT_EQ(nacc().law.initial_state(), std::vector<double>{-0.04}); }

// ---------------------------------------------------------------- von Mises

template <class S>
void flows_at_its_yield_stress(double tolerance) {
  for (double H : {0., 50., 1e4}) {
    const Mapping law = von_mises(H);
    const auto b = strains(trials());
    const double before = 0.1;
    const auto points = law.of_b<S>(b, before);
    int flowed = 0;
    for (std::size_t i = 0; i < b.size(); ++i) {
      EXPECT_EQ(points[i].yielded, law.q(b[i]) > 20 + H * before);
      if (!points[i].yielded) continue;
      ++flowed;
      const double q = law.q(points[i].strain), effective = mu / std::cbrt(b[i].determinant()) * b[i].trace() / 3;
      EXPECT_NEAR(q, 20 + H * points[i].state, tolerance * (mu + H)) << "q_new = tau_y + H alpha_new, H = " << H;
      EXPECT_NEAR(points[i].state - before, (law.q(b[i]) - q) / (3 * effective), tolerance * (1 + H / mu));
      EXPECT_GT(points[i].state, before);
    }
    EXPECT_TRUE(flowed > 10 || H == 1e4);
  }
}
TEST(VonMises, FlowsAtTheYieldStressOfItsNewPlasticStrain) { flows_at_its_yield_stress<double>(1e-12); }
TEST(VonMises, FlowsAtTheYieldStressOfItsNewPlasticStrainInSinglePrecision) { flows_at_its_yield_stress<float>(2e-6); }

TEST(VonMises, PressureDoesNotYield) {
  for (double J : {0.01, 0.5, 2., 100.}) EXPECT_FALSE(von_mises().of_b(std::pow(J, 2. / 3) * Tensor::Identity(), 0).yielded);
}

// ---------------------------------------------------------------- Drucker-Prager

template <class S>
void lands_on_the_cone(double tolerance) {
  for (PressureLaw pressure_law : pressure_laws)
    for (double phi : {0., 30., 40.})
      for (double cohesion : {0., 25.}) {
        const Mapping law = drucker_prager(phi, cohesion, true, {mu, kappa, pressure_law});
        const double apex = phi > 0 ? -cohesion / friction(phi) : -std::numeric_limits<double>::infinity();
        const auto b = strains(trials());
        const auto points = law.of_b<S>(b, 0);
        for (std::size_t i = 0; i < b.size(); ++i) {
          const double p_trial = law.pressure(b[i]), p = law.pressure(points[i].strain);
          const double limit = friction(phi) * p + cohesion, size = law.deviatoric_stress(points[i].strain).norm();
          if (p_trial < apex - tolerance * kappa) {
            EXPECT_TRUE(points[i].yielded);
            EXPECT_NEAR(p, apex, tolerance * kappa);
            EXPECT_NEAR(size, 0, tolerance * kappa);
          } else if (points[i].yielded && p_trial > apex + tolerance * kappa) {
            EXPECT_NEAR(size, limit, tolerance * kappa);
            EXPECT_NEAR(p, p_trial, tolerance * kappa);
          } else {
            EXPECT_LE(size, limit + tolerance * kappa);
          }
        }
      }
}
TEST(DruckerPrager, LandsOnTheConeOrItsApex) { lands_on_the_cone<double>(1e-12); }
TEST(DruckerPrager, LandsOnTheConeOrItsApexInSinglePrecision) { lands_on_the_cone<float>(1e-5); }

TEST(DruckerPrager, WithoutFrictionStrengthDoesNotDependOnPressureAndTensionIsCarried) {
  const Mapping law = drucker_prager(0, 25);
  for (double scale : {0.5, 1., 2.}) {
    const auto point = law.of_b(scale * stretched(1.5, 1, 0.8), 0);
    EXPECT_NEAR(law.deviatoric_stress(point.strain).norm(), 25, 1e-12 * mu);
  }
  EXPECT_FALSE(law.of_b(4 * Tensor::Identity(), 0).yielded);
}

TEST(DruckerPrager, ClosesTheVolumeItGainedBeforeItResists) {
  for (PressureLaw pressure_law : pressure_laws)
    for (double cohesion : {0., 25.}) {
      const Mapping law = drucker_prager(30, cohesion, true, {mu, kappa, pressure_law});
      const double J_apex = law.elastic.jacobian(-cohesion / friction(30));
      const auto compressed = [](const Tensor& b, double factor) -> Tensor { return std::pow(factor, 2. / 3) * b; };

      // Pulled open by 10 %: without shear, the gain is what lies beyond the apex.
      const auto open = law.of_b(compressed(stretched(1.2, 1, 1 / 1.2), 1.1 * J_apex), 0);
      EXPECT_NEAR(std::sqrt(open.strain.determinant()), J_apex, 1e-13);
      EXPECT_NEAR(open.state, std::log(1.1), 1e-13);

      // Half way back: still nothing resists.
      const auto half = law.of_b(compressed(open.strain, 1 / 1.05), open.state);
      EXPECT_NEAR(std::sqrt(half.strain.determinant()), J_apex, 1e-13);
      EXPECT_NEAR(half.state, std::log(1.1 / 1.05), 1e-13);

      // 5 % beyond where it began: only these are elastic, and the gain is used up.
      const auto closed = law.of_b(compressed(half.strain, 1 / (1.1 / 1.05) / 1.05), half.state);
      EXPECT_NEAR(std::sqrt(closed.strain.determinant()), J_apex / 1.05, 1e-13);
      EXPECT_EQ(closed.state, 0);
      EXPECT_TRUE(closed.yielded) << "the strain was changed";
      EXPECT_FALSE(law.of_b(closed.strain, closed.state).yielded);
    }
}

TEST(DruckerPrager, WithoutTheCorrectionItIsPushedApart) {
  const Mapping law = drucker_prager(30, 0, false);
  const auto open = law.of_b(std::pow(1.1, 2. / 3) * Tensor::Identity(), 0);
  EXPECT_EQ(open.state, 0);
  const auto back = law.of_b(std::pow(1 / 1.1, 2. / 3) * open.strain, 0);
  EXPECT_GT(law.pressure(back.strain), 0.05 * kappa) << "back at its old volume, it resists";
}

// ---------------------------------------------------------------- parameters

std::string refusal(const std::string& id, GivenParameters parameters) {
  try {
    Mapping(id, parameters);
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

TEST(Parameters, ThatTheLawsCannotMeanAreRefusedWithTheReason) {
  GivenParameters clay = Ellipse().parameters(true);
  clay["friction_angle"] = 30.;
  EXPECT_NE(refusal("plasticity/nacc", clay).find("friction_slope, or friction_angle"), std::string::npos)
      << refusal("plasticity/nacc", clay);
  clay = Ellipse().parameters(true);
  clay["closure"] = "volume"s;
  EXPECT_NE(refusal("plasticity/nacc", clay).find(R"(must be one of "exact", "trace")"), std::string::npos)
      << refusal("plasticity/nacc", clay);
  EXPECT_NE(refusal("plasticity/von-mises", {{"yield_stress", 0.}}).find("greater than 0 Pa"), std::string::npos);
  EXPECT_NE(refusal("plasticity/von-mises", {{"yield_stress", 1.}, {"hardening_modulus", -1.}}).find("at least 0 Pa"),
            std::string::npos);
  EXPECT_NE(refusal("plasticity/drucker-prager", {{"friction_angle", 91.}}).find("must be in [0, 90] degrees"),
            std::string::npos)
      << refusal("plasticity/drucker-prager", {{"friction_angle", 91.}});
}

}  // namespace
}  // namespace cleave::plugins::test
