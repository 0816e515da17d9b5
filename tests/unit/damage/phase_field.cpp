#include "damage_testing.hpp"

namespace cleave::plugins::test {
namespace {

using ::testing::HasSubstr;

constexpr const char* phase_field = "damage/phase-field";
constexpr double E = 2e6, length = 0.01, G = 3;
/// 9/16 sqrt(E G/(6 l0))
const double strength = 9. / 16 * std::sqrt(E * G / (6 * length));

struct Result {
  double force, history;
  std::uint8_t status;
};

template <class S>
std::vector<Result> drive(const Instance& law, const Field& energies, const Field& histories, double toughness = 1) {
  LawDriver<S> driver;
  driver.input(CLEAVE_FIELD_TENSILE_ENERGY_IN, energies).input(CLEAVE_FIELD_STATE, histories);
  driver.constant(CLEAVE_FIELD_TOUGHNESS, {toughness});
  driver.output(CLEAVE_FIELD_DRIVING_FORCE, 1).output(CLEAVE_FIELD_STATE_OUT, 1);
  const auto count = std::uint32_t(energies.size());
  EXPECT_EQ(driver.run(test::drive<S>(law), law.handle(), count), CLEAVE_OK);
  std::vector<Result> results;
  for (std::uint32_t k = 0; k < count; ++k)
    results.push_back(
        {driver.value(CLEAVE_FIELD_DRIVING_FORCE, k)[0], driver.value(CLEAVE_FIELD_STATE_OUT, k)[0], driver.status(k)});
  return results;
}

double force(const Instance& law, double energy, double toughness = 1) {
  return drive<double>(law, {{energy}}, {{0}}, toughness)[0].force;
}

TEST(PhaseField, MatchesThePublishedCode) {
  const auto file = reference_data() / "golden" / "cdmpm_phase_driver.csv";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there; set CLEAVE_DATA_DIR";
  constexpr double mu = 1000 / 2.6, lambda = 300 / (1.3 * 0.4);
  // The reference takes 0.666666 for 2/3.
  const Elastic elastic({{"shear_modulus", mu}, {"bulk_modulus", lambda + 0.666666 * mu}});
  const Instance law =
      damage_law(phase_field, {{"critical_stretch", 0.02}, {"length_scale", 0.01}, {"residual", 0.001}}, elastic.context());
  const auto rows = read_reference_table(file);
  ASSERT_GE(rows.size(), 20u);
  for (const auto& row : rows) {
    LawDriver<double> energy;
    energy.input(CLEAVE_FIELD_F, {row_major(matrix_of(row, "F"))}).output(CLEAVE_FIELD_TENSILE_ENERGY, 1);
    ASSERT_EQ(energy.run(evaluate<double>(elastic.law()), elastic.law().handle(), 1), CLEAVE_OK);
    const double expected = std::stod(row.at("pf_Fp"));
    EXPECT_NEAR(force(law, energy.value(CLEAVE_FIELD_TENSILE_ENERGY, 0)[0]) + 1, expected, 1e-9 * expected) << row.at("case");
  }
}

TEST(PhaseField, AnyTwoOfToughnessStrengthAndLengthGiveTheSameLaw) {
  const Elastic elastic(stiff(E, 0.3));
  const std::vector<std::pair<GivenParameters, double>> alternatives = {
      {{{"energy_release_rate", G}, {"length_scale", length}}, 0},
      {{{"strength", strength}, {"length_scale", length}}, 0},
      {{{"energy_release_rate", G}, {"strength", strength}}, 0},
      {{{"energy_release_rate", G}, {"length_scale_cells", 2.0}}, length / 2},
      {{{"strength", strength}, {"length_scale_cells", 2.0}}, length / 2},
      {{{"energy_release_rate", G}}, 2 * length},
      {{{"strength", strength}}, 2 * length},
      {{{"energy_release_rate", G}, {"strength", strength}}, 0.3},
  };
  const double energy = 50, expected = 4 * length * 0.999 * energy / G;
  for (std::size_t i = 0; i < alternatives.size(); ++i) {
    const auto& [given, cell_size] = alternatives[i];
    const Instance law = damage_law(phase_field, given, elastic.context(cell_size));
    EXPECT_NEAR(force(law, energy), expected, 1e-9 * expected) << "set " << i;
    EXPECT_NEAR(model_of(law).length, 2 * length, 1e-9 * length) << "set " << i;
  }
}

TEST(PhaseField, StrengthHoldsForEveryElasticLaw) {
  for (const char* id : {"elasticity/split-neo-hookean", "elasticity/fixed-corotated"}) {
    const Elastic elastic(stiff(E, 0.3), id);
    const Instance law =
        damage_law(phase_field, {{"strength", strength}, {"length_scale", length}, {"residual", 0.0}}, elastic.context());
    // The stress E e/(1 + D)^2 with D = c E e^2/2 peaks where D = 1/3.
    const double e = std::sqrt(2. / (3 * force(law, 1) * E));
    EXPECT_NEAR(9. / 16 * E * e, strength, 1e-8 * strength) << id;
  }
}

TEST(PhaseField, CriticalStretchTakesItsEnergyForTheToughness) {
  const Elastic elastic(stiff(E, 0.3), "elasticity/fixed-corotated");
  const double mu = E / 2.6, lambda = E * 0.3 / (1.3 * 0.4), x = 0.05, J = std::pow(1 + x, 3);
  const double toughness = 3 * mu * x * x + lambda / 2 * (J - 1) * (J - 1);
  const Instance law = damage_law(phase_field, {{"critical_stretch", x}, {"length_scale", length}}, elastic.context());
  EXPECT_NEAR(force(law, 100), 4 * length * 0.999 * 100 / toughness, 1e-12);
}

TEST(PhaseField, RefusesWhatDoesNotDetermineIt) {
  const Elastic elastic(stiff(E, 0.3));
  const auto refused = [&](const GivenParameters& given, double cell_size = 0) {
    return refusal(phase_field, given, elastic.context(cell_size));
  };
  EXPECT_THAT(refused({{"energy_release_rate", G}, {"strength", strength}, {"length_scale", length}}),
              HasSubstr("length_scale follows from energy_release_rate and strength: give two of the three"));
  EXPECT_THAT(refused({{"energy_release_rate", G}, {"strength", strength}, {"length_scale_cells", 1.0}}, 0.1),
              HasSubstr("length_scale_cells follows from energy_release_rate and strength"));
  EXPECT_THAT(refused({{"strength", strength}, {"length_scale_cells", 1.0}}),
              HasSubstr("length_scale_cells needs a grid, and there is no cell size here: give length_scale in metres"));
  EXPECT_THAT(refused({{"strength", strength}}), HasSubstr("length_scale is needed: its default is half a cell"));
  EXPECT_THAT(refused({{"length_scale", length}}), HasSubstr("is missing: give energy_release_rate, or strength"));
  EXPECT_THAT(refused({{"critical_stretch", 0.1}, {"strength", strength}, {"length_scale", length}}),
              HasSubstr("does not go with the others"));
  EXPECT_THAT(refused({{"strength", strength}, {"length_scale", length}, {"length_scale_cells", 1.0}}, 0.1),
              HasSubstr("does not go with the others"));
  EXPECT_THAT(refused({{"strength", 1e-200}, {"energy_release_rate", G}}), HasSubstr("gives no usable length"));
  EXPECT_THAT(refusal(phase_field, {{"strength", strength}, {"length_scale", length}}),
              HasSubstr("strength needs the elastic law of the material"));
  EXPECT_THAT(refusal(phase_field, {{"critical_stretch", 0.1}, {"length_scale", length}}),
              HasSubstr("critical_stretch needs the elastic law of the material"));
  EXPECT_THAT(refused({{"critical_stretch", 1e-12}, {"length_scale", length}}),
              HasSubstr("critical_stretch must be at least 1e-06"));
  EXPECT_EQ(refusal(phase_field, {{"energy_release_rate", G}, {"length_scale", length}}), "")
      << "the toughness needs no elastic law";
}

TEST(PhaseField, TheHistoryNeverDecreases) {
  const Instance law = damage_law(phase_field, {{"energy_release_rate", G}, {"length_scale", length}});
  const auto results = drive<double>(law, {{0}, {10}, {40}, {-1e-13}}, {{20}, {20}, {20}, {0}});
  const double expected[] = {20, 20, 40, 0};
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(results[k].history, expected[k]);
    EXPECT_NEAR(results[k].force, 4 * length * 0.999 * expected[k] / G, 1e-14);
  }
}

TEST(PhaseField, AToughPointIsDrivenLess) {
  const Instance law = damage_law(phase_field, {{"energy_release_rate", G}, {"length_scale", length}});
  const Instance tough = damage_law(phase_field, {{"energy_release_rate", 2.5 * G}, {"length_scale", length}});
  EXPECT_NEAR(force(law, 100, 2.5), force(tough, 100), 1e-14);
}

TEST(PhaseField, SingleAgreesWithDoubleAndNothingIsSaidToBeFineThatIsNot) {
  const Instance law = damage_law(phase_field, {{"energy_release_rate", G}, {"length_scale", length}});
  const Field energies = {{0}, {1e-6}, {nan}, {3}, {1e9}};
  const auto exact = drive<double>(law, energies, {{0}}), rounded = drive<float>(law, energies, {{0}});
  for (std::size_t k : {0, 1, 3, 4}) {
    EXPECT_EQ(exact[k].status, CLEAVE_STATUS_OK);
    EXPECT_NEAR(rounded[k].force, exact[k].force, 1e-6 * exact[k].force);
  }
  EXPECT_EQ(exact[2].status, CLEAVE_STATUS_FATAL);
  EXPECT_EQ(rounded[2].status, CLEAVE_STATUS_FATAL);
}

TEST(PhaseField, TellsTheHostHowToIntegrateIt) {
  const GivenParameters given = {{"energy_release_rate", G}, {"length_scale", length}};
  const auto model = model_of(damage_law(phase_field, given));
  EXPECT_EQ(model.viscosity, 1. / 15);
  EXPECT_EQ(model.length, 2 * length);
  EXPECT_EQ(model.residual, 0.001);
  EXPECT_EQ(model.integration, std::uint32_t(CLEAVE_INTEGRATION_IMPLICIT));
  GivenParameters other = given;
  other.insert({{"mobility", 4.0}, {"residual", 0.25}, {"integration", std::string("explicit")}});
  const auto changed = model_of(damage_law(phase_field, other));
  EXPECT_EQ(changed.viscosity, 0.25);
  EXPECT_EQ(changed.residual, 0.25);
  EXPECT_EQ(changed.integration, std::uint32_t(CLEAVE_INTEGRATION_EXPLICIT));
  EXPECT_FALSE(damage_law(phase_field, given).can(CLEAVE_ACCEPTS_F)) << "it reads no strain";
}

}  // namespace
}  // namespace cleave::plugins::test
