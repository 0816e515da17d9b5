#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/gtest.hpp>

#include <cmath>

namespace {
namespace kit = cleave::testkit;

/// Every check that `cleave check` makes, as a test of its own.
CLEAVE_CONFORMANCE_TESTS({{Type}}, PLUGIN);

// The kit creates return mappings beside this elastic law: s = mu J^(-2/3) dev(b).
constexpr double mu = kit::Material::shear_modulus;
constexpr double yield_stress = 0.1 * mu, hardening_modulus = 0.5 * mu;

struct Returned {
  std::vector<double> b;  ///< xx, yy, zz, xy, xz, yz
  double plastic_strain;
  double q;  ///< sqrt(3/2) |s| of b [Pa]
};

Returned returned_from(const std::vector<double>& b, double plastic_strain) {
  const kit::Plugin plugin(PLUGIN);
  const kit::Instance law(plugin, {{"yield_stress", yield_stress}, {"hardening_modulus", hardening_modulus}});
  kit::Request request;
  request.count = 1;
  request.inputs[CLEAVE_FIELD_B] = {b};
  request.inputs[CLEAVE_FIELD_STATE] = {{plastic_strain}};
  request.outputs[CLEAVE_FIELD_B_OUT] = 6;
  request.outputs[CLEAVE_FIELD_STATE_OUT] = 1;
  const auto answer = kit::evaluated(law, kit::Precision::double_precision, request);
  Returned r{answer.outputs.at(CLEAVE_FIELD_B_OUT)[0], answer.outputs.at(CLEAVE_FIELD_STATE_OUT)[0][0], 0};

  const double xx = r.b[0], yy = r.b[1], zz = r.b[2], xy = r.b[3];  // xz = yz = 0 here
  const double J = std::sqrt(zz * (xx * yy - xy * xy)), mean = (xx + yy + zz) / 3;
  const double square = (xx - mean) * (xx - mean) + (yy - mean) * (yy - mean) + (zz - mean) * (zz - mean) + 2 * xy * xy;
  r.q = mu * std::pow(J, -2. / 3) * std::sqrt(1.5 * square);
  return r;
}

TEST({{Type}}Return, LeavesElasticStrainAlone) {
  const double shear = 0.05;  // q is about sqrt(3) mu shear, below the yield stress
  const std::vector<double> b{1 + shear * shear, 1, 1, shear, 0, 0};
  const Returned r = returned_from(b, 0);
  EXPECT_EQ(r.b, b);
  EXPECT_EQ(r.plastic_strain, 0);
}

TEST({{Type}}Return, EndsAtTheHardenedYieldStressWithoutChangeOfVolume) {
  const double shear = 0.4, before = 0.02;
  const Returned r = returned_from({1 + shear * shear, 1, 1, shear, 0, 0}, before);
  EXPECT_NEAR(r.q, yield_stress + hardening_modulus * r.plastic_strain, 1e-10 * mu);
  EXPECT_NEAR(r.b[2] * (r.b[0] * r.b[1] - r.b[3] * r.b[3]), 1, 1e-12);

  // By hand: J = 1, q_trial = mu sqrt(3/2 |dev b|^2) with |dev b|^2 = 2/3 shear^4 + 2 shear^2, and mu' = mu (1 + shear^2/3).
  const double q = mu * std::sqrt(std::pow(shear, 4) + 3 * shear * shear), stiffness = 3 * mu + mu * shear * shear;
  EXPECT_NEAR(r.plastic_strain - before,
              (q - yield_stress - hardening_modulus * before) / (stiffness + hardening_modulus), 1e-12);
}

}  // namespace
