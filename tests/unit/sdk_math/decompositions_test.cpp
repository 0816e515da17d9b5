#include <cleave/decompositions.hpp>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "numbers.hpp"

namespace cleave {
namespace {

using testing::epsilon;
using testing::lane;
using testing::largest;
using testing::Random;
using testing::rotation_error;
using M = Matrix3<double>;

struct Family {
  std::string name;
  std::function<M(Random&)> draw;
};

/// Every kind of deformation that occurs, and the ones at which a decomposition may fail.
const std::vector<Family>& families() {
  static const std::vector<Family> all{
      {"identity", [](Random&) { return M(identity<double>()); }},
      {"zero", [](Random&) { return M(0, 0, 0, 0, 0, 0, 0, 0, 0); }},
      {"rotation", [](Random& r) { return r.rotation(); }},
      {"reflection", [](Random& r) { return r.with_singular_values(1, 1, -1); }},
      {"moderate strain",
       [](Random& r) { return r.with_singular_values(r.uniform(1, 1.3), r.uniform(0.7, 1), r.uniform(0.8, 1.2)); }},
      {"any matrix", [](Random& r) { return r.matrix(); }},
      {"a matrix of -1, 0, 1",
       [](Random& r) {
         M a;
         for (int k = 0; k < 9; ++k) a[k] = std::floor(r.uniform(-1, 2));
         return a;
       }},
      {"singular values apart by orders of magnitude",
       [](Random& r) {
         const auto power = [&] { return std::pow(10, r.uniform(-4, 0)); };
         return r.with_singular_values(power(), power(), r.uniform(-1, 1) < 0 ? -power() : power());
       }},
      {"two equal singular values",
       [](Random& r) {
         const double s = r.uniform(0, 2);
         return r.with_singular_values(1, s, s);
       }},
      {"inverted near a reflection", [](Random& r) { return r.with_singular_values(1, 0.5, -0.5 + 1e-3 * r.normal()); }},
      {"flattened", [](Random& r) { return r.with_singular_values(1, r.uniform(0, 1), 0); }},
      {"collapsed to a line", [](Random& r) { return r.with_singular_values(1, 0, 0); }},
      {"collapsed to an axis", [](Random& r) { return M(0, 0, 0, 0, r.uniform(-1, 1), 0, 0, 0, 0); }},
      {"large", [](Random& r) { return 1e6 * r.matrix(); }},
      {"small", [](Random& r) { return 1e-6 * r.matrix(); }},
      {"small and nearly flat", [](Random& r) { return 1e-6 * r.with_singular_values(1, 1e-2, 1e-5); }},
  };
  return all;
}

/// Calls check(F, name) with lanes of every family and with plain numbers.
template <class S, class Check>
void for_every_deformation(Check check) {
  using L = Lanes<S>;
  Random random;
  for (const Family& family : families())
    for (int sample = 0; sample < 400 / L::width; ++sample) {
      Matrix3<L> F;
      Matrix3<S> plain;
      for (int i = 0; i < L::width; ++i) {
        const M a = family.draw(random);
        for (int k = 0; k < 9; ++k) {
          plain[k] = static_cast<S>(a[k]);
          F[k].set(i, plain[k]);
        }
      }
      check(F, L::width, family.name);
      check(plain, 1, family.name + ", plain numbers");
    }
}

double size_of(const M& a) { return std::max(norm(a), std::numeric_limits<double>::min()); }
M diagonal_matrix(const Vector3<double>& d) { return M(diagonal(d)); }

/// Some units in the last place of the norm.
template <class S>
constexpr double few = 16 * epsilon<S>;

template <class S>
struct DecompositionTest : testing::OnScalar<S> {};
TYPED_TEST_SUITE(DecompositionTest, testing::Scalars);

TYPED_TEST(DecompositionTest, EigenvectorsAreARotationThatRestoresTheTensor) {
  for_every_deformation<TypeParam>([](const auto& F, int count, const std::string& name) {
    const auto A = symmetric_part(F);
    const auto e = symmetric_eigen(A);
    for (int i = 0; i < count; ++i) {
      const M a = lane(A, i), v = lane(e.vectors, i);
      const Vector3<double> values = lane(e.values, i);
      EXPECT_LE(rotation_error(v), few<TypeParam>) << name;
      EXPECT_LE(largest(v * diagonal_matrix(values) * transpose(v) - a), few<TypeParam> * size_of(a)) << name;
      EXPECT_TRUE(values[0] >= values[1] && values[1] >= values[2]) << name;
    }
  });
}

TYPED_TEST(DecompositionTest, SingularValuesAreSignedAndDescending) {
  for_every_deformation<TypeParam>([](const auto& F, int count, const std::string& name) {
    const auto s = svd(F);
    for (int i = 0; i < count; ++i) {
      const M f = lane(F, i), u = lane(s.U, i), v = lane(s.V, i);
      const Vector3<double> values = lane(s.values, i);
      const double tolerance = few<TypeParam> * size_of(f);
      EXPECT_LE(rotation_error(u), few<TypeParam>) << name;
      EXPECT_LE(rotation_error(v), few<TypeParam>) << name;
      EXPECT_LE(largest(u * diagonal_matrix(values) * transpose(v) - f), tolerance) << name;
      EXPECT_GE(values[0] + tolerance, values[1]) << name;
      EXPECT_GE(values[1] + tolerance, std::fabs(values[2])) << name;
      EXPECT_GE(values[1], 0) << name;
    }
  });
}

TYPED_TEST(DecompositionTest, PolarGivesARotationAndASymmetricStretch) {
  for_every_deformation<TypeParam>([](const auto& F, int count, const std::string& name) {
    const auto p = polar(F);
    for (int i = 0; i < count; ++i) {
      const M f = lane(F, i), r = lane(p.rotation, i), s = lane(p.stretch, i);
      EXPECT_LE(rotation_error(r), few<TypeParam>) << name;
      EXPECT_LE(largest(r * s - f), few<TypeParam> * size_of(f)) << name;
    }
  });
}

/// The rotation is as well determined as the sum of the two smaller singular values is large.
TYPED_TEST(DecompositionTest, PolarFindsTheRotationOfTheSingularValueDecompositionAlsoWhenInverted) {
  for_every_deformation<TypeParam>([](const auto& F, int count, const std::string& name) {
    const auto p = polar(F);
    for (int i = 0; i < count; ++i) {
      const auto s = svd(lane(F, i));
      const double gap = (s.values[1] + s.values[2]) / size_of(lane(F, i));
      if (gap < 1e-3) continue;
      EXPECT_LE(largest(lane(p.rotation, i) - s.U * transpose(s.V)), few<TypeParam> / gap) << name;
    }
  });
}

TYPED_TEST(DecompositionTest, PolarOfTheIdentityAndOfZeroHasTheIdentityAsRotation) {
  using L = Lanes<TypeParam>;
  const M one = lane(polar(Matrix3<L>(identity<L>())).rotation, 0);
  EXPECT_LE(largest(one - identity<double>()), 2 * epsilon<TypeParam>);
  const M zero = lane(polar(Matrix3<L>(L(0) * identity<L>())).rotation, 0);
  EXPECT_EQ(largest(zero - identity<double>()), 0);
}

TYPED_TEST(DecompositionTest, QrGivesARotationAndATriangleWithTheSignInItsCorner) {
  for_every_deformation<TypeParam>([](const auto& F, int count, const std::string& name) {
    const auto d = qr(F);
    for (int i = 0; i < count; ++i) {
      const M f = lane(F, i), q = lane(d.Q, i), r = lane(d.R, i);
      EXPECT_LE(rotation_error(q), few<TypeParam>) << name;
      EXPECT_LE(largest(q * r - f), few<TypeParam> * size_of(f)) << name;
      EXPECT_GE(r(0, 0), 0) << name;
      EXPECT_GE(r(1, 1), 0) << name;
      EXPECT_TRUE(r(1, 0) == 0 && r(2, 0) == 0 && r(2, 1) == 0) << name;
    }
  });
}

TYPED_TEST(DecompositionTest, QrStaysFiniteWhileTheFirstColumnVanishes) {
  using S = TypeParam;
  using L = Lanes<S>;
  for (S first : {S(1e-3), S(1e-10), S(1e-18), S(1e-25), std::numeric_limits<S>::denorm_min(), S(0)}) {
    const Matrix3<L> F(L(0), 1, 0, L(first), 0, 1, 0, 0, L(-2));
    const M q = lane(qr(F).Q, 0), r = lane(qr(F).R, 0);
    EXPECT_LE(rotation_error(q), few<S>) << first;
    EXPECT_LE(largest(q * r - lane(F, 0)), few<S>) << first;
  }
}

TYPED_TEST(DecompositionTest, SmallSingularValuesAreAsPreciseAsTheNormAllows) {
  using S = TypeParam;
  Random random;
  for (int sample = 0; sample < 100; ++sample) {
    const M f = random.with_singular_values(1, 1e-3, -1e-5);
    Matrix3<Lanes<S>> F;
    for (int k = 0; k < 9; ++k) F[k] = Lanes<S>(static_cast<S>(f[k]));
    const Vector3<double> values = lane(svd(F).values, 0);
    EXPECT_NEAR(values[0], 1, few<S>);
    EXPECT_NEAR(values[1], 1e-3, few<S>);
    EXPECT_NEAR(values[2], -1e-5, few<S>);
  }
}

template <class S>
bool same_bits(const Matrix3<Lanes<S>>& a, const Matrix3<Lanes<S>>& b, int i) {
  for (int k = 0; k < 9; ++k) {
    const S x = a[k][i], y = b[k][i];
    if (std::memcmp(&x, &y, sizeof(S)) != 0) return false;
  }
  return true;
}

template <class S>
using Everything = std::vector<Matrix3<Lanes<S>>>;
template <class S>
Everything<S> decompose(const Matrix3<Lanes<S>>& F) {
  const auto p = polar(F);
  const auto s = svd(F);
  const auto d = qr(F);
  return {p.rotation, p.stretch, s.U, s.V, diagonal(s.values), d.Q, d.R, symmetric_eigen(left_cauchy_green(F)).vectors};
}

TYPED_TEST(DecompositionTest, ALaneDoesNotInfluenceItsNeighbours) {
  using S = TypeParam;
  using L = Lanes<S>;
  Random random;
  const M degenerate = random.with_singular_values(1, 1, -1), hard = random.with_singular_values(1, 1e-2, -1e-2);
  const M invalid(testing::nan<double>, 1, 2, 3, 4, 5, 6, 7, 8), infinite(1, 2, 3, 4, testing::infinity<double>, 6, 7, 8, 9);
  for (int sample = 0; sample < 20; ++sample) {
    Matrix3<L> F;
    for (int i = 0; i < L::width; ++i) {
      const M f = random.with_singular_values(1, random.uniform(0.6, 1), random.uniform(0.6, 1));
      for (int k = 0; k < 9; ++k) F[k].set(i, static_cast<S>(f[k]));
    }
    const Everything<S> alone = decompose(F);
    for (const M& intruder : {degenerate, hard, invalid, infinite}) {
      Matrix3<L> G = F;
      for (int k = 0; k < 9; ++k) G[k].set(1, static_cast<S>(intruder[k]));
      const Everything<S> beside = decompose(G);
      for (int i = 0; i < L::width; ++i)
        for (std::size_t m = 0; m < alone.size() && i != 1; ++m)
          EXPECT_TRUE(same_bits(alone[m], beside[m], i)) << "matrix " << m << ", lane " << i;
    }
  }
}

TYPED_TEST(DecompositionTest, NaNIsNotTakenForZero) {
  using L = Lanes<TypeParam>;
  for (int k = 0; k < 9; ++k) {
    Matrix3<L> F = identity<L>();
    F[k].set(0, testing::nan<TypeParam>);
    const auto finite = [](const Matrix3<L>& a) { return std::isfinite(norm(lane(a, 0))); };
    const Everything<TypeParam> all = decompose(F);
    EXPECT_FALSE(finite(all[0]) && finite(all[1])) << "polar, component " << k;
    EXPECT_FALSE(finite(all[2]) && finite(all[3]) && finite(all[4])) << "svd, component " << k;
    EXPECT_FALSE(finite(all[5]) && finite(all[6])) << "qr, component " << k;
    EXPECT_FALSE(std::isfinite(norm(lane(symmetric_eigen(symmetric_part(F)).values, 0)))) << "eigenvalues, component " << k;
  }
}

TEST(Decomposition, DualsDifferentiatePolarAndQr) {
  const auto plain = [](const M& f) {
    const auto p = polar(f);
    const auto d = qr(f);
    return std::vector<M>{p.rotation, p.stretch, d.Q, d.R};
  };
  Random random;
  for (int sample = 0; sample < 20; ++sample) {
    const M f = random.with_singular_values(1.2, 0.9, sample % 2 ? 0.7 : -0.4), direction = random.matrix();
    Matrix3<Dual<double, 1>> F;
    for (int k = 0; k < 9; ++k) {
      F[k].value = f[k];
      F[k].derivative[0] = direction[k];
    }
    const auto p = polar(F);
    const auto d = qr(F);
    const double h = 1e-6;
    const auto up = plain(f + h * direction), down = plain(f - h * direction);
    for (int k = 0; k < 9; ++k) {
      EXPECT_NEAR(p.rotation[k].derivative[0], (up[0][k] - down[0][k]) / (2 * h), 1e-6);
      EXPECT_NEAR(d.Q[k].derivative[0], (up[2][k] - down[2][k]) / (2 * h), 1e-6);
      EXPECT_NEAR(d.R[k].derivative[0], (up[3][k] - down[3][k]) / (2 * h), 1e-6);
    }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) EXPECT_NEAR(p.stretch(i, j).derivative[0], (up[1](i, j) - down[1](i, j)) / (2 * h), 1e-6);
  }
}

// Where the two smallest stretches cancel, the nearest rotation is not one alone.
TYPED_TEST(DecompositionTest, RotationHasAFiniteDerivativeWhereItJumps) {
  using L = Lanes<TypeParam>;
  const double stretches[][3] = {{1, 1, -1}, {1, 0.5, -0.5}, {1, 0, 0}, {0, 0, 0}, {-1, -1, -1}, {1e3, 1e-3, -1e-3}};
  Random random;
  for (const auto& s : stretches)
    for (int sample = 0; sample < 8; ++sample) {
      const M left = random.rotation(), right = random.rotation(), direction = random.matrix();
      const M f = sample ? left * M(diagonal(Vector3<double>(s[0], s[1], s[2]))) * right
                         : M(diagonal(Vector3<double>(s[0], s[1], s[2])));
      Matrix3<Dual<L, 1>> F;
      for (int k = 0; k < 9; ++k) {
        F[k].value = L(TypeParam(f[k]));
        F[k].derivative[0] = L(TypeParam(direction[k]));
      }
      const auto p = polar(F);
      for (int k = 0; k < 9; ++k)
        EXPECT_TRUE(std::isfinite(p.rotation[k].derivative[0][0])) << "stretches " << s[0] << " " << s[2];
    }
}

}  // namespace
}  // namespace cleave
