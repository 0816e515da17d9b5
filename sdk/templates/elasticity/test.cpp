#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/gtest.hpp>

namespace {
namespace kit = cleave::testkit;

/// Every check that `cleave check` makes, as a test of its own.
CLEAVE_CONFORMANCE_TESTS({{Type}}, PLUGIN);

constexpr double mu = 1000, lambda = 2000;  // Pa

/// Holds the law's Kirchhoff stress at F against `tau`: xx, yy, zz, xy, xz, yz [Pa].
void expect_stress(const std::vector<double>& F, const std::vector<double>& tau) {
  const kit::Plugin plugin(PLUGIN);
  const kit::Instance law(plugin, {{"shear_modulus", mu}, {"bulk_modulus", lambda + 2 * mu / 3}});
  kit::Request request;
  request.count = 1;
  request.inputs[CLEAVE_FIELD_F] = {F};
  request.outputs[CLEAVE_FIELD_TAU] = 6;
  for (const auto precision : {kit::Precision::single_precision, kit::Precision::double_precision}) {
    const auto computed = kit::evaluated(law, precision, request).outputs.at(CLEAVE_FIELD_TAU)[0];
    const double rounding = precision == kit::Precision::single_precision ? 1e-6 : 1e-14;
    for (std::size_t i = 0; i < 6; ++i)
      EXPECT_NEAR(computed[i], tau[i], 10 * rounding * (mu + lambda)) << kit::name(precision) << ", component " << i;
  }
}

// By hand, the formula gives tau = mu (b - I) + lambda/2 (J^2 - 1) I.

TEST({{Type}}Stress, OfSimpleShear) {
  const double shear = 0.3;
  expect_stress({1, shear, 0, 0, 1, 0, 0, 0, 1}, {mu * shear * shear, 0, 0, mu * shear, 0, 0});
}

TEST({{Type}}Stress, OfUniaxialStrain) {
  for (const double stretch : {0.6, 1.8}) {
    const double volume = lambda / 2 * (stretch * stretch - 1);
    expect_stress({stretch, 0, 0, 0, 1, 0, 0, 0, 1}, {mu * (stretch * stretch - 1) + volume, volume, volume, 0, 0, 0});
  }
}

}  // namespace
