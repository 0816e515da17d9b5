#include <cleave/dual.hpp>
#include <functional>
#include <string>
#include <vector>

#include "numbers.hpp"

namespace cleave {
namespace {

using D = Dual<double, 1>;
using DD = Dual<D, 1>;

struct Case {
  std::string name;
  double at;
  std::function<double(double)> plain;
  std::function<D(D)> dual;
  std::function<DD(DD)> nested;
};
#define CLEAVE_CASE(at, f)                                                                          \
  Case {                                                                                            \
#f, at, [](auto x) { return f; }, [](auto x) -> D { return f; }, [](auto x) -> DD { return f; } \
  }

const std::vector<Case>& cases() {
  static const std::vector<Case> all{
      CLEAVE_CASE(0.7, x * x * x - 2 * x + 1),
      CLEAVE_CASE(0.7, (x + 1) / (x * x + 2)),
      CLEAVE_CASE(0.7, 3 / x),
      CLEAVE_CASE(0.7, sqrt(x)),
      CLEAVE_CASE(0.7, rsqrt(x)),
      CLEAVE_CASE(0.7, cbrt(x)),
      CLEAVE_CASE(-0.7, cbrt(x)),
      CLEAVE_CASE(0.7, rcbrt(x)),
      CLEAVE_CASE(0.7, exp(x)),
      CLEAVE_CASE(0.7, expm1(x)),
      CLEAVE_CASE(0.7, log(x)),
      CLEAVE_CASE(0.7, log1p(x)),
      CLEAVE_CASE(0.7, sinh(x)),
      CLEAVE_CASE(0.7, cosh(x)),
      CLEAVE_CASE(0.7, asinh(x)),
      CLEAVE_CASE(0.7, sin(x)),
      CLEAVE_CASE(0.7, cos(x)),
      CLEAVE_CASE(0.7, atan2(x, 2 * x * x)),
      CLEAVE_CASE(-0.7, atan2(1.0, x)),
      CLEAVE_CASE(0.7, pow(x, 2.5)),
      CLEAVE_CASE(-0.7, pow(x, 3)),
      CLEAVE_CASE(0.7, pow(x, x)),
      CLEAVE_CASE(-0.7, abs(x * x * x)),
      CLEAVE_CASE(-0.7, copysign(x * x, 1 - x)),
      CLEAVE_CASE(0.7, fma(x, x, 2 * x)),
      CLEAVE_CASE(0.7, floor(x) + x),
      CLEAVE_CASE(0.7, min(x * x, x)),
      CLEAVE_CASE(0.7, max(x * x, x)),
      CLEAVE_CASE(0.7, select(x > 0 && x < 1, x * x, 5 * x)),
  };
  return all;
}

TEST(Dual, DerivativesAgreeWithFiniteDifferences) {
  for (const Case& c : cases()) {
    const double h = 1e-5;
    const D y = c.dual(D::variable(c.at, 0));
    EXPECT_NEAR(y.value, c.plain(c.at), 1e-15 * std::fabs(y.value)) << c.name;
    EXPECT_NEAR(y.derivative[0], (c.plain(c.at + h) - c.plain(c.at - h)) / (2 * h), 1e-8) << c.name;
  }
}

TEST(Dual, NestedDualsGiveSecondDerivatives) {
  for (const Case& c : cases()) {
    const double h = 1e-5;
    const auto slope = [&](double x) { return c.dual(D::variable(x, 0)).derivative[0]; };
    const DD y = c.nested(DD::variable(D::variable(c.at, 0), 0));
    EXPECT_NEAR(y.derivative[0].value, slope(c.at), 1e-13 * (1 + std::fabs(slope(c.at)))) << c.name;
    EXPECT_NEAR(y.value.derivative[0], slope(c.at), 1e-13 * (1 + std::fabs(slope(c.at)))) << c.name;
    EXPECT_NEAR(y.derivative[0].derivative[0], (slope(c.at + h) - slope(c.at - h)) / (2 * h), 1e-8) << c.name;
  }
}

TEST(Dual, ConstantPowersHaveDerivativesAtZero) {
  const D zero = D::variable(0, 0);
  EXPECT_EQ(pow(zero, 2).derivative[0], 0);
  EXPECT_EQ(pow(zero, 1).derivative[0], 1);
  EXPECT_EQ(pow(zero, 0).derivative[0], 0);
  EXPECT_EQ(pow(zero, D(2)).derivative[0], 0);
}

/// A formula as a material law has it: several variables, a branch, plain coefficients.
template <class T>
T energy(const Symmetric3<T>& b) {
  const double shear_modulus = 3, bulk_modulus = 5;
  const T J2 = determinant(b), J = sqrt(J2);
  const T shear = T(0.5) * shear_modulus * (trace(b) * rcbrt(J2) - 3);
  const T volume = T(0.5) * bulk_modulus * (T(0.5) * (J2 - 1) - log(J));
  return shear + select(J >= 1, volume, T(2) * volume);
}

template <class T>
class DualOver : public ::testing::Test {};
using Numbers = ::testing::Types<double, float, Lanes<double>, Lanes<float>>;
TYPED_TEST_SUITE(DualOver, Numbers);

TYPED_TEST(DualOver, EveryNumberGivesTheGradientAndHessianOfAnEnergy) {
  using T = TypeParam;
  using First = Dual<T, 6>;
  using Second = Dual<First, 6>;
  for (double yy : {1.2, 0.8}) {
    const double point[6] = {1.1, yy, 0.9, 0.1, 0.2, 0.15};
    Symmetric3<Second> b;
    for (int k = 0; k < 6; ++k) b[k] = Second::variable(First::variable(T(point[k]), k), k);
    const Second e = energy(b);

    const auto shifted = [&](int k, double by, int l, double by2) {
      Symmetric3<double> a;
      for (int m = 0; m < 6; ++m) a[m] = point[m] + (m == k ? by : 0) + (m == l ? by2 : 0);
      return energy(a);
    };
    const double h = 1e-4, tolerance = 2e-6 + 400 * testing::epsilon<scalar_of<T>>;
    for (int k = 0; k < 6; ++k) {
      const double slope = (shifted(k, h, k, 0) - shifted(k, -h, k, 0)) / (2 * h);
      EXPECT_NEAR(testing::lane(e.derivative[k].value, 1), slope, tolerance);
      for (int l = 0; l < 6; ++l) {
        const double curvature =
            (shifted(k, h, l, h) - shifted(k, h, l, -h) - shifted(k, -h, l, h) + shifted(k, -h, l, -h)) / (4 * h * h);
        EXPECT_NEAR(testing::lane(e.derivative[k].derivative[l], 1), curvature, 10 * tolerance);
      }
    }
  }
}

TEST(Dual, LanesTakeTheDerivativeOfTheirOwnBranch) {
  using L = Lanes<double>;
  const auto x = Dual<L, 1>::variable(testing::iota(0.5, 1.0), 0);
  const auto y = select(x < 1, x * x, 3 * x);
  EXPECT_EQ(y.derivative[0][0], 1);
  EXPECT_EQ(y.derivative[0][1], 3);
}

}  // namespace
}  // namespace cleave
