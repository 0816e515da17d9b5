#include <cleave/isochoric_return.hpp>

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace cleave {
namespace {

/// det(a + x I) - 1 and the size of the terms it is the difference of.
template <class S>
void expect_root(double a1, double a2, double a3, double tolerance) {
  const double squared = a1 * a1 + a2 * a2 + a3 * a3;
  const Lanes<S> root = isochoric_mean<Lanes<S>>(Lanes<S>(S(squared)), Lanes<S>(S(a1 * a2 * a3)));
  for (int lane = 0; lane < Lanes<S>::width; ++lane) EXPECT_EQ(root[lane], root[0]);
  const double x = double(root[0]), smallest = x + std::min({a1, a2, a3});
  EXPECT_GE(smallest, -tolerance * x) << a1 << ' ' << a2 << ' ' << a3;
  EXPECT_NEAR((a1 + x) * (a2 + x) * (a3 + x) / (x * x * x), 1 / (x * x * x), tolerance) << a1 << ' ' << a2 << ' ' << a3;
}

TEST(IsochoricMean, MakesTheDeterminantOneForShearOfAnySizeAndKind) {
  for (double size : {0., 1e-8, 1e-3, 0.1, 0.5, 1., 2., 5., 30., 1e3})
    for (int k = 0; k <= 24; ++k) {
      const double angle = k * M_PI / 12;  // of all deviators of one size
      const double a = size * std::cos(angle), b = size * std::cos(angle + 2 * M_PI / 3);
      expect_root<double>(a, b, -a - b, 4e-15);
      expect_root<float>(a, b, -a - b, 2e-6);
    }
}

TEST(IsochoricMean, FindsTheMeanOfAKnownStrain) {
  // b with det b = 1 is its deviator plus tr(b)/3, whatever the shear.
  for (const std::array<double, 3> b : {std::array{4., 0.5, 0.5}, {0.04, 5., 5.}, {100., 0.02, 0.5}, {1.02, 1 / 1.02, 1.}}) {
    const double mean = (b[0] + b[1] + b[2]) / 3;
    const double a[3] = {b[0] - mean, b[1] - mean, b[2] - mean};
    EXPECT_NEAR(isochoric_mean<double>(a[0] * a[0] + a[1] * a[1] + a[2] * a[2], a[0] * a[1] * a[2]), mean, 1e-13 * mean);
  }
}

TEST(IsochoricReturn, ExactKeepsTheVolumeAndTraceLosesIt) {
  // Sheared strain of J = 1 returned to isotropy: tr(b)/3 = 5/3, J = (5/3)^(3/2) = 2.1517.
  const Symmetric3<double> b = diagonal(Vector3<double>(4, 0.5, 0.5));
  const IsochoricTrial<double> trial(b);
  EXPECT_NEAR(determinant(isochoric_return(Closure::exact, trial, 0.)), 1, 1e-14);
  const Symmetric3<double> drifted = isochoric_return(Closure::trace, trial, 0.);
  EXPECT_NEAR(std::sqrt(determinant(drifted)), std::pow(5. / 3, 1.5), 1e-14);
  EXPECT_NEAR(trace(drifted), trace(b), 1e-14);
}

TEST(IsochoricReturn, ScalesTheShapeAtTheVolumeOfTheTrial) {
  const Symmetric3<double> b(2.3, 0.9, 1.4, 0.3, -0.5, 0.2);
  const IsochoricTrial<double> trial(b);
  for (double k : {0., 0.2, 0.7, 1.}) {
    const IsochoricTrial<double> returned(isochoric_return(Closure::exact, trial, k));
    EXPECT_NEAR(returned.squared_jacobian, trial.squared_jacobian, 1e-13);
    EXPECT_LT(norm(returned.shape - k * trial.shape), 1e-14);
  }
  EXPECT_LT(norm(isochoric_return(Closure::exact, trial, 1.) - b), 1e-13);
}

TEST(IsochoricReturn, ClosuresAgreeToSecondOrderInTheShear) {
  const auto gap = [](double shear) {
    const IsochoricTrial<double> trial(Symmetric3<double>(1 + shear * shear, 1, 1, shear, 0, 0));
    return norm(isochoric_return(Closure::exact, trial, 0.5) - isochoric_return(Closure::trace, trial, 0.5));
  };
  EXPECT_GT(gap(0.01), 1e-5);
  EXPECT_NEAR(gap(0.01) / gap(0.005), 4, 0.01);
}

TEST(VolumetricStrain, HasTheVolumeAskedFor) {
  for (double J : {1e-6, 0.5, 1., 7.}) EXPECT_NEAR(determinant(volumetric_strain(J)), J * J, 1e-14 * J * J);
  EXPECT_EQ(volumetric_strain(0.)(0, 0), 0);
}

}  // namespace
}  // namespace cleave
