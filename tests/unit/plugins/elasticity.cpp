#include "common/error.hpp"
#include "law_driver.hpp"
#include "strains.hpp"

#include <gmock/gmock.h>

#include <limits>

namespace cleave::plugins::test {
namespace {

const std::vector<Tensor>& samples() {
  static const std::vector<Tensor> all = deformations(64, 0.4);
  return all;
}

Field strains(cleave_field_id measure, const std::vector<Tensor>& deformations = samples()) {
  Field field;
  for (const Tensor& F : deformations) field.push_back(measure == CLEAVE_FIELD_F ? row_major(F) : left_cauchy_green(F));
  return field;
}

double largest(const std::vector<double>& values) {
  double most = 0;
  for (double value : values) most = std::max(most, std::abs(value));
  return most;
}

void expect_near(const std::vector<double>& actual, const std::vector<double>& expected, double relative, double scale_at_least,
                 const std::string& what) {
  ASSERT_EQ(actual.size(), expected.size()) << what;
  const double tolerance = relative * std::max(largest(expected), scale_at_least);
  for (std::size_t i = 0; i < actual.size(); ++i) EXPECT_NEAR(actual[i], expected[i], tolerance) << what << ", component " << i;
}

struct Law {
  const char* id;
  bool fixture;
  double modulus;  ///< for the scale of errors
  Instance make() const { return Instance((fixture ? sound_fixtures() : built_plugins()).load(id), stiff(modulus), {}); }
  bool accepts_b(const Instance& law) const { return law.description().can(CLEAVE_ACCEPTS_B); }
};

constexpr Law neo_hookean{"elasticity/split-neo-hookean", false, 1000};
constexpr Law corotated{"elasticity/fixed-corotated", false, 1000};
constexpr Law energy_only{"elasticity/energy-only", true, 1000};
constexpr Law fibrous{"elasticity/fibrous", true, 1000};

class EveryLaw : public ::testing::TestWithParam<Law> {
 protected:
  Instance law_ = GetParam().make();
  cleave_field_id measure() const { return GetParam().accepts_b(law_) ? CLEAVE_FIELD_B : CLEAVE_FIELD_F; }

  /// Tau of every sample, one call.
  template <class S>
  Field stresses(LawDriver<S>& driver, std::uint32_t count) {
    EXPECT_EQ(driver.run(evaluate<S>(law_), law_.handle(), count), CLEAVE_OK);
    Field all;
    for (std::uint32_t k = 0; k < count; ++k) {
      EXPECT_EQ(driver.status(k), CLEAVE_STATUS_OK) << k;
      all.push_back(driver.value(CLEAVE_FIELD_TAU, k));
    }
    return all;
  }
  double energy(const Tensor& F, double g) {
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, {row_major(F)}).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_ENERGY, 1);
    driver.run(evaluate<double>(law_), law_.handle(), 1);
    return driver.value(CLEAVE_FIELD_ENERGY, 0)[0];
  }
  Tensor stress(const Tensor& F, double g) {
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, {row_major(F)}).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_TAU, 6);
    driver.run(evaluate<double>(law_), law_.handle(), 1);
    return tensor(driver.value(CLEAVE_FIELD_TAU, 0));
  }
};

TEST_P(EveryLaw, StressIsTheDerivativeOfTheEnergy) {
  for (double g : {1.0, 0.25}) {
    for (int k = 0; k < 12; ++k) {
      const Tensor& F = samples()[k];
      const Tensor P = stress(F, g) * F.transpose().inverse();
      Tensor differences;
      const double h = 1e-5;
      for (int i = 0; i < 9; ++i) {
        Tensor plus = F, minus = F;
        plus.data()[i] += h;
        minus.data()[i] -= h;
        differences.data()[i] = (energy(plus, g) - energy(minus, g)) / (2 * h);
      }
      expect_near(row_major(P), row_major(differences), 1e-6, GetParam().modulus, "g " + std::to_string(g));
    }
  }
}

TEST_P(EveryLaw, SingleAndDoublePrecisionAgree) {
  LawDriver<float> single;
  LawDriver<double> twice;
  single.input(measure(), strains(measure())).output(CLEAVE_FIELD_TAU, 6);
  twice.input(measure(), strains(measure())).output(CLEAVE_FIELD_TAU, 6);
  const Field a = stresses(single, 64), b = stresses(twice, 64);
  for (int k = 0; k < 64; ++k) expect_near(a[k], b[k], 1e-4, 0.1 * GetParam().modulus, "point " + std::to_string(k));
}

TEST_P(EveryLaw, AnyCountGivesTheSamePointsBitwise) {
  LawDriver<float> all;
  all.input(measure(), strains(measure())).output(CLEAVE_FIELD_TAU, 6);
  const Field reference = stresses(all, 64);
  for (std::uint32_t count : {0u, 1u, 7u, 16u, 33u}) {
    LawDriver<float> some;
    some.input(measure(), strains(measure())).output(CLEAVE_FIELD_TAU, 6);
    const Field result = stresses(some, count);
    for (std::uint32_t k = 0; k < count; ++k) EXPECT_EQ(result[k], reference[k]) << count << " " << k;
  }
}

TEST_P(EveryLaw, ScatteredComponentsAndConstantsGiveTheSameBitwise) {
  const double g = 0.5;
  const Field degradation(64, std::vector<double>{g});
  const auto fiber = std::vector<double>{0.6, 0, 0.8};
  const auto run = [&](Placement placement, bool constant) {
    LawDriver<double> driver(placement);
    driver.input(measure(), strains(measure())).output(CLEAVE_FIELD_TAU, 6);
    if (constant)
      driver.constant(CLEAVE_FIELD_DEGRADATION, {g}).constant(CLEAVE_FIELD_FIBER, fiber);
    else
      driver.input(CLEAVE_FIELD_DEGRADATION, degradation).input(CLEAVE_FIELD_FIBER, Field(64, fiber));
    return stresses(driver, 33);
  };
  const Field reference = run(Placement::dense, false);
  EXPECT_EQ(run(Placement::dense, true), reference);
  EXPECT_EQ(run(Placement::scattered, false), reference);
  EXPECT_EQ(run(Placement::scattered, true), reference);
}

TEST_P(EveryLaw, OutputsAreIndependentOfWhichOthersAreAskedFor) {
  const std::vector<std::pair<cleave_field_id, unsigned>> outputs{{CLEAVE_FIELD_TAU, 6},
                                                                  {CLEAVE_FIELD_ENERGY, 1},
                                                                  {CLEAVE_FIELD_TENSILE_ENERGY, 1},
                                                                  {CLEAVE_FIELD_EFFECTIVE_STRESS, 6},
                                                                  {CLEAVE_FIELD_WAVE_MODULUS, 1},
                                                                  {CLEAVE_FIELD_PIOLA, 9},
                                                                  {CLEAVE_FIELD_DELTA_P, 9}};
  const auto with_inputs = [&] {
    LawDriver<double> driver(Placement::scattered);
    driver.input(CLEAVE_FIELD_F, strains(CLEAVE_FIELD_F)).input(CLEAVE_FIELD_DELTA_F, strains(CLEAVE_FIELD_F));
    driver.constant(CLEAVE_FIELD_DEGRADATION, {0.75});
    return driver;
  };
  auto all = with_inputs();
  for (const auto& [id, components] : outputs) all.output(id, components);
  ASSERT_EQ(all.run(evaluate<double>(law_), law_.handle(), 33), CLEAVE_OK);
  for (const auto& [id, components] : outputs) {
    auto one = with_inputs();
    one.output(id, components);
    ASSERT_EQ(one.run(evaluate<double>(law_), law_.handle(), 33), CLEAVE_OK);
    for (std::uint32_t k = 0; k < 33; ++k) EXPECT_EQ(one.value(id, k), all.value(id, k)) << "field " << id;
  }
}

TEST_P(EveryLaw, AbsentDegradationMeansOne) {
  LawDriver<double> absent, one;
  absent.input(measure(), strains(measure())).output(CLEAVE_FIELD_TAU, 6);
  one.input(measure(), strains(measure())).constant(CLEAVE_FIELD_DEGRADATION, {1}).output(CLEAVE_FIELD_TAU, 6);
  const Field a = stresses(absent, 64), b = stresses(one, 64);
  for (int k = 0; k < 64; ++k) expect_near(a[k], b[k], 1e-15, GetParam().modulus, "point " + std::to_string(k));
}

TEST_P(EveryLaw, FirstPiolaKirchhoffStressIsTheKirchhoffStressPulledBack) {
  EXPECT_TRUE(law_.description().can(CLEAVE_HAS_PIOLA));
  for (double g : {1.0, 0.3}) {
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, strains(CLEAVE_FIELD_F)).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_PIOLA, 9);
    ASSERT_EQ(driver.run(evaluate<double>(law_), law_.handle(), 64), CLEAVE_OK);
    for (std::uint32_t k = 0; k < 64; ++k) {
      EXPECT_EQ(driver.status(k), CLEAVE_STATUS_OK);
      const Tensor P = stress(samples()[k], g) * samples()[k].transpose().inverse();
      expect_near(driver.value(CLEAVE_FIELD_PIOLA, k), row_major(P), 1e-12, GetParam().modulus, "g " + std::to_string(g));
    }
  }
}

TEST_P(EveryLaw, StressDifferentialIsTheDifferenceOfStresses) {
  for (int k = 0; k < 12; ++k) {
    const Tensor &F = samples()[k], dF = samples()[k + 20];
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, {row_major(F)}).input(CLEAVE_FIELD_DELTA_F, {row_major(dF)});
    driver.constant(CLEAVE_FIELD_DEGRADATION, {0.5}).output(CLEAVE_FIELD_DELTA_P, 9);
    ASSERT_EQ(driver.run(evaluate<double>(law_), law_.handle(), 1), CLEAVE_OK);
    const double h = 1e-6;
    const auto piola = [&](const Tensor& at) -> Tensor { return stress(at, 0.5) * at.transpose().inverse(); };
    const Tensor differences = (piola(F + h * dF) - piola(F - h * dF)) / (2 * h);
    expect_near(driver.value(CLEAVE_FIELD_DELTA_P, 0), row_major(differences), 1e-6, GetParam().modulus,
                "sample " + std::to_string(k));
  }
}

TEST_P(EveryLaw, WaveModulusBoundsTheAcousticTensorAndIsNotFarAbove) {
  const auto bound = [&](const Tensor& F, double g) {
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, {row_major(F)}).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_WAVE_MODULUS, 1);
    EXPECT_EQ(driver.run(evaluate<double>(law_), law_.handle(), 1), CLEAVE_OK);
    return driver.value(CLEAVE_FIELD_WAVE_MODULUS, 0)[0];
  };
  const auto delta_P = [&](const Tensor& F, const Tensor& dF, double g) {
    LawDriver<double> driver;
    driver.input(CLEAVE_FIELD_F, {row_major(F)}).input(CLEAVE_FIELD_DELTA_F, {row_major(dF)});
    driver.constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_DELTA_P, 9);
    driver.run(evaluate<double>(law_), law_.handle(), 1);
    return tensor(driver.value(CLEAVE_FIELD_DELTA_P, 0));
  };
  // Q m = (dP along (m n^T) F) F^T n for waves along n; directions evenly spread over a half sphere.
  const auto fastest = [&](const Tensor& F, double g) {
    double found = 0;
    for (int i = 0; i < 150; ++i) {
      const double z = (i + 0.5) / 150, angle = 2.399963229728653 * i, r = std::sqrt(1 - z * z);
      const Eigen::Vector3d n(r * std::cos(angle), r * std::sin(angle), z);
      Tensor Q;
      for (int j = 0; j < 3; ++j) Q.col(j) = delta_P(F, Eigen::Vector3d::Unit(j) * n.transpose() * F, g) * F.transpose() * n;
      found = std::max(found, Eigen::SelfAdjointEigenSolver<Tensor>(0.5 * (Q + Q.transpose())).eigenvalues()(2));
    }
    return found;
  };
  std::vector<Tensor> states{Tensor::Identity()};
  for (int k = 0; k < 8; ++k) states.push_back(samples()[k]);
  states.push_back(Eigen::Vector3d(2, 0.7, 0.7).asDiagonal());
  states.push_back(Eigen::Vector3d(0.6, 0.9, 0.6).asDiagonal());
  states.push_back(Eigen::Vector3d(1.5, 1.2, 1).asDiagonal());
  for (std::size_t k = 0; k < states.size(); ++k) {
    const double undamaged = bound(states[k], 1), damaged = bound(states[k], 0.05), reference = fastest(states[k], 1);
    EXPECT_GE(undamaged, 0.999 * reference) << k;
    EXPECT_LE(undamaged, 1.7 * reference) << k;
    if (k == 0) {
      EXPECT_LE(undamaged, 1.08 * reference);
    }
    EXPECT_GE(damaged, 0.999 * fastest(states[k], 0.05)) << k;
    EXPECT_LE(damaged, undamaged) << k;
  }
  const std::string id = GetParam().id;
  if (id == "elasticity/split-neo-hookean" || id == "elasticity/fixed-corotated") {
    EXPECT_LE(bound(states.back(), 0.05), 1.7 * fastest(states.back(), 0.05)) << "broken material does not hold up the run";
  }
}

TEST_P(EveryLaw, RestIsFreeOfStressAndEnergy) {
  EXPECT_LE(largest(row_major(stress(Tensor::Identity(), 1))), 1e-12 * GetParam().modulus);
  EXPECT_LE(std::abs(energy(Tensor::Identity(), 1)), 1e-12 * GetParam().modulus);
}

TEST_P(EveryLaw, UndefinedLaneIsFatalAndItsNeighboursAreUntouched) {
  for (double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Field sound = strains(measure()), spoilt = sound;
    spoilt[5].assign(spoilt[5].size(), bad);
    LawDriver<float> reference, driver;
    reference.input(measure(), sound).output(CLEAVE_FIELD_TAU, 6);
    driver.input(measure(), spoilt).output(CLEAVE_FIELD_TAU, 6);
    reference.run(evaluate<float>(law_), law_.handle(), 20);
    driver.run(evaluate<float>(law_), law_.handle(), 20);
    for (std::uint32_t k = 0; k < 20; ++k) {
      EXPECT_EQ(driver.status(k), k == 5 ? CLEAVE_STATUS_FATAL : CLEAVE_STATUS_OK);
      if (k != 5) {
        EXPECT_EQ(driver.value(CLEAVE_FIELD_TAU, k), reference.value(CLEAVE_FIELD_TAU, k));
      }
    }
  }
}

TEST_P(EveryLaw, InversionIsFatalUnlessTheLawIsSafe) {
  Field inverted = strains(CLEAVE_FIELD_F);
  for (int i = 0; i < 3; ++i) inverted[3][i] = -inverted[3][i];
  LawDriver<double> driver;
  driver.input(CLEAVE_FIELD_F, inverted).output(CLEAVE_FIELD_TAU, 6);
  driver.run(evaluate<double>(law_), law_.handle(), 8);
  const bool safe = law_.description().can(CLEAVE_INVERSION_SAFE);
  for (std::uint32_t k = 0; k < 8; ++k)
    EXPECT_EQ(driver.status(k), k == 3 && !safe ? CLEAVE_STATUS_FATAL : CLEAVE_STATUS_OK) << k;
}

std::string name_of(const ::testing::TestParamInfo<Law>& info) {
  std::string name = std::string(info.param.id).substr(std::string("elasticity/").size());
  for (char& c : name)
    if (c == '-') c = '_';
  return name;
}
INSTANTIATE_TEST_SUITE_P(Laws, EveryLaw, ::testing::Values(neo_hookean, corotated, energy_only, fibrous), name_of);

// ---------------------------------------------------------------- what the SDK derives

TEST(DerivedFormulas, EnergyAloneGivesTheStressThatWasWrittenByHand) {
  const Instance derived = energy_only.make(), by_hand = neo_hookean.make();
  for (cleave_field_id output : {CLEAVE_FIELD_TAU, CLEAVE_FIELD_EFFECTIVE_STRESS}) {
    LawDriver<double> a, b;
    for (auto* driver : {&a, &b})
      driver->input(CLEAVE_FIELD_B, strains(CLEAVE_FIELD_B)).constant(CLEAVE_FIELD_DEGRADATION, {0.3}).output(output, 6);
    a.run(evaluate<double>(derived), derived.handle(), 64);
    b.run(evaluate<double>(by_hand), by_hand.handle(), 64);
    for (std::uint32_t k = 0; k < 64; ++k)
      expect_near(a.value(output, k), b.value(output, k), 1e-12, 1000, "field " + std::to_string(output));
  }
}

TEST(DerivedFormulas, StrainFromFIsTheSameAsTheHostsB) {
  const Instance law = neo_hookean.make();
  LawDriver<double> from_b, from_F;
  from_b.input(CLEAVE_FIELD_B, strains(CLEAVE_FIELD_B)).output(CLEAVE_FIELD_TAU, 6);
  from_F.input(CLEAVE_FIELD_F, strains(CLEAVE_FIELD_F)).output(CLEAVE_FIELD_TAU, 6);
  from_b.run(evaluate<double>(law), law.handle(), 64);
  from_F.run(evaluate<double>(law), law.handle(), 64);
  for (std::uint32_t k = 0; k < 64; ++k)
    expect_near(from_F.value(CLEAVE_FIELD_TAU, k), from_b.value(CLEAVE_FIELD_TAU, k), 1e-13, 1000, "tau");
}

TEST(DerivedFormulas, EffectiveStressLeavesOutFibersAndDegradation) {
  const Instance law = fibrous.make(), matrix = corotated.make();
  LawDriver<double> with, without;
  for (auto* driver : {&with, &without})
    driver->input(CLEAVE_FIELD_F, strains(CLEAVE_FIELD_F))
        .constant(CLEAVE_FIELD_DEGRADATION, {0.1})
        .constant(CLEAVE_FIELD_FIBER, {0, 1, 0})
        .output(CLEAVE_FIELD_EFFECTIVE_STRESS, 6);
  with.run(evaluate<double>(law), law.handle(), 64);
  without.run(evaluate<double>(matrix), matrix.handle(), 64);
  for (std::uint32_t k = 0; k < 64; ++k)
    expect_near(with.value(CLEAVE_FIELD_EFFECTIVE_STRESS, k), without.value(CLEAVE_FIELD_EFFECTIVE_STRESS, k), 1e-10, 1000,
                "sigma");
}

TEST(DerivedFormulas, FiberIsReadFromItsField) {
  const Instance law = fibrous.make();
  LawDriver<double> driver;
  const Tensor F = Eigen::Vector3d(1, 1.2, 1).asDiagonal();
  driver.input(CLEAVE_FIELD_F, {row_major(F)}).input(CLEAVE_FIELD_FIBER, {{0, 1, 0}, {1, 0, 0}}).output(CLEAVE_FIELD_ENERGY, 1);
  driver.run(evaluate<double>(law), law.handle(), 2);
  EXPECT_NEAR(driver.value(CLEAVE_FIELD_ENERGY, 0)[0] - driver.value(CLEAVE_FIELD_ENERGY, 1)[0], 0.5 * 500 * 0.04, 1e-10);
}

TEST(DerivedFormulas, MissingInputIsAnErrorNotACrash) {
  const Instance law = corotated.make();
  LawDriver<double> only_b, no_direction;
  only_b.input(CLEAVE_FIELD_B, strains(CLEAVE_FIELD_B)).output(CLEAVE_FIELD_TAU, 6);
  EXPECT_EQ(only_b.run(evaluate<double>(law), law.handle(), 4), CLEAVE_ERROR_UNSUPPORTED);
  no_direction.input(CLEAVE_FIELD_F, strains(CLEAVE_FIELD_F)).output(CLEAVE_FIELD_DELTA_P, 9);
  EXPECT_EQ(no_direction.run(evaluate<double>(law), law.handle(), 4), CLEAVE_ERROR_UNSUPPORTED);
  const Instance of_b = neo_hookean.make();
  LawDriver<double> no_F;
  no_F.input(CLEAVE_FIELD_B, strains(CLEAVE_FIELD_B)).output(CLEAVE_FIELD_PIOLA, 9);
  EXPECT_EQ(no_F.run(evaluate<double>(of_b), of_b.handle(), 4), CLEAVE_ERROR_UNSUPPORTED);
}

// ---------------------------------------------------------------- the two laws

TEST(SplitNeoHookean, CompressionIsNotDegraded) {
  const Instance law = neo_hookean.make();
  LawDriver<double> driver;
  const Tensor squeezed = 0.9 * Tensor::Identity(), swollen = 1.1 * Tensor::Identity();
  driver.input(CLEAVE_FIELD_B, {left_cauchy_green(squeezed), left_cauchy_green(swollen)});
  driver.constant(CLEAVE_FIELD_DEGRADATION, {0.25}).output(CLEAVE_FIELD_TAU, 6).output(CLEAVE_FIELD_TENSILE_ENERGY, 1);
  driver.run(evaluate<double>(law), law.handle(), 2);
  const double kappa = 1000 / (3 * (1 - 0.6));
  const auto pressure = [&](double stretch) { return 0.5 * kappa * (std::pow(stretch, 6) - 1); };
  EXPECT_NEAR(driver.value(CLEAVE_FIELD_TAU, 0)[0], pressure(0.9), 1e-9);
  EXPECT_NEAR(driver.value(CLEAVE_FIELD_TAU, 1)[0], 0.25 * pressure(1.1), 1e-9);
  EXPECT_NEAR(driver.value(CLEAVE_FIELD_TENSILE_ENERGY, 0)[0], 0, 1e-9);
  EXPECT_GT(driver.value(CLEAVE_FIELD_TENSILE_ENERGY, 1)[0], 1);
}

TEST(SplitNeoHookean, IsochoricResponseIsItsOwnPressureAndShear) {
  const auto response = neo_hookean.make().isochoric_response();
  ASSERT_TRUE(response);
  EXPECT_EQ(response->pressure_law, std::uint32_t(CLEAVE_PRESSURE_QUADRATIC));
  EXPECT_NEAR(response->deviatoric_modulus, 1000 / 2.6, 1e-12 * 1000);
  EXPECT_NEAR(response->bulk_modulus, 1000 / 1.2, 1e-12 * 1000);
}

TEST(FixedCorotated, PushesBackTowardsRestThroughInversion) {
  const Instance law = corotated.make();
  LawDriver<double> driver;
  Field flattened;
  const std::vector<double> stretches{0.5, 1e-3, 0, -1e-3, -0.5};
  for (double stretch : stretches) flattened.push_back(row_major(Eigen::Vector3d(1, 1, stretch).asDiagonal()));
  Field push(stretches.size(), {0, 0, 0, 0, 0, 0, 0, 0, 1});
  driver.input(CLEAVE_FIELD_F, flattened)
      .input(CLEAVE_FIELD_DELTA_F, push)
      .output(CLEAVE_FIELD_TAU, 6)
      .output(CLEAVE_FIELD_DELTA_P, 9);
  driver.run(evaluate<double>(law), law.handle(), std::uint32_t(stretches.size()));
  for (std::uint32_t k = 0; k < stretches.size(); ++k) {
    EXPECT_EQ(driver.status(k), CLEAVE_STATUS_OK) << stretches[k];
    // P33 = tau33 / F33 is negative: the energy falls as the stretch grows.
    if (stretches[k] != 0) {
      EXPECT_LT(driver.value(CLEAVE_FIELD_TAU, k)[2] / stretches[k], -100) << stretches[k];
    }
    EXPECT_GT(driver.value(CLEAVE_FIELD_DELTA_P, k)[8], 100) << stretches[k];
  }
}

// lambda < 0: psi of F = s I is 3 mu (s - 1)^2 + lambda/2 (s^3 - 1)^2, which has no lower bound.
TEST(FixedCorotated, RefusesModuliWhoseEnergyHasNoLowerBound) {
  const auto refusal = [](const GivenParameters& given) -> std::string {
    try {
      Instance(built_plugins().load("elasticity/fixed-corotated"), given, {});
      return "";
    } catch (const InputError& error) {
      return error.what();
    }
  };
  EXPECT_EQ(refusal(stiff(1000, 0)), "");
  EXPECT_THAT(refusal(stiff(1000, -0.01)), ::testing::HasSubstr("poissons_ratio must not be negative"));
  EXPECT_EQ(refusal({{"shear_modulus", 300.}, {"bulk_modulus", 200.}}), "");
  EXPECT_THAT(refusal({{"shear_modulus", 300.}, {"bulk_modulus", 199.}}),
              ::testing::HasSubstr("bulk_modulus must be at least"));
}

/// States of the fixed corotated solid whose rotation is not determined, flat ones, and nothing at all.
template <class S>
void expect_finite_differential() {
  const Instance law = corotated.make();
  Field F, dF;
  for (const Eigen::Vector3d& stretches : {Eigen::Vector3d(1, 1, -1), Eigen::Vector3d(1, 0.3, -0.3), Eigen::Vector3d(1, 1, 0),
                                           Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, 1, 1)})
    for (const Tensor& direction : deformations(4, 1)) {
      F.push_back(row_major(stretches.asDiagonal()));
      dF.push_back(row_major(direction));
    }
  LawDriver<S> driver;
  driver.input(CLEAVE_FIELD_F, F).input(CLEAVE_FIELD_DELTA_F, dF).output(CLEAVE_FIELD_PIOLA, 9).output(CLEAVE_FIELD_DELTA_P, 9);
  ASSERT_EQ(driver.run(evaluate<S>(law), law.handle(), std::uint32_t(F.size())), CLEAVE_OK);
  for (std::uint32_t k = 0; k < F.size(); ++k) {
    EXPECT_EQ(driver.status(k), CLEAVE_STATUS_OK) << k;
    for (auto output : {CLEAVE_FIELD_PIOLA, CLEAVE_FIELD_DELTA_P})
      for (double value : driver.value(output, k)) EXPECT_TRUE(std::isfinite(value)) << k;
  }
}

TEST(FixedCorotated, StressDifferentialIsFiniteWhereTheRotationJumps) {
  expect_finite_differential<float>();
  expect_finite_differential<double>();
}

}  // namespace
}  // namespace cleave::plugins::test
