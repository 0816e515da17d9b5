#include "damage_testing.hpp"

namespace cleave::plugins::test {
namespace {

using ::testing::HasSubstr;

constexpr const char* anisotropic = "damage/anisotropic";
const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();

GivenParameters parameters(double critical_stress, std::vector<double> alpha) {
  return {{"critical_stress", critical_stress}, {"viscosity", 0.1}, {"structural_alpha", std::move(alpha)}};
}
Instance law_of(double critical_stress, std::vector<double> alpha) {
  return damage_law(anisotropic, parameters(critical_stress, std::move(alpha)));
}

struct Point {
  Tensor stress = Tensor::Zero();
  Tensor F = Tensor::Identity();
  Eigen::Vector3d first = x, second = y;
  double history = 0;
};
struct Result {
  double force, history;
  std::uint8_t status;
};

std::vector<double> components(const Eigen::Vector3d& v) { return {v[0], v[1], v[2]}; }

template <class S>
std::vector<Result> drive(const Instance& law, const std::vector<Point>& points, double toughness = 1) {
  Field stresses, deformations, firsts, seconds, histories;
  for (const Point& p : points) {
    stresses.push_back(stress(p.stress));
    deformations.push_back(row_major(p.F));
    firsts.push_back(components(p.first));
    seconds.push_back(components(p.second));
    histories.push_back({p.history});
  }
  LawDriver<S> driver(Placement::scattered);
  driver.input(CLEAVE_FIELD_EFFECTIVE_STRESS_IN, stresses).input(CLEAVE_FIELD_STATE, histories);
  if (law.can(CLEAVE_ACCEPTS_F)) driver.input(CLEAVE_FIELD_F, deformations);
  if (law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER)) driver.input(CLEAVE_FIELD_FIBER, firsts);
  if (law.can(CLEAVE_NEEDS_SECOND_FIBER)) driver.input(CLEAVE_FIELD_SECOND_FIBER, seconds);
  driver.constant(CLEAVE_FIELD_TOUGHNESS, {toughness});
  driver.output(CLEAVE_FIELD_DRIVING_FORCE, 1).output(CLEAVE_FIELD_STATE_OUT, 1);
  const auto count = std::uint32_t(points.size());
  EXPECT_EQ(driver.run(test::drive<S>(law), law.handle(), count), CLEAVE_OK);
  std::vector<Result> results;
  for (std::uint32_t k = 0; k < count; ++k)
    results.push_back(
        {driver.value(CLEAVE_FIELD_DRIVING_FORCE, k)[0], driver.value(CLEAVE_FIELD_STATE_OUT, k)[0], driver.status(k)});
  return results;
}

double force(const Instance& law, const Point& point) { return drive<double>(law, {point})[0].force; }

Tensor rotation_of(const Tensor& F) {
  const Eigen::JacobiSVD<Tensor> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}
Tensor tensile_part(const Tensor& s) {
  const Eigen::SelfAdjointEigenSolver<Tensor> eigen(s);
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() * eigen.eigenvectors().transpose();
}
/// tr((A s+) (s+ A)^T)
double weighted_tension(const Point& p, double alpha_1, double alpha_2) {
  const Tensor R = rotation_of(p.F), s = tensile_part(p.stress);
  const Tensor A = Tensor::Identity() + alpha_1 * (R * p.first) * (R * p.first).transpose() +
                   alpha_2 * (R * p.second) * (R * p.second).transpose();
  return (A * s * (s * A).transpose()).trace();
}

/// Deformed, rotated and stressed independently of each other, with fibres of any direction.
std::vector<Point> random_points(int count, double stress_size) {
  const auto stresses = random_stresses(count, stress_size);
  const auto deformed = deformations(count, 0.4), turned = deformations(count, 0.5, 8);
  std::vector<Point> points;
  for (std::size_t k = 0; k < std::size_t(count); ++k) {
    const Tensor frame = rotation_of(turned[k]);
    points.push_back({stresses[k], deformed[k], frame.col(0), frame.col(1), 0});
  }
  return points;
}

TEST(AnisotropicDamage, MatchesThePublishedCode) {
  const auto file = reference_data() / "golden" / "aniso_damage.csv";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there; set CLEAVE_DATA_DIR";
  const std::map<std::string, std::vector<double>> alphas = {{"qrsnh_kx10_alpha=-1_p=0.1", {-1}},
                                                             {"qrsnh_alpha=10_p=0.05", {10}},
                                                             {"nhb_alpha=-0.5,2_p=0.1", {-0.5, 2}},
                                                             {"qraniso_k0=10mu_alpha=-1_p=0.1", {-1}}};
  const auto rows = read_reference_table(file);
  ASSERT_GE(rows.size(), 100u);
  for (const auto& row : rows) {
    const Instance law = law_of(std::stod(row.at("sigma_crit")), alphas.at(row.at("variant")));
    Point point;
    point.stress = matrix_of(row, "S");
    point.F = matrix_of(row, "F");
    const double expected = std::max(std::stod(row.at("phi_sym")) - 1, 0.0);
    EXPECT_NEAR(force(law, point), expected, 1e-9 * std::max(expected, 1.0)) << row.at("case") << " " << row.at("variant");
  }
}

TEST(AnisotropicDamage, CriticalStretchIsTheEnergyThePublishedCodeTakesForAStress) {
  const auto file = reference_data() / "golden" / "aniso_damage.csv";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there; set CLEAVE_DATA_DIR";
  constexpr double mu = 1000 / 2.6, lambda = 300 / (1.3 * 0.4);
  const Elastic elastic({{"shear_modulus", mu}, {"bulk_modulus", lambda + 0.666666 * mu}});
  GivenParameters given = parameters(1, {});
  given.erase("critical_stress");
  given["critical_stretch"] = 0.1;
  const Instance law = damage_law(anisotropic, given, elastic.context());
  int compared = 0;
  for (const auto& row : read_reference_table(file)) {
    if (row.at("variant").rfind("nhb", 0) != 0) continue;
    const double critical = std::stod(row.at("sigma_crit")), pull = 3 * critical;
    Point point;
    point.stress = pull * x * x.transpose();
    EXPECT_NEAR(force(law, point), 8, 1e-8);
    ++compared;
  }
  EXPECT_GT(compared, 0);
}

TEST(AnisotropicDamage, IsTheTraceFormulaForEveryAlpha) {
  const std::vector<std::vector<double>> alphas = {{-1}, {-0.5}, {10}, {-1, -1}, {-1, 2}, {0, -0.7}, {3, 0.5}};
  // About half of the points below their critical stress, where the shortcut must not lose any driving force.
  const auto points = random_points(200, 1);
  for (const auto& alpha : alphas) {
    const Instance law = law_of(1, alpha);
    const auto results = drive<double>(law, points);
    int driven = 0;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double expected = std::max(weighted_tension(points[k], alpha[0], alpha.size() > 1 ? alpha[1] : 0) - 1, 0.0);
      EXPECT_NEAR(results[k].force, expected, 1e-12 * (1 + expected)) << "point " << k << ", alpha " << alpha[0];
      EXPECT_EQ(results[k].history, results[k].force);
      EXPECT_EQ(results[k].status, CLEAVE_STATUS_OK);
      driven += expected > 0;
    }
    if (alpha[0] > -1) {
      EXPECT_GT(driven, 10);
    }
  }
}

TEST(AnisotropicDamage, WithoutAlphaItIsTheNormOfTheTension) {
  for (const std::vector<double>& alpha : {std::vector<double>{}, {0.0}, {0.0, 0.0}}) {
    const Instance law = law_of(0.5, alpha);
    EXPECT_FALSE(law.can(CLEAVE_ACCEPTS_F) || law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER));
    for (const Point& p : random_points(50, 2)) {
      const double expected = std::max(4 * tensile_part(p.stress).squaredNorm() - 1, 0.0);
      EXPECT_NEAR(force(law, p), expected, 1e-12 * (1 + expected));
    }
  }
}

TEST(AnisotropicDamage, ReadsFibersWhereAlphaIsNotZero) {
  const Instance first = law_of(1, {-1}), second = law_of(1, {0, -1}), both = law_of(1, {-1, -1});
  for (const Instance* law : {&first, &second, &both}) EXPECT_TRUE(law->can(CLEAVE_ACCEPTS_F));
  EXPECT_TRUE(first.can(CLEAVE_NEEDS_FIBER) && !first.can(CLEAVE_NEEDS_SECOND_FIBER));
  EXPECT_TRUE(second.can(CLEAVE_NEEDS_SECOND_FIBER) && both.can(CLEAVE_NEEDS_SECOND_FIBER));
  const GivenParameters by_default = {{"critical_stress", 1.0}, {"viscosity", 0.1}};
  EXPECT_TRUE(damage_law(anisotropic, by_default).can(CLEAVE_NEEDS_FIBER)) << "one family of fibres that hold";
}

TEST(AnisotropicDamage, WeighsTensionAlongAFiberByOnePlusAlpha) {
  Point along, across;
  along.stress = 3 * x * x.transpose();
  across.stress = 3 * z * z.transpose();
  for (const double alpha : {-1.0, -0.5, 0.5, 10.0}) {
    const Instance law = law_of(1, {alpha});
    EXPECT_NEAR(force(law, along), std::max(9 * (1 + alpha) * (1 + alpha) - 1, 0.0), 1e-11);
    EXPECT_NEAR(force(law, across), 8, 1e-14);
  }
  Point along_second;
  along_second.stress = 3 * y * y.transpose();
  const Instance orthotropic = law_of(1, {-1, -1});
  EXPECT_EQ(force(orthotropic, along), 0);
  EXPECT_EQ(force(orthotropic, along_second), 0);
  EXPECT_NEAR(force(orthotropic, across), 8, 1e-14);
}

TEST(AnisotropicDamage, ARotationOfTheLoadedBodyChangesNothing) {
  const Instance law = law_of(0.5, {-0.8, 0.3});
  for (const Point& p : random_points(50, 1)) {
    const Tensor Q = Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
    Point turned = p;
    turned.F = Q * p.F;
    turned.stress = Q * p.stress * Q.transpose();
    const double at_rest = force(law, p);
    EXPECT_NEAR(force(law, turned), at_rest, 1e-12 * (1 + at_rest));
  }
}

TEST(AnisotropicDamage, TheShortcutGivesTheSameBits) {
  // Stresses below the critical one, and tension at it: alone they take the shortcut, where rounding lets them, next to a
  // loaded point all of the formula.
  std::vector<Point> points = random_points(64, 1);
  for (std::size_t k = 0; k < points.size(); ++k) {
    Tensor& s = points[k].stress;
    if (k % 2 == 0) s = s * s;
    s *= (k % 2 == 0 ? 1 : 0.999) / s.norm();
    points[k].history = k % 3 == 0 ? 0.25 : 0;
  }
  for (const std::vector<double>& alpha : {std::vector<double>{}, {-1.0}, {-0.5, -0.5}}) {
    const Instance law = law_of(1, alpha);
    std::vector<Point> mixed;
    for (const Point& p : points) {
      mixed.push_back(p);
      mixed.push_back(p);
      mixed.back().stress *= 5;
    }
    const auto together = drive<double>(law, mixed), apart = drive<double>(law, points);
    const auto together_f32 = drive<float>(law, mixed), apart_f32 = drive<float>(law, points);
    for (std::size_t k = 0; k < points.size(); ++k) {
      EXPECT_EQ(together[2 * k].force, apart[k].force) << k;
      EXPECT_EQ(together_f32[2 * k].force, apart_f32[k].force) << k;
      if (k % 2 != 0) {
        EXPECT_EQ(apart[k].force, points[k].history);
      }
      EXPECT_EQ(drive<double>(law, {mixed[2 * k + 1]})[0].force, together[2 * k + 1].force) << k;
    }
  }
}

TEST(AnisotropicDamage, TheHistoryNeverDecreases) {
  const Instance law = law_of(1, {});
  Point point;
  std::vector<Result> results;
  double history = 0;
  for (const double pull : {0.5, 2.0, 1.5, 0.0, -5.0, 3.0}) {
    point.stress = pull * x * x.transpose();
    point.history = history;
    results.push_back(drive<double>(law, {point})[0]);
    history = results.back().history;
  }
  const double expected[] = {0, 3, 3, 3, 3, 8};
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_NEAR(results[k].force, expected[k], 1e-14);
    EXPECT_EQ(results[k].history, results[k].force);
  }
}

TEST(AnisotropicDamage, ToughnessScalesTheCriticalStressAndZetaTheForce) {
  const auto points = random_points(20, 4);
  const auto tough = drive<double>(law_of(0.5, {-0.5}), points, 2), reference = drive<double>(law_of(1, {-0.5}), points);
  GivenParameters steep = parameters(1, {-0.5});
  steep["zeta"] = 3.0;
  const auto tripled = drive<double>(damage_law(anisotropic, steep), points);
  for (std::size_t k = 0; k < points.size(); ++k) {
    EXPECT_EQ(tough[k].force, reference[k].force);
    EXPECT_NEAR(tripled[k].force, 3 * reference[k].force, 1e-13 * tripled[k].force);
  }
}

TEST(AnisotropicDamage, RestPressureAndEqualPrincipalStressesAreWellDefined) {
  const Instance law = law_of(1, {-1});
  std::vector<Point> points(4);
  points[1].stress = -7 * Tensor::Identity();
  points[2].stress = 2 * Tensor::Identity();
  points[3].stress = 2 * (x * x.transpose() + z * z.transpose());
  points[3].F = Tensor::Zero();
  const auto exact = drive<double>(law, points), rounded = drive<float>(law, points);
  const double expected[] = {0, 0, 2 * 4 - 1, 4 - 1};
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(exact[k].status, CLEAVE_STATUS_OK);
    EXPECT_EQ(rounded[k].status, CLEAVE_STATUS_OK);
    EXPECT_NEAR(exact[k].force, expected[k], 1e-14);
    EXPECT_NEAR(rounded[k].force, expected[k], 1e-5);
  }
}

TEST(AnisotropicDamage, AnUndefinedStressIsFatalToItsPointAlone) {
  for (const std::vector<double>& alpha : {std::vector<double>{}, {-1.0}}) {
    const Instance law = law_of(1, alpha);
    for (int i = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j) {
        auto points = random_points(8, 2);
        const auto before = drive<double>(law, points);
        points[3].stress(i, j) = points[3].stress(j, i) = nan;
        const auto after = drive<double>(law, points);
        for (std::size_t k = 0; k < 8; ++k) {
          EXPECT_EQ(after[k].status, k == 3 ? CLEAVE_STATUS_FATAL : CLEAVE_STATUS_OK) << i << j;
          if (k != 3) {
            EXPECT_EQ(after[k].force, before[k].force);
          }
        }
      }
  }
}

TEST(AnisotropicDamage, FibersThatHoldAreNotTornByRoundingInSinglePrecision) {
  // Ten thousand times the critical stress along fibres of any direction: the terms of the trace formula would leave
  // 1e8 times the rounding error.
  const Instance law = law_of(1, {-1});
  auto points = random_points(64, 1);
  for (Point& p : points) {
    const Eigen::Vector3d a = rotation_of(p.F) * p.first;
    p.stress = 1e4 * a * a.transpose();
  }
  for (const Result& r : drive<float>(law, points)) EXPECT_LT(r.force, 1e-2);
  for (const Result& r : drive<double>(law, points)) EXPECT_EQ(r.force, 0);
}

TEST(AnisotropicDamage, SingleAgreesWithDouble) {
  const Instance law = law_of(0.3, {-0.6, 0.4});
  const auto points = random_points(100, 3);
  const auto exact = drive<double>(law, points), rounded = drive<float>(law, points);
  for (std::size_t k = 0; k < points.size(); ++k) EXPECT_NEAR(rounded[k].force, exact[k].force, 3e-5 * (1 + exact[k].force));
}

TEST(AnisotropicDamage, TellsTheHostHowToIntegrateIt) {
  Context grid;
  grid.cell_size = 0.2;
  const auto by_default = model_of(damage_law(anisotropic, parameters(1, {}), grid));
  EXPECT_EQ(by_default.viscosity, 0.1);
  EXPECT_EQ(by_default.length, 0.1) << "half a cell";
  EXPECT_EQ(by_default.residual, 0.01);
  EXPECT_EQ(by_default.integration, std::uint32_t(CLEAVE_INTEGRATION_EXPLICIT));
  EXPECT_EQ(model_of(law_of(1, {})).length, 0) << "no grid, no gradient";
  GivenParameters given = parameters(1, {});
  given.insert({{"length_scale_cells", 2.0}, {"integration", std::string("implicit")}, {"residual", 0.0}});
  const auto chosen = model_of(damage_law(anisotropic, given, grid));
  EXPECT_EQ(chosen.length, 0.4);
  EXPECT_EQ(chosen.integration, std::uint32_t(CLEAVE_INTEGRATION_IMPLICIT));
  EXPECT_EQ(chosen.residual, 0);
}

TEST(AnisotropicDamage, RefusesWhatDoesNotDetermineIt) {
  GivenParameters given = parameters(1, {});
  given["critical_stretch"] = 0.1;
  EXPECT_THAT(refusal(anisotropic, given), HasSubstr("does not go with the others"));
  given.erase("critical_stress");
  EXPECT_THAT(refusal(anisotropic, given), HasSubstr("critical_stretch needs the elastic law of the material"));
  given = parameters(1, {});
  given["length_scale_cells"] = 1.0;
  EXPECT_THAT(refusal(anisotropic, given), HasSubstr("length_scale_cells needs a grid"));
  EXPECT_THAT(refusal(anisotropic, parameters(1, {-1.5})), HasSubstr("structural_alpha"));
  EXPECT_THAT(refusal(anisotropic, parameters(1, {-1, -1, -1})), HasSubstr("structural_alpha"));
}

}  // namespace
}  // namespace cleave::plugins::test
