#include "hencky_testing.hpp"

#include <cleave/decompositions.hpp>

namespace cleave::plugins::test {
namespace {

double energy(const Instance& law, const Tensor& F, double g, cleave_field_id part = CLEAVE_FIELD_ENERGY) {
  LawDriver<double> driver;
  driver.input(CLEAVE_FIELD_F, {row_major(F)}).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(part, 1);
  EXPECT_EQ(driver.run(evaluate<double>(law), law.handle(), 1), CLEAVE_OK);
  return driver.value(part, 0)[0];
}
template <class S = double>
Tensor stress(const Instance& law, const Tensor& F, double g = 1) {
  LawDriver<S> driver;
  driver.input(CLEAVE_FIELD_F, {row_major(F)}).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_TAU, 6);
  EXPECT_EQ(driver.run(evaluate<S>(law), law.handle(), 1), CLEAVE_OK);
  return tensor(driver.value(CLEAVE_FIELD_TAU, 0));
}
Tensor piola(const Instance& law, const Tensor& F, double g) { return stress(law, F, g) * F.transpose().inverse(); }
Tensor delta_piola(const Instance& law, const Tensor& F, const Tensor& dF, double g) {
  LawDriver<double> driver;
  driver.input(CLEAVE_FIELD_F, {row_major(F)}).input(CLEAVE_FIELD_DELTA_F, {row_major(dF)});
  driver.constant(CLEAVE_FIELD_DEGRADATION, {g}).output(CLEAVE_FIELD_DELTA_P, 9);
  EXPECT_EQ(driver.run(evaluate<double>(law), law.handle(), 1), CLEAVE_OK);
  EXPECT_EQ(driver.status(0), CLEAVE_STATUS_OK);
  return tensor(driver.value(CLEAVE_FIELD_DELTA_P, 0));
}

/// General strains, and those whose principal stretches meet, exactly or nearly.
std::vector<Tensor> states() {
  std::vector<Tensor> all = deformations(10, 0.4);
  const Tensor turn = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  for (const Tensor& F : {diagonal_tensor(1.2, 1.2, 1.2), diagonal_tensor(0.8, 1.3, 0.8), diagonal_tensor(1.1, 1.1 + 1e-9, 0.7),
                          diagonal_tensor(1.1, 1.1 + 2e-4, 0.7)}) {
    all.push_back(F);
    all.push_back(turn * F);
    all.push_back(F * turn.transpose());
  }
  return all;
}

TEST(StvkHencky, StressIsTheDerivativeOfTheEnergy) {
  const Instance law = stvk_hencky();
  const double h = 1e-5;
  for (double g : {1.0, 0.25})
    for (const Tensor& F : states()) {
      Tensor differences;
      for (int i = 0; i < 9; ++i) {
        Tensor plus = F, minus = F;
        plus.data()[i] += h;
        minus.data()[i] -= h;
        differences.data()[i] = (energy(law, plus, g) - energy(law, minus, g)) / (2 * h);
      }
      EXPECT_LT((piola(law, F, g) - differences).norm(), 1e-6 * mu) << F;
    }
}

TEST(StvkHencky, StressDifferentialIsTheDifferenceOfStresses) {
  const Instance law = stvk_hencky();
  const std::vector<Tensor> directions = deformations(4, 1, 3);
  const double h = 1e-5;
  for (const Tensor& F : states())
    for (const Tensor& dF : directions) {
      const Tensor differences = (piola(law, F + h * dF, 0.5) - piola(law, F - h * dF, 0.5)) / (2 * h);
      EXPECT_LT((delta_piola(law, F, dF, 0.5) - differences).norm(), 1e-6 * mu) << F;
    }
}

/// At rest the tangent is that of linear elasticity, whatever eigenvectors the identity is given.
TEST(StvkHencky, TangentAtRestIsHookesLaw) {
  const Instance law = stvk_hencky();
  for (const Tensor& dF : deformations(4, 1, 5)) {
    const Tensor strain = 0.5 * (dF + dF.transpose());
    const Tensor hooke = 2 * mu * deviator(strain) + kappa * strain.trace() * Tensor::Identity();
    EXPECT_LT((delta_piola(law, Tensor::Identity(), dF, 1) - hooke).norm(), 1e-12 * mu);
  }
}

/// tau_1 = E ln s_1 where s_2 = s_3 = s_1^(-nu), at any stretch.
TEST(StvkHencky, UniaxialStressIsLinearInTheLogarithmicStrain) {
  const Instance law = stvk_hencky();
  for (double strain : {-1.5, -0.1, 0.3, 1.0}) {
    const Tensor tau = stress(law, diagonal_tensor(std::exp(strain), std::exp(-0.3 * strain), std::exp(-0.3 * strain)));
    EXPECT_LT((tau - diagonal_tensor(1000 * strain, 0, 0)).norm(), 1e-11 * mu);
  }
}

TEST(StvkHencky, StressTurnsWithTheBody) {
  const Instance law = stvk_hencky();
  const Tensor turn = Eigen::AngleAxisd(1.1, Eigen::Vector3d(3, -1, 2).normalized()).toRotationMatrix();
  for (const Tensor& F : states()) {
    const Tensor tau = stress(law, F);
    EXPECT_LT((stress(law, turn * F) - turn * tau * turn.transpose()).norm(), 1e-12 * mu);
    EXPECT_LT((stress(law, F * turn) - tau).norm(), 1e-12 * mu) << "an isotropic solid has no axes";
  }
}

TEST(StvkHencky, DamageTakesShearAndExpansionButNotCompression) {
  const Instance law = stvk_hencky();
  const Tensor stretch = diagonal_tensor(1.3, 1.2, 1.1), squeeze = diagonal_tensor(0.9, 0.8, 0.7);
  EXPECT_LT((stress(law, stretch, 0.1) - 0.1 * stress(law, stretch)).norm(), 1e-12 * mu);
  EXPECT_NEAR(stress(law, squeeze, 0.1).trace(), stress(law, squeeze).trace(), 1e-12 * mu);
  EXPECT_LT((deviator(stress(law, squeeze, 0.1)) - 0.1 * deviator(stress(law, squeeze))).norm(), 1e-12 * mu);
  const Tensor strain = log_strain_of(squeeze);
  EXPECT_NEAR(energy(law, squeeze, 1, CLEAVE_FIELD_TENSILE_ENERGY), mu * deviator(strain).squaredNorm(), 1e-12 * mu);
  EXPECT_NEAR(energy(law, squeeze, 0), 0.5 * kappa * strain.trace() * strain.trace(), 1e-12 * mu);
}

TEST(StvkHencky, WaveModulusBoundsTheAcousticTensor) {
  for (double nu : {-0.4, 0.0, 0.3, 0.49}) {
    const Instance law = stvk_hencky(1000, nu);
    std::vector<Tensor> all = states();
    all.push_back(Tensor::Identity());
    all.push_back(diagonal_tensor(2, 0.7, 0.7));
    all.push_back(diagonal_tensor(0.5, 0.6, 1.5));
    for (const Tensor& F : all) {
      LawDriver<double> driver;
      driver.input(CLEAVE_FIELD_F, {row_major(F)}).output(CLEAVE_FIELD_WAVE_MODULUS, 1);
      ASSERT_EQ(driver.run(evaluate<double>(law), law.handle(), 1), CLEAVE_OK);
      const double bound = driver.value(CLEAVE_FIELD_WAVE_MODULUS, 0)[0];
      // Q m = (dP along (m n^T) F) F^T n, directions n evenly spread over a half sphere.
      double fastest = 0;
      for (int i = 0; i < 60; ++i) {
        const double z = (i + 0.5) / 60, angle = 2.399963229728653 * i, r = std::sqrt(1 - z * z);
        const Eigen::Vector3d n(r * std::cos(angle), r * std::sin(angle), z);
        Tensor Q;
        for (int j = 0; j < 3; ++j)
          Q.col(j) = delta_piola(law, F, Eigen::Vector3d::Unit(j) * n.transpose() * F, 1) * F.transpose() * n;
        fastest = std::max(fastest, Eigen::SelfAdjointEigenSolver<Tensor>(0.5 * (Q + Q.transpose())).eigenvalues()(2));
      }
      EXPECT_GE(bound, (1 - 1e-9) * fastest) << nu << "\n" << F;
      if (nu >= 0) {
        EXPECT_LE(bound, 2 * fastest) << nu << "\n" << F;
      }
      if (nu >= 0 && F.isIdentity()) {
        EXPECT_NEAR(bound, fastest, 1e-9 * fastest) << nu;
      }
    }
  }
}

TEST(StvkHencky, ReturnMappingsAreToldItsPressureAndItsShearNearRest) {
  const Instance law = stvk_hencky();
  const auto told = law.isochoric_response();
  ASSERT_TRUE(told);
  const IsochoricResponse response{told->deviatoric_modulus, told->bulk_modulus, PressureLaw(told->pressure_law)};
  for (const Tensor& F : states()) EXPECT_NEAR(response.pressure(F.determinant()), -stress(law, F).trace() / 3, 1e-11 * kappa);
  const auto error = [&](double size) {
    const Tensor F = Tensor::Identity() + size * deformations(1, 1)[0], b = F * F.transpose();
    Symmetric3<double> components;
    for (int k = 0; k < 6; ++k) components[k] = symmetric(b)[k];
    const Symmetric3<double> s = response.deviatoric_stress(components);
    return (tensor({s[0], s[1], s[2], s[3], s[4], s[5]}) - deviator(stress(law, F))).norm();
  };
  EXPECT_NEAR(error(1e-3) / error(1e-4), 100, 5) << "equal but for terms of second order";
}

TEST(StvkHencky, StrainsWithoutLogarithmAreFatal) {
  const Instance law = stvk_hencky();
  LawDriver<double> driver;
  // det b > 0, but two eigenvalues are negative; det b = 0; and a sound neighbour.
  driver.input(CLEAVE_FIELD_B, {{1, -1, -2, 0, 0, 0}, {1, 1, 0, 0, 0, 0}, {1.2, 1, 0.9, 0.1, 0, 0}});
  driver.output(CLEAVE_FIELD_TAU, 6);
  ASSERT_EQ(driver.run(evaluate<double>(law), law.handle(), 3), CLEAVE_OK);
  EXPECT_EQ(driver.status(0), CLEAVE_STATUS_FATAL);
  EXPECT_EQ(driver.status(1), CLEAVE_STATUS_FATAL);
  EXPECT_EQ(driver.status(2), CLEAVE_STATUS_OK);
}

TEST(StvkHencky, SinglePrecisionAgrees) {
  const Instance law = stvk_hencky();
  for (const Tensor& F : states()) EXPECT_LT((stress<float>(law, F) - stress(law, F)).norm(), 2e-5 * mu) << F;
}

/// d(log A) against differences of an independent logarithm.
TEST(LogarithmOfATensor, IsDifferentiatedAlsoWhereEigenvaluesMeet) {
  using D = Dual<double, 2>;
  const double h = 1e-5;
  for (const Tensor& F : states()) {
    const Tensor A = F * F.transpose(), first = deformations(2, 1, 9)[0], second = deformations(2, 1, 9)[1];
    const Tensor dA[2] = {first + first.transpose(), second + second.transpose()};
    Symmetric3<D> moving;
    for (int k = 0; k < 6; ++k) {
      moving[k] = D(symmetric(A)[k]);
      for (int n = 0; n < 2; ++n) moving[k].derivative[n] = symmetric(dA[n])[k];
    }
    const Symmetric3<D> logarithm = log(moving);
    for (int n = 0; n < 2; ++n) {
      const Tensor differences = (log_strain(A + h * dA[n]) - log_strain(A - h * dA[n])) / h;
      for (int k = 0; k < 6; ++k) {
        EXPECT_NEAR(logarithm[k].derivative[n], symmetric(differences)[k], 1e-7) << F;
        EXPECT_NEAR(logarithm[k].value, 2 * symmetric(log_strain(A))[k], 1e-14) << F;
      }
    }
  }
}

}  // namespace
}  // namespace cleave::plugins::test
