#include <cleave/tensor.hpp>

#include "numbers.hpp"

namespace cleave {
namespace {

using testing::largest;
using testing::Random;
constexpr double tiny = 1e-13;

using M = Matrix3<double>;
using S = Symmetric3<double>;
using V = Vector3<double>;

M minus(const M& a, const M& b) { return a - b; }

TEST(Tensor, StoresComponentsInTheOrderOfTheBinaryInterface) {
  const S s(1, 2, 3, 4, 5, 6);
  EXPECT_EQ(s(0, 0), 1);
  EXPECT_EQ(s(1, 1), 2);
  EXPECT_EQ(s(2, 2), 3);
  EXPECT_EQ(s(0, 1), 4);
  EXPECT_EQ(s(2, 0), 5);
  EXPECT_EQ(s(1, 2), 6);
  const M m(1, 2, 3, 4, 5, 6, 7, 8, 9);
  EXPECT_EQ(m(1, 2), 6);
  EXPECT_EQ(m(2, 0), 7);
  EXPECT_EQ(m.row(1)[2], m(1, 2));
  EXPECT_EQ(m.column(2)[1], m(1, 2));
}

TEST(Tensor, InverseTimesTensorIsTheIdentity) {
  Random random;
  for (int sample = 0; sample < 20; ++sample) {
    const M a = random.with_singular_values(2, 1, -0.5);
    EXPECT_LE(largest(inverse(a) * a - identity<double>()), tiny);
    const S s = left_cauchy_green(a);
    EXPECT_LE(largest(inverse(s) * s - identity<double>()), 10 * tiny);
  }
}

TEST(Tensor, CofactorIsTheDerivativeOfTheDeterminant) {
  Random random;
  const M a = random.matrix();
  const double h = 1e-6;
  for (int k = 0; k < 9; ++k) {
    M up = a, down = a;
    up[k] += h;
    down[k] -= h;
    EXPECT_NEAR(cofactor(a)[k], (determinant(up) - determinant(down)) / (2 * h), 1e-8);
  }
  EXPECT_LE(largest(minus(cofactor(left_cauchy_green(a)), cofactor(M(left_cauchy_green(a))))), 100 * tiny);
}

TEST(Tensor, DeltaCofactorIsTheDerivativeOfTheCofactor) {
  Random random;
  const M a = random.matrix(), b = random.matrix();
  // The cofactor is quadratic: its central difference is exact.
  EXPECT_LE(largest(minus(delta_cofactor(a, b), 0.5 * (cofactor(a + b) - cofactor(a - b)))), 100 * tiny);
}

TEST(Tensor, DeterminantIsMultiplicative) {
  Random random;
  const M a = random.matrix(), b = random.matrix();
  EXPECT_NEAR(determinant(a * b), determinant(a) * determinant(b), 100 * tiny);
  EXPECT_NEAR(determinant(left_cauchy_green(a)), determinant(a) * determinant(a), 100 * tiny);
}

TEST(Tensor, ContractionIsTheTraceOfTheProductWithTheTranspose) {
  Random random;
  const M a = random.matrix(), b = random.matrix();
  EXPECT_NEAR(contract(a, b), trace(transpose(a) * b), tiny);
  const S s = symmetric_part(a), t = symmetric_part(b);
  EXPECT_NEAR(contract(s, t), contract(M(s), M(t)), tiny);
  EXPECT_NEAR(contract(s, b), contract(M(s), b), tiny);
  EXPECT_NEAR(norm(s) * norm(s), squared_norm(M(s)), tiny);
}

TEST(Tensor, DeviatorHasNoTraceAndLeavesTheRest) {
  Random random;
  const M a = random.matrix();
  EXPECT_NEAR(trace(deviator(a)), 0, tiny);
  EXPECT_LE(largest(minus(deviator(a) + trace(a) / 3 * identity<double>(), a)), tiny);
  const S s = symmetric_part(a);
  EXPECT_LE(largest(minus(deviator(s), deviator(M(s)))), tiny);
}

TEST(Tensor, SymmetricProductsEqualTheGeneralOnes) {
  Random random;
  const M a = random.matrix(), b = random.matrix();
  const S s = symmetric_part(b);
  EXPECT_LE(largest(minus(symmetric_product(a, s), a * s * transpose(a))), 10 * tiny);
  EXPECT_LE(largest(minus(left_cauchy_green(a), a * transpose(a))), tiny);
  EXPECT_LE(largest(minus(right_cauchy_green(a), transpose(a) * a)), tiny);
  EXPECT_LE(largest(minus(square(s), s * s)), tiny);
}

TEST(Tensor, VectorsFollowTheRightHandRule) {
  const V x(1, 0, 0), y(0, 1, 0);
  EXPECT_EQ(cross(x, y)[2], 1);
  Random random;
  const M a = random.matrix();
  const V u = a.column(0), v = a.column(1), w = a.column(2);
  EXPECT_NEAR(dot(cross(u, v), w), determinant(a), tiny);
  EXPECT_NEAR(dot(u, a * v), contract(outer(u, v), a), tiny);
  EXPECT_LE(largest(minus(outer(u), outer(u, u))), tiny);
  EXPECT_NEAR(norm(u) * norm(u), squared_norm(u), tiny);
  EXPECT_NEAR(norm(M(symmetric_part(a)) * u - symmetric_part(a) * u), 0, tiny);
}

/// As a law writes its stress: plain coefficients, the identity beside a symmetric and a general tensor.
template <class T>
Symmetric3<T> stress(const Matrix3<T>& F) {
  const double shear_modulus = 2;
  const Symmetric3<T> b = left_cauchy_green(F);
  const T J = determinant(F), pressure = select(J >= 1, T(0.5), T(1)) * T(0.5) * shear_modulus * (J * J - 1);
  const Matrix3<T> deviation = 2 * shear_modulus * (F - identity<T>()) * transpose(F) + J * (J - 1) * identity<T>();
  return shear_modulus * deviator(b) + pressure * identity<T>() - b / 3.0 + 2 * identity<T>() + symmetric_part(deviation);
}

template <class T>
class TensorOver : public ::testing::Test {};
using Numbers = ::testing::Types<float, Lanes<float>, Lanes<double>>;
TYPED_TEST_SUITE(TensorOver, Numbers);

TYPED_TEST(TensorOver, AStressFormulaGivesWhatDoublesGive) {
  using T = TypeParam;
  const M F(1.1, 0.2, 0.1, -0.1, 0.9, 0.3, 0.05, 0, 1.2);
  Matrix3<T> f;
  for (int k = 0; k < 9; ++k) f[k] = T(F[k]);
  const S expected = stress(F), computed = testing::lane(stress(f), 1);
  EXPECT_LE(largest(minus(expected, computed)), 64 * testing::epsilon<scalar_of<T>>);
}

}  // namespace
}  // namespace cleave
