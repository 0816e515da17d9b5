#include <cleave/math.hpp>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "numbers.hpp"

namespace cleave {
namespace {

using testing::error_in_ulp;
using testing::infinity;
using testing::nan;

template <class S>
struct MathTest : testing::OnScalar<S> {};
TYPED_TEST_SUITE(MathTest, testing::Scalars);

/// A function on lanes and the same one in extended precision.
template <class S>
struct Function {
  std::string name;
  std::function<Lanes<S>(Lanes<S>)> on_lanes;
  long double (*exact)(long double);
};

template <class S>
struct Interval {
  double from, to;
  bool logarithmic;  ///< from and to are binary exponents
};

/// The largest error over random arguments, both signs of logarithmic ones.
template <class S>
void expect_precise(const Function<S>& f, const Interval<S>& on, double most_ulp) {
  testing::Random random;
  double worst = 0;
  S worst_argument = 0;
  for (int sample = 0; sample < 20000 / Lanes<S>::width; ++sample) {
    Lanes<S> x;
    for (int i = 0; i < Lanes<S>::width; ++i) {
      const double v = random.uniform(on.from, on.to);
      x.set(i, static_cast<S>(on.logarithmic ? std::exp2(v) : v));
    }
    const Lanes<S> y = f.on_lanes(x);
    for (int i = 0; i < Lanes<S>::width; ++i) {
      const double error = error_in_ulp(y[i], f.exact(x[i]));
      if (error > worst) worst = error, worst_argument = x[i];
    }
  }
  EXPECT_LE(worst, most_ulp) << f.name << " at " << worst_argument;
}

#define CLEAVE_FUNCTION(S, f)                                                     \
  Function<S> {                                                                   \
#f, [](Lanes <S> x) { return f(x); }, [](long double x) { return std::f(x); } \
  }

TYPED_TEST(MathTest, ExponentialsArePrecise) {
  using S = TypeParam;
  const double end = sizeof(S) == 4 ? 87 : 708;
  const double tiny = sizeof(S) == 4 ? -120 : -1000;
  for (Interval<S> on : {Interval<S>{-end, end, false}, {-1, 1, false}, {tiny, 0, true}}) {
    expect_precise(CLEAVE_FUNCTION(S, exp), on, 2);
    expect_precise(CLEAVE_FUNCTION(S, expm1), on, 3);
    expect_precise(CLEAVE_FUNCTION(S, sinh), on, 3);
    expect_precise(CLEAVE_FUNCTION(S, cosh), on, 3);
  }
}

TYPED_TEST(MathTest, LogarithmsArePrecise) {
  using S = TypeParam;
  const double end = std::numeric_limits<S>::max_exponent - 2;
  for (Interval<S> on : {Interval<S>{-end, end, true}, {0.5, 2, false}, {0.99, 1.01, false}}) {
    expect_precise(CLEAVE_FUNCTION(S, log), on, 2);
    expect_precise(CLEAVE_FUNCTION(S, log1p), on, 2);
    expect_precise(CLEAVE_FUNCTION(S, asinh), on, 3);
  }
  expect_precise(CLEAVE_FUNCTION(S, log1p), {-0.9999, 2, false}, 2);
  expect_precise(CLEAVE_FUNCTION(S, asinh), {-3, 3, false}, 3);
}

TYPED_TEST(MathTest, CubeRootsArePrecise) {
  using S = TypeParam;
  const Function<S> rcbrt_function{"rcbrt", [](Lanes<S> x) { return rcbrt(x); },
                                   [](long double x) { return 1 / std::cbrt(x); }};
  const double end = std::numeric_limits<S>::max_exponent - 2;
  for (Interval<S> on : {Interval<S>{-end, end, true}, {-10, 10, false}}) {
    expect_precise(CLEAVE_FUNCTION(S, cbrt), on, 1.5);
    expect_precise(rcbrt_function, on, 2);
  }
}

TYPED_TEST(MathTest, SineAndCosineArePrecise) {
  using S = TypeParam;
  for (Interval<S> on : {Interval<S>{-10, 10, false}, {-9e5, 9e5, false}, {1e6, 1e9, false}, {-100, 2, true}}) {
    expect_precise(CLEAVE_FUNCTION(S, sin), on, 3);
    expect_precise(CLEAVE_FUNCTION(S, cos), on, 3);
  }
}

TYPED_TEST(MathTest, PowerIsPreciseAlsoWhereTheExponentMagnifiesErrorsOfTheLogarithm) {
  using S = TypeParam;
  testing::Random random;
  const double reach = std::numeric_limits<S>::max_exponent - 2;
  double worst = 0;
  for (int sample = 0; sample < 5000; ++sample) {
    const S x = static_cast<S>(std::exp2(random.uniform(-3, 3)));
    const S y = static_cast<S>(random.uniform(-reach, reach) / std::max(1.0, std::fabs(std::log2(double(x)))));
    worst = std::max(worst, error_in_ulp(pow(Lanes<S>(x), Lanes<S>(y))[0], std::pow((long double)x, (long double)y)));
  }
  EXPECT_LE(worst, 2);
}

TYPED_TEST(MathTest, AngleIsPreciseInEveryQuadrant) {
  using S = TypeParam;
  testing::Random random;
  double worst = 0;
  for (int sample = 0; sample < 10000; ++sample) {
    const S x = static_cast<S>(random.uniform(-3, 3)), y = static_cast<S>(random.uniform(-3, 3));
    worst = std::max(worst, error_in_ulp(atan2(Lanes<S>(y), Lanes<S>(x))[0], std::atan2((long double)y, (long double)x)));
  }
  EXPECT_LE(worst, 3);
}

template <class S>
std::vector<S> special_numbers() {
  using limits = std::numeric_limits<S>;
  return {S(0),
          S(-0.0),
          S(1),
          S(-1),
          S(0.5),
          S(-0.5),
          S(2),
          S(-2),
          S(3),
          S(-3),
          S(2.5),
          S(-2.5),
          infinity<S>,
          -infinity<S>,
          nan<S>,
          limits::max(),
          limits::lowest(),
          limits::min(),
          limits::denorm_min(),
          limits::denorm_min() * 12345,
          S(1e30),
          S(-1e30),
          S(1e-30)};
}

template <class S>
void expect_same(const char* name, S computed, S exact, S x, S y = 0) {
  EXPECT_LE(error_in_ulp(computed, exact), 4) << name << '(' << x << ", " << y << ") = " << computed << ", not " << exact;
  EXPECT_TRUE(exact != 0 || std::signbit(computed) == std::signbit(exact)) << name << '(' << x << ", " << y << ')';
}

TYPED_TEST(MathTest, SpecialNumbersGiveWhatTheStandardLibraryGives) {
  using S = TypeParam;
  for (S x : special_numbers<S>()) {
    const Lanes<S> l(x);
    expect_same("exp", exp(l)[0], std::exp(x), x);
    expect_same("expm1", expm1(l)[0], std::expm1(x), x);
    expect_same("log", log(l)[0], std::log(x), x);
    expect_same("log1p", log1p(l)[0], std::log1p(x), x);
    expect_same("cbrt", cbrt(l)[0], std::cbrt(x), x);
    expect_same("rcbrt", rcbrt(l)[0], 1 / std::cbrt(x), x);
    expect_same("sinh", sinh(l)[0], std::sinh(x), x);
    expect_same("cosh", cosh(l)[0], std::cosh(x), x);
    expect_same("asinh", asinh(l)[0], std::asinh(x), x);
    expect_same("sin", sin(l)[0], std::sin(x), x);
    expect_same("cos", cos(l)[0], std::cos(x), x);
    for (S y : special_numbers<S>()) {
      expect_same("pow", pow(l, Lanes<S>(y))[0], std::pow(x, y), x, y);
      expect_same("atan2", atan2(l, Lanes<S>(y))[0], std::atan2(x, y), x, y);
    }
  }
}

TYPED_TEST(MathTest, ResultsBeyondTheRangeOverflowAndUnderflow) {
  using S = TypeParam;
  const S end = sizeof(S) == 4 ? S(104) : S(746);
  EXPECT_EQ(exp(Lanes<S>(end))[0], infinity<S>);
  EXPECT_EQ(exp(Lanes<S>(-end))[0], 0);
  EXPECT_EQ(pow(Lanes<S>(10), 400)[0], infinity<S>);
  EXPECT_EQ(pow(Lanes<S>(10), -400)[0], 0);
  const S last = sizeof(S) == 4 ? S(89.4) : S(710.4);
  EXPECT_LE(error_in_ulp(sinh(Lanes<S>(last))[0], std::sinh((long double)last)), 3);
  const S subnormal = sizeof(S) == 4 ? S(-95) : S(-740);
  EXPECT_LE(error_in_ulp(exp(Lanes<S>(subnormal))[0], std::exp((long double)subnormal)), 2);
}

TYPED_TEST(MathTest, ALaneDoesNotInfluenceItsNeighbours) {
  using S = TypeParam;
  using L = Lanes<S>;
  const std::vector<std::function<L(L)>> functions{
      [](L x) { return exp(x); },          [](L x) { return expm1(x); }, [](L x) { return log(x); },
      [](L x) { return log1p(x); },        [](L x) { return cbrt(x); },  [](L x) { return rcbrt(x); },
      [](L x) { return sinh(x); },         [](L x) { return cosh(x); },  [](L x) { return asinh(x); },
      [](L x) { return sin(x); },          [](L x) { return cos(x); },   [](L x) { return pow(x, S(1.3)); },
      [](L x) { return atan2(x, S(0.7)); }};
  const L x = testing::iota<S>(S(0.125), S(0.375));
  for (std::size_t f = 0; f < functions.size(); ++f)
    for (S intruder : {nan<S>, infinity<S>, S(-1), S(1e30)}) {
      L disturbed = x;
      disturbed.set(1, intruder);
      const L alone = functions[f](x), beside = functions[f](disturbed);
      for (int i = 0; i < L::width; ++i) {
        if (i == 1) continue;
        const S a = alone[i], b = beside[i];
        EXPECT_EQ(std::memcmp(&a, &b, sizeof(S)), 0) << "function " << f << ", lane " << i;
      }
    }
}

}  // namespace
}  // namespace cleave
