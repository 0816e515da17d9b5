// Yield surfaces of return mappings at the loads that textbooks give them for (problems 9 to 11).

#include "figure.hpp"
#include "plasticity/mapping.hpp"

namespace cleave::plugins::test {
namespace {

using cleave::test::any;
using cleave::test::report;

constexpr double yield_stress = 0.2;

Mapping von_mises() { return Mapping("plasticity/von-mises", {{"yield_stress", yield_stress}}); }

/// Kirchhoff stress, tension positive.
Tensor stress(const Mapping& law, const Tensor& b) { return law.deviatoric_stress(b) - law.pressure(b) * Tensor::Identity(); }

/// The strain diag(s, t, t) of uniaxial stress: t where the lateral stress is zero.
Tensor uniaxial(const Mapping& law, double s) {
  double low = 0.2, high = 5;
  for (int i = 0; i < 200; ++i) {
    const double t = (low + high) / 2;
    (stress(law, stretched(s * s, t * t, t * t))(1, 1) < 0 ? low : high) = t;
  }
  return stretched(s * s, low * low, low * low);
}
/// Where yielding sets in between two loads: the largest that does not.
template <class Strain>
Tensor at_yield(const Mapping& law, double low, double high, Strain&& strain) {
  for (int i = 0; i < 200; ++i) {
    const double middle = (low + high) / 2;
    (law.of_b(strain(middle), 0).yielded ? high : low) = middle;
  }
  return strain(low);
}

TEST(VonMisesElement, YieldsAtItsStressInTensionAndAtARootOfThreeLessInShear) {
  const Mapping law = von_mises();
  const Tensor pulled = at_yield(law, 1, 2, [&](double s) { return uniaxial(law, s); });
  report({.row = 9,
          .problem = "von Mises, tau_y = 0.2 Pa, shear modulus 385 Pa",
          .quantity = "uniaxial yield stress, Pa",
          .reference = yield_stress,
          .measured = stress(law, pulled)(0, 0),
          .tolerance = 1e-6});
  const Tensor sheared = at_yield(law, 0, 1, [&](double gamma) {
    const double s = gamma / 2 + std::sqrt(1 + gamma * gamma / 4);  // stretches s, 1/s: pure shear
    return stretched(s * s, 1 / (s * s), 1);
  });

  const Tensor tau = law.deviatoric_stress(sheared);
  report({.row = 9,
          .problem = "von Mises, tau_y = 0.2 Pa, shear modulus 385 Pa",
          .quantity = "shear yield stress, Pa",
          .reference = yield_stress / std::sqrt(3.),
          .measured = (tau(0, 0) - tau(1, 1)) / 2,
          .tolerance = 1e-6});
  double change = 0;
  for (double J : {0.8, 1.0, 1.2}) {
    const Tensor trial = std::pow(J, 2. / 3) * stretched(1.5, 1, 1 / 1.5);
    const auto point = law.of_b(trial, 0);
    EXPECT_TRUE(point.yielded);
    change = std::max(change, std::abs(law.pressure(point.strain) - law.pressure(trial)) / kappa);
  }
  report({.row = 9,
          .problem = "von Mises, tau_y = 0.2 Pa, shear modulus 385 Pa",
          .quantity = "change of p by a return / kappa",
          .measured = change,
          .tolerance = 1e-12,
          .judged = cleave::test::Judged::at_most,
          .scatter = any});
}

TEST(DruckerPragerElement, BearsTheTriaxialCompressionOfItsFrictionAngle) {
  for (const double degrees : {20., 30., 40.}) {
    const Mapping law("plasticity/drucker-prager", {{"friction_angle", degrees}});
    const double sine = std::sin(degrees * M_PI / 180), volume = 0.9;
    const auto point = law.of_b(std::pow(volume, 2. / 3) * stretched(0.5, std::sqrt(2.), std::sqrt(2.)), 0);
    EXPECT_TRUE(point.yielded);
    report({.row = 10,
            .problem = "triaxial compression, phi = " + std::to_string(int(degrees)) + " degrees",
            .quantity = "q/p",
            .reference = 6 * sine / (3 - sine),
            .measured = law.q(point.strain) / law.pressure(point.strain),
            .tolerance = 1e-9});
  }
}

TEST(NaccElement, HasItsEllipse) {
  const double beta = 0.5, M = 2.36, xi = 3, alpha = -0.04, p0 = kappa * (1e-5 + std::sinh(xi * -alpha));
  const Mapping law(
      "plasticity/nacc",
      {{"cohesion", beta}, {"hardening_factor", xi}, {"friction_slope", M}, {"alpha0", alpha}, {"hardening", false}});
  const std::string problem = "NACC, M = 2.36, beta = 0.5, p0 = 0.12 kappa";
  const auto pressed = [&](double J) { return law.of_b(std::pow(J, 2. / 3) * Tensor::Identity(), alpha); };
  report({.row = 11,
          .problem = problem,
          .quantity = "tip under pressure, p / p0",
          .reference = 1,
          .measured = law.pressure(pressed(0.7).strain) / p0,
          .tolerance = 1e-9});
  report({.row = 11,
          .problem = problem,
          .quantity = "tip under tension, p / p0",
          .reference = -beta,
          .measured = law.pressure(pressed(1.3).strain) / p0,
          .tolerance = 1e-9});
  double peak = 0, at = 0, volume = 0;
  for (int i = 1; i < 2000; ++i) {
    const double p = -beta * p0 + (1 + beta) * p0 * i / 2000, J = law.elastic.jacobian(p);
    const Tensor trial = std::pow(J, 2. / 3) * stretched(2, 1, 0.5);
    const auto point = law.of_b(trial, alpha);
    EXPECT_TRUE(point.yielded);
    volume = std::max(volume, std::abs(point.strain.determinant() / trial.determinant() - 1));
    if (law.q(point.strain) > peak) {
      peak = law.q(point.strain);
      at = p;
    }
  }
  report({.row = 11,
          .problem = problem,
          .quantity = "largest q / p0",
          .reference = M * (1 + beta) / (2 * std::sqrt(1 + 2 * beta)),
          .measured = peak / p0,
          .tolerance = 1e-5});
  report({.row = 11,
          .problem = problem,
          .quantity = "p there / p0",
          .reference = (1 - beta) / 2,
          .measured = at / p0,
          .tolerance = 1e-3});
  report({.row = 11,
          .problem = problem,
          .quantity = "change of volume in shear",
          .measured = volume,
          .tolerance = 1e-12,
          .judged = cleave::test::Judged::at_most,
          .scatter = any});
}

}  // namespace
}  // namespace cleave::plugins::test
