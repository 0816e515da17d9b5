#include "common/error.hpp"
#include "plugins/elastic_probe.hpp"
#include "point/laws.hpp"
#include "qr_testing.hpp"

namespace cleave::plugins::test {
namespace {

TEST(QrResponse, RestIsFreeOfStressAndEnergyForAnyFrame) {
  for (unsigned seed = 0; seed < 4; ++seed)
    for (const char* calibration : {"published", "small-strain"}) {
      const Instance law = qr(100, 30, calibration);
      const Tensor D = frame(seed), turned = frame(seed + 10);
      EXPECT_LT(stress(law, turned, 0.5, D).cwiseAbs().maxCoeff(), 1e-12 * 100 * mu);
      EXPECT_LT(std::abs(evaluate_all(law, CLEAVE_FIELD_ENERGY, 1, {turned}, 0.5, D)[0][0]), 1e-12 * 100 * mu);
    }
}

// Uniaxial strain l along x: the fibre adds k (l - 1) l to tau_xx if it lies along x, nothing if it lies across.
TEST(QrResponse, FibersStiffenTheirOwnDirectionAlone) {
  const double stretch = 1.2, k = 10 * mu;
  const Tensor F = Eigen::Vector3d(stretch, 1, 1).asDiagonal(), along = Tensor::Identity();
  Tensor swapped;
  swapped << 0, 1, 0, 1, 0, 0, 0, 0, 1;
  const Tensor matrix = stress(qr(), F), first = stress(qr(10, 0), F, 1, along), second = stress(qr(0, 10), F, 1, swapped);
  const Tensor expected = Eigen::Vector3d(k * (stretch - 1) * stretch, 0, 0).asDiagonal();
  EXPECT_LT((first - matrix - expected).cwiseAbs().maxCoeff(), 1e-11 * k);
  EXPECT_LT((second - matrix - expected).cwiseAbs().maxCoeff(), 1e-11 * k);
  EXPECT_LT((stress(qr(10, 0), F, 1, swapped) - matrix).cwiseAbs().maxCoeff(), 1e-11 * k);
}

TEST(QrResponse, DamageLeavesFibersAndCompressionWhole) {
  const Instance law = qr(10, 0);
  const double stretch = 0.9, J = stretch * stretch * stretch;
  const Tensor squeezed = stretch * Tensor::Identity(), stretched = 1.1 * Tensor::Identity();
  const auto energy = [&](const Tensor& F, double g) { return evaluate_all(law, CLEAVE_FIELD_ENERGY, 1, {F}, g)[0][0]; };
  const double fiber = 0.5 * 10 * mu * 0.01, volume = 0.5 * lambda * (J - 1) * (J - 1);
  EXPECT_NEAR(energy(squeezed, 0), fiber + volume, 1e-11 * mu);
  EXPECT_NEAR(energy(stretched, 0), fiber, 1e-11 * mu);
  const Tensor tau = stress(law, stretched, 0);
  EXPECT_NEAR(tau(0, 0), 10 * mu * 0.1 * 1.1, 1e-11 * mu);
  EXPECT_NEAR(tau(1, 1), 0, 1e-11 * mu);
}

TEST(QrResponse, EffectiveStressIsThatOfTheUndamagedMatrix) {
  const auto all = every_kind_of_deformation();
  const Field sigma = evaluate_all(qr(50, 20), CLEAVE_FIELD_EFFECTIVE_STRESS, 6, all, 0.1, frame(2)),
              tau = evaluate_all(qr(), CLEAVE_FIELD_TAU, 6, all);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const double J = all[k].determinant();
    const Tensor expected = tensor(tau[k]) / std::copysign(std::max(std::abs(J), 1e-3), J);
    // The sign of a determinant that is zero to rounding is nobody's.
    const Tensor found = std::abs(J) < 1e-14 && (tensor(sigma[k]).array() * expected.array()).sum() < 0
                             ? Tensor(-tensor(sigma[k]))
                             : tensor(sigma[k]);
    EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-12 * (expected.cwiseAbs().maxCoeff() + mu)) << k;
  }
}

// tau of F = (1 + e) I is (3 lambda - mu) e to first order: kappa = lambda - mu/3, or lambda + 2 mu/3 with lambda + mu for
// lambda.
TEST(QrResponse, ModuliOfTheLinearisedSolid) {
  const Instance published = qr(30, 10), linear = qr(30, 10, "small-strain");
  EXPECT_NEAR(ElasticProbe(published).get()->shear_modulus, mu, 1e-8 * mu);
  EXPECT_NEAR(ElasticProbe(published).get()->bulk_modulus, lambda - mu / 3, 1e-8 * mu);
  EXPECT_NEAR(ElasticProbe(linear).get()->shear_modulus, mu, 1e-8 * mu);
  EXPECT_NEAR(ElasticProbe(linear).get()->bulk_modulus, lambda + 2 * mu / 3, 1e-8 * mu);
  for (const Instance* law : {&published, &linear}) {
    const auto response = law->isochoric_response();
    ASSERT_TRUE(response);
    EXPECT_EQ(response->pressure_law, std::uint32_t(CLEAVE_PRESSURE_LINEAR));
    EXPECT_NEAR(response->deviatoric_modulus, mu, 1e-10 * mu);
    EXPECT_NEAR(response->bulk_modulus, ElasticProbe(*law).get()->bulk_modulus, 1e-8 * mu);
  }
}

TEST(QrParameters, MaterialWithoutAStableRestStateIsRefused) {
  auto registry = built_plugins();
  const auto plugin = registry.load("elasticity/qr");
  const auto refusal = [&](GivenParameters given) -> std::string {
    try {
      Instance(plugin, given, {});
      return "";
    } catch (const InputError& error) {
      return error.what();
    }
  };
  EXPECT_EQ(refusal(stiff(1000, 0.126)), "");
  EXPECT_EQ(refusal(stiff(1000, 0.124)),
            "elasticity/qr: poissons_ratio must be above 1/8 with calibration = \"published\", whose rest state is unstable "
            "otherwise; or give calibration = \"small-strain\"");
  EXPECT_EQ(refusal({{"shear_modulus", 10.}, {"bulk_modulus", 10.1}}), "");
  EXPECT_NE(refusal({{"shear_modulus", 10.}, {"bulk_modulus", 9.9}}).find("bulk_modulus must be above shear_modulus"),
            std::string::npos);
  GivenParameters auxetic = stiff(1000, -0.3);
  auxetic["calibration"] = std::string("small-strain");
  EXPECT_EQ(refusal(auxetic), "");
}

TEST(QrParameters, FibersAreNeededWhereTheyAreStiff) {
  const Instance isotropic = qr(0, 0), one = qr(5, 0), cross = qr(0, 5);
  EXPECT_FALSE(isotropic.can(CLEAVE_NEEDS_FIBER));
  EXPECT_FALSE(isotropic.can(CLEAVE_NEEDS_SECOND_FIBER));
  EXPECT_TRUE(one.can(CLEAVE_NEEDS_FIBER));
  EXPECT_FALSE(one.can(CLEAVE_NEEDS_SECOND_FIBER));
  EXPECT_TRUE(cross.can(CLEAVE_NEEDS_FIBER));
  EXPECT_TRUE(cross.can(CLEAVE_NEEDS_SECOND_FIBER));

  auto registry = built_plugins();
  std::vector<std::string> warnings;
  point::LawChoice choice;
  choice.elasticity = "qr";
  choice.sets = {"elasticity.youngs_modulus=1000", "elasticity.poissons_ratio=0.3"};
  EXPECT_NO_THROW(point::make_laws(choice, registry, warnings));
  choice.sets.push_back("elasticity.fiber_scale=5");
  try {
    point::make_laws(choice, registry, warnings);
    FAIL() << "fibres are missing";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("give --fiber"), std::string::npos) << error.what();
  }
  choice.fiber = "0,1,0";
  EXPECT_NO_THROW(point::make_laws(choice, registry, warnings));
}

/// Largest rho_0 c^2 over waves in many directions n: the eigenvalues of Q m = (dP along (m n^T) F) F^T n.
double fastest_wave(const Instance& law, const Tensor& F, const Tensor& D) {
  constexpr int directions = 400;
  std::vector<Eigen::Vector3d> waves;
  for (int i = 0; i < directions; ++i) {
    const double z = (i + 0.5) / directions, angle = 2.399963229728653 * i, r = std::sqrt(1 - z * z);
    waves.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
  }
  for (int j = 0; j < 3; ++j) waves.push_back((F * D.col(j)).normalized());
  LawDriver<double> driver;
  Field along;
  for (const auto& n : waves)
    for (int j = 0; j < 3; ++j) along.push_back(row_major(Eigen::Vector3d::Unit(j) * n.transpose() * F));
  driver.input(CLEAVE_FIELD_F, {row_major(F)}).input(CLEAVE_FIELD_DELTA_F, along).output(CLEAVE_FIELD_DELTA_P, 9);
  driver.constant(CLEAVE_FIELD_FIBER, column(D, 0)).constant(CLEAVE_FIELD_SECOND_FIBER, column(D, 1));
  EXPECT_EQ(driver.run(evaluate<double>(law), law.handle(), std::uint32_t(along.size())), CLEAVE_OK);
  double fastest = 0;
  for (std::size_t i = 0; i < waves.size(); ++i) {
    Tensor Q;
    for (int j = 0; j < 3; ++j)
      Q.col(j) = tensor(driver.value(CLEAVE_FIELD_DELTA_P, std::uint32_t(3 * i) + std::uint32_t(j))) * F.transpose() * waves[i];
    fastest = std::max(fastest, Eigen::SelfAdjointEigenSolver<Tensor>(0.5 * (Q + Q.transpose())).eigenvalues()(2));
  }
  return fastest;
}

TEST(QrWaveModulus, BoundsTheAcousticTensorAndIsNotFarAbove) {
  double loosest = 0, loosest_near_rest = 0;
  for (const auto& [kx, ky] : {std::pair(0., 0.), {10., 0.}, {100., 100.}, {5., 2.}}) {
    const Instance law = qr(kx, ky);
    const Tensor D = frame(unsigned(kx));
    const auto near_rest = deformations(6, 0.05), far = deformations(8, 0.5, 3);
    std::vector<Tensor> states{Tensor::Identity()};
    states.insert(states.end(), near_rest.begin(), near_rest.end());
    states.insert(states.end(), far.begin(), far.end());
    states.push_back(Eigen::Vector3d(0.8, 0.7, -0.4).asDiagonal());
    const Field bounds = evaluate_all(law, CLEAVE_FIELD_WAVE_MODULUS, 1, states, 1, D);
    for (std::size_t k = 0; k < states.size(); ++k) {
      const double fastest = fastest_wave(law, states[k], D), ratio = bounds[k][0] / fastest;
      EXPECT_GE(ratio, 1 - 1e-9) << kx << " " << ky << "\n" << states[k];
      EXPECT_LE(ratio, k <= near_rest.size() ? 1.15 : 1.5) << kx << " " << ky << "\n" << states[k];
      (k <= near_rest.size() ? loosest_near_rest : loosest) =
          std::max(k <= near_rest.size() ? loosest_near_rest : loosest, ratio);
    }
    if (ky == 0) {
      EXPECT_NEAR(bounds[0][0], lambda + (1 + kx) * mu, 1e-9 * bounds[0][0]) << "exact at rest with one fibre";
    }
  }
  RecordProperty("largest_ratio", std::to_string(loosest));
  RecordProperty("largest_ratio_near_rest", std::to_string(loosest_near_rest));
}

}  // namespace
}  // namespace cleave::plugins::test
