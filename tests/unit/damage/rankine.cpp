#include "damage_testing.hpp"

namespace cleave::plugins::test {
namespace {

constexpr double limit = 10;

Instance rankine(double softening) {
  return damage_law("damage/rankine", {{"failure_stress", limit}, {"softening", softening}});
}

struct Result {
  double damage;
  std::uint8_t status;
};

template <class S = double>
std::vector<Result> damage(const Instance& law, const std::vector<Tensor>& stresses, double before = 0, double toughness = 1) {
  Field values;
  for (const Tensor& s : stresses) values.push_back(stress(s));
  LawDriver<S> driver;
  driver.input(CLEAVE_FIELD_EFFECTIVE_STRESS_IN, values).constant(CLEAVE_FIELD_DAMAGE, {before});
  driver.constant(CLEAVE_FIELD_TOUGHNESS, {toughness}).output(CLEAVE_FIELD_DAMAGE_OUT, 1);
  const auto count = std::uint32_t(stresses.size());
  EXPECT_EQ(driver.run(drive<S>(law), law.handle(), count), CLEAVE_OK);
  std::vector<Result> results;
  for (std::uint32_t k = 0; k < count; ++k) results.push_back({driver.value(CLEAVE_FIELD_DAMAGE_OUT, k)[0], driver.status(k)});
  return results;
}

Tensor pull(double s) {
  Tensor a = Tensor::Zero();
  a(1, 1) = s;
  return a;
}

TEST(Rankine, SoftensFromTheFailureStressOn) {
  for (const double H : {0.5, 1.0, 2.0}) {
    const Instance law = rankine(H);
    const auto results = damage(law, {pull(0), pull(limit), pull(1.25 * limit), pull(2 * limit), pull(1e6 * limit)});
    EXPECT_EQ(results[0].damage, 0);
    EXPECT_NEAR(results[1].damage, 0, 1e-15);
    EXPECT_NEAR(results[2].damage, 0.2 * H, 1e-15);
    EXPECT_NEAR(results[3].damage, 0.5 * H, 1e-15);
    EXPECT_NEAR(results[4].damage, std::min(H * (1 - 1e-6), 1.0), 1e-15) << "never above 1";
  }
}

TEST(Rankine, TheLargestPrincipalStressDecides) {
  const Instance law = rankine(0.9);
  const auto stresses = random_stresses(200, 2 * limit);
  const auto results = damage(law, stresses);
  const auto rounded = damage<float>(law, stresses);
  int damaged = 0;
  for (std::size_t k = 0; k < stresses.size(); ++k) {
    const double largest = Eigen::SelfAdjointEigenSolver<Tensor>(stresses[k]).eigenvalues()[2];
    const double expected = largest > limit ? 0.9 * (1 - limit / largest) : 0;
    EXPECT_NEAR(results[k].damage, expected, 1e-14);
    EXPECT_NEAR(rounded[k].damage, expected, 1e-6);
    damaged += expected > 0;
  }
  EXPECT_GT(damaged, 50);
  EXPECT_LT(damaged, 190);
}

TEST(Rankine, CompressionDoesNoHarm) {
  const Instance law = rankine(1);
  Tensor mixed = -0.01 * Tensor::Identity();
  mixed(0, 0) = -50;  // the bound on the largest principal stress exceeds the limit, all stresses are negative
  for (const Tensor& s : {pull(-100), Tensor(-30 * Tensor::Identity()), mixed}) EXPECT_EQ(damage(law, {s})[0].damage, 0);
}

TEST(Rankine, DamageNeverHeals) {
  const Instance law = rankine(1);
  for (const double s : {0.0, 1.0, 1.5, -4.0}) EXPECT_EQ(damage(law, {pull(s * limit)}, 0.5)[0].damage, 0.5);
  EXPECT_NEAR(damage(law, {pull(4 * limit)}, 0.5)[0].damage, 0.75, 1e-15);
}

TEST(Rankine, ToughnessScalesTheFailureStress) {
  const Instance law = rankine(1);
  EXPECT_EQ(damage(law, {pull(2 * limit)}, 0, 2.5)[0].damage, 0);
  EXPECT_NEAR(damage(law, {pull(5 * limit)}, 0, 2.5)[0].damage, 0.5, 1e-15);
}

TEST(Rankine, TheShortcutGivesTheSameBits) {
  const Instance law = rankine(1);
  for (const Tensor& s : random_stresses(40, limit)) {
    const double alone = damage(law, {s}, 0.125)[0].damage;
    EXPECT_EQ(damage(law, {s, pull(5 * limit)}, 0.125)[0].damage, alone);
  }
}

TEST(Rankine, AnUndefinedStressIsFatalToItsPointAlone) {
  const Instance law = rankine(1);
  for (int i = 0; i < 3; ++i)
    for (int j = i; j < 3; ++j) {
      Tensor broken = pull(2 * limit);
      broken(i, j) = broken(j, i) = nan;
      const auto results = damage(law, {pull(2 * limit), broken, pull(0)});
      EXPECT_EQ(results[0].status, CLEAVE_STATUS_OK);
      EXPECT_EQ(results[1].status, CLEAVE_STATUS_FATAL) << i << j;
      EXPECT_EQ(results[2].damage, 0);
    }
}

TEST(Rankine, IsALocalLaw) {
  const Instance law = rankine(1);
  EXPECT_TRUE(law.can(CLEAVE_DAMAGE_IS_LOCAL));
  EXPECT_FALSE(law.can(CLEAVE_ACCEPTS_F) || law.can(CLEAVE_ACCEPTS_B));
  EXPECT_EQ(model_of(law).length, 0);
  EXPECT_EQ(model_of(law).residual, 0.001);
}

}  // namespace
}  // namespace cleave::plugins::test
