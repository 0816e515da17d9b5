#include "qr_testing.hpp"

namespace cleave::plugins::test {
namespace {

/// Follows dF/dt = -dpsi/dF, as the vertices of a free element do.
std::vector<Tensor> relax(const Instance& law, std::vector<Tensor> states, double stiffness, int steps) {
  for (int i = 0; i < steps; ++i) {
    const auto forces = energy_gradients(law, states);
    for (std::size_t k = 0; k < states.size(); ++k)
      states[k] -= 0.5 / (stiffness + (lambda + mu) * std::pow(states[k].squaredNorm(), 2)) * forces[k];
  }
  return states;
}

double distance_from_rotation(const Tensor& F) {
  return (F.transpose() * F - Tensor::Identity()).norm() + (F.determinant() > 0 ? 0 : 1);
}

/// Random, mirrored and flattened; r11 = |F a1| is 0 in one of them.
std::vector<Tensor> degenerate_states() {
  std::vector<Tensor> states;
  for (const Tensor& F : deformations(20, 1.5, 11)) states.push_back(F);
  for (std::size_t k = 0; k < 10; ++k) states[k].row(2) *= -1;
  states.push_back(Eigen::Vector3d(0, 1, 1).asDiagonal());
  states.push_back(Eigen::Vector3d(1, 1, 0).asDiagonal());
  return states;
}

TEST(QrRecovery, MirroredAndFlattenedStatesReturnToARotation) {
  const auto start = degenerate_states();
  const auto end = relax(qr(), start, 2 * mu, 1500);
  for (std::size_t k = 0; k < end.size(); ++k) EXPECT_LT(distance_from_rotation(end[k]), 1e-4) << "from\n" << start[k];
}

TEST(QrRecovery, AlsoWithFibersAndThenFromAnExactMirrorImage) {
  auto start = degenerate_states();
  start.push_back(Eigen::Vector3d(1, 1, -1).asDiagonal());
  const auto end = relax(qr(3, 1), start, 5 * mu, 1500);
  for (std::size_t k = 0; k < end.size(); ++k) EXPECT_LT(distance_from_rotation(end[k]), 1e-4) << "from\n" << start[k];
}

// P = 0 and d2psi/dF2 = mu at F = 0: without fibres a collapsed point stays. P of F = s I changes its sign where
// s (1 + s + s^2) = mu/lambda.
TEST(QrRecovery, IsotropicPointIsDrawnToCollapseBelowABarrier) {
  const Instance law = qr();
  double barrier = 0.5;
  for (int i = 0; i < 20; ++i)
    barrier -= (barrier * (1 + barrier + barrier * barrier) - mu / lambda) / (1 + 2 * barrier + 3 * barrier * barrier);
  const Tensor I = Tensor::Identity();
  EXPECT_GT(stress(law, (barrier - 1e-3) * I)(0, 0), 0);
  EXPECT_LT(stress(law, (barrier + 1e-3) * I)(0, 0), 0);
  EXPECT_LT(relax(law, {Tensor((barrier - 0.02) * I)}, 2 * mu, 300)[0].norm(), 1e-4);
  EXPECT_LT(distance_from_rotation(relax(law, {Tensor((barrier + 0.02) * I)}, 2 * mu, 1500)[0]), 1e-4);
  // The mirror image of rest keeps three stretches of one magnitude on its way, and meets no barrier.
  EXPECT_LT(relax(law, {Tensor(-I)}, 2 * mu, 1500)[0].norm(), 1e-4);
}

// A fibre of length 0 pushes outwards with its full force kx whichever way it is disturbed, so a collapsed point opens.
TEST(QrRecovery, TwoFiberFamiliesOpenACollapsedPoint) {
  const auto end = relax(qr(3, 3), {Tensor(1e-3 * deformations(1, 0.5)[0])}, 5 * mu, 3000);
  EXPECT_LT(distance_from_rotation(end[0]), 1e-4);
}

TEST(QrRecovery, StressAndItsDifferentialStayFiniteAtF0) {
  const Instance law = qr(10, 10);
  EXPECT_EQ(stress(law, Tensor::Zero()).norm(), 0);
  LawDriver<float> driver;
  driver.input(CLEAVE_FIELD_F, {row_major(Tensor::Zero())}).input(CLEAVE_FIELD_DELTA_F, {row_major(Tensor::Identity())});
  driver.output(CLEAVE_FIELD_DELTA_P, 9).output(CLEAVE_FIELD_WAVE_MODULUS, 1).output(CLEAVE_FIELD_EFFECTIVE_STRESS, 6);
  ASSERT_EQ(driver.run(evaluate<float>(law), law.handle(), 1), CLEAVE_OK);
  EXPECT_EQ(driver.status(0), CLEAVE_STATUS_OK);
}

}  // namespace
}  // namespace cleave::plugins::test
