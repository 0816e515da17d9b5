#include <cleave/lanes.hpp>
#include <cstring>
#include <vector>

#include "numbers.hpp"

namespace cleave {
namespace {

using testing::infinity;
using testing::iota;
using testing::nan;

template <class S>
struct LanesTest : testing::OnScalar<S> {};
TYPED_TEST_SUITE(LanesTest, testing::Scalars);

TYPED_TEST(LanesTest, FillOneRegister) {
  EXPECT_EQ(sizeof(Lanes<TypeParam>), std::size_t(CLEAVE_LANE_BYTES));
  EXPECT_EQ(Lanes<TypeParam>::width * sizeof(TypeParam), std::size_t(CLEAVE_LANE_BYTES));
}

/// Every operation of the vocabulary, with plain numbers mixed in.
template <class T>
T formula(const T& x) {
  T y = T(0.5) * x * 2 - 3;
  y += max(x, 0);
  y -= min(1.0, x);
  y *= T(1.25);
  y /= 2;
  const T inside = select(x >= 0 && x < 3, y, 7);
  return inside + floor(x) + rsqrt(abs(x) + 1) + sqrt(abs(x)) + fma(x, 2.0, x) - copysign(x, -1.0) + select(!(x == 2), x, -x);
}

TYPED_TEST(LanesTest, EvaluateAFormulaAsPlainNumbersDo) {
  using L = Lanes<TypeParam>;
  const L x = iota<TypeParam>(-2, TypeParam(0.5)), y = formula(x);
  for (int i = 0; i < L::width; ++i)
    EXPECT_NEAR(y[i], formula(x[i]), 8 * testing::epsilon<TypeParam> * std::fabs(formula(x[i]))) << x[i];
}

TYPED_TEST(LanesTest, KeepTheSignOfABroadcastZero) {
  EXPECT_TRUE(std::signbit(Lanes<TypeParam>(-0.0)[0]));
  EXPECT_FALSE(std::signbit(Lanes<TypeParam>(0)[0]));
}

TYPED_TEST(LanesTest, CompareLaneByLane) {
  using L = Lanes<TypeParam>;
  L x = iota<TypeParam>(0, 1);
  x.set(L::width - 1, nan<TypeParam>);
  for (int i = 0; i + 1 < L::width; ++i) {
    EXPECT_EQ((x < 1)[i], x[i] < 1);
    EXPECT_EQ((x <= 1)[i], x[i] <= 1);
    EXPECT_EQ((x > 1)[i], x[i] > 1);
    EXPECT_EQ((x >= 1)[i], x[i] >= 1);
    EXPECT_EQ((x == 1)[i], x[i] == 1);
    EXPECT_EQ((x != 1)[i], x[i] != 1);
  }
  const int last = L::width - 1;
  EXPECT_FALSE((x < 1)[last] || (x <= 1)[last] || (x > 1)[last] || (x >= 1)[last] || (x == x)[last]);
  EXPECT_TRUE((x != x)[last]);
}

TYPED_TEST(LanesTest, ReduceMasks) {
  using L = Lanes<TypeParam>;
  using M = LaneMask<TypeParam>;
  const L x = iota<TypeParam>(0, 1);
  EXPECT_TRUE(any(x > 0) && !all(x > 0) && !none(x > 0));
  EXPECT_TRUE(all(x >= 0) && none(x < 0) && !any(x < 0));
  EXPECT_EQ((x < 2).bits(), 3u);
  EXPECT_EQ(M::first(1).bits(), 1u);
  EXPECT_EQ(M::first(0).bits(), 0u);
  EXPECT_TRUE(all(M::first(L::width)) && all(M(true)) && none(M(false)));
  EXPECT_EQ(M::from_bits(1u).bits(), 1u);
  EXPECT_EQ(((x < 2) ^ (x > 0)).bits(), (!(x == 1)).bits());
}

TYPED_TEST(LanesTest, MinAndMaxTakeTheFirstOfUnorderedNumbersAsTheStandardOnesDo) {
  using L = Lanes<TypeParam>;
  EXPECT_TRUE(std::isnan(min(L(nan<TypeParam>), L(1))[0]));
  EXPECT_EQ(min(L(1), L(nan<TypeParam>))[0], 1);
  EXPECT_TRUE(std::isnan(max(L(nan<TypeParam>), L(1))[0]));
  EXPECT_EQ(max(L(1), L(nan<TypeParam>))[0], 1);
}

TYPED_TEST(LanesTest, RoundDownAndCopySignsOfSpecialNumbers) {
  using S = TypeParam;
  for (S x : {S(0), S(-0.0), S(0.5), S(-0.5), S(2), S(-2), S(-1e-30), S(1e30), S(-1e30), S(8388607.5), S(-4194303.25),
              infinity<S>, -infinity<S>}) {
    const S lowered = floor(Lanes<S>(x))[0];
    EXPECT_EQ(lowered, std::floor(x));
    EXPECT_EQ(std::signbit(lowered), std::signbit(std::floor(x))) << x;
    EXPECT_EQ(std::signbit(abs(Lanes<S>(x))[0]), false);
    EXPECT_EQ(std::signbit(copysign(Lanes<S>(1), Lanes<S>(x))[0]), std::signbit(x));
    EXPECT_EQ(std::fabs(copysign(Lanes<S>(x), Lanes<S>(-1))[0]), std::fabs(x));
  }
  EXPECT_TRUE(std::isnan(floor(Lanes<S>(nan<S>))[0]));
}

TYPED_TEST(LanesTest, ReciprocalSquareRootIsPreciseEverywhere) {
  using S = TypeParam;
  testing::Random random;
  const double range = std::numeric_limits<S>::max_exponent - 2;
  for (int sample = 0; sample < 5000; ++sample) {
    const S x = static_cast<S>(std::exp2(random.uniform(-range, range)));
    EXPECT_LE(testing::error_in_ulp(rsqrt(Lanes<S>(x))[0], 1 / std::sqrt(static_cast<long double>(x))), 1.5) << x;
  }
  EXPECT_EQ(rsqrt(Lanes<S>(0))[0], infinity<S>);
  EXPECT_EQ(rsqrt(Lanes<S>(infinity<S>))[0], 0);
  EXPECT_TRUE(std::isnan(rsqrt(Lanes<S>(-1))[0]) && std::isnan(rsqrt(Lanes<S>(nan<S>))[0]));
}

TYPED_TEST(LanesTest, TouchNoMemoryBeyondTheCount) {
  using S = TypeParam;
  using L = Lanes<S>;
  const std::vector<S> source{1, 2, 3};
  const int count = std::min(3, L::width);
  const L x = L::load_first(source.data(), count, S(9));
  for (int i = 0; i < L::width; ++i) EXPECT_EQ(x[i], i < count ? source[std::size_t(i)] : 9);
  std::vector<S> target(std::size_t(L::width) + 1, S(-1));
  x.store_first(target.data(), count - 1);
  EXPECT_EQ(target[std::size_t(count) - 2], x[count - 2]);
  EXPECT_EQ(target[std::size_t(count) - 1], -1);
}

TYPED_TEST(LanesTest, StoreWhatTheyLoaded) {
  using S = TypeParam;
  using L = Lanes<S>;
  alignas(CLEAVE_LANE_BYTES) S memory[2 * L::width + 1];
  for (int i = 0; i < 2 * L::width + 1; ++i) memory[i] = S(i);
  L::load(memory).store(memory + L::width);
  EXPECT_EQ(memory[2 * L::width - 1], L::width - 1);
  L::load_unaligned(memory + 1).store_unaligned(memory + L::width + 1);
  EXPECT_EQ(memory[2 * L::width], memory[L::width]);
}

}  // namespace
}  // namespace cleave
