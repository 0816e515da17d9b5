/// Decompositions of 3x3 tensors over plain numbers and Lanes: symmetric_eigen, svd, polar, qr, and the logarithm log(A) of a
/// symmetric tensor. polar, qr and log also take Duals; eigenvectors do not, because where eigenvalues meet they have no
/// derivative, while functions of the whole tensor keep theirs.
///
/// Every rotation returned has determinant +1. Errors are a few units in the last place of the norm of the argument, for every
/// finite argument whose squared norm neither overflows nor underflows, singular and inverted ones included. A lane's result
/// depends on that lane alone, bit for bit; where lanes need rarely taken extra work, the others wait for it.
#ifndef CLEAVE_DECOMPOSITIONS_HPP
#define CLEAVE_DECOMPOSITIONS_HPP

#include <cleave/dual.hpp>
#include <cleave/tensor.hpp>

#define CLEAVE_OUT_OF_LINE __attribute__((noinline))

namespace cleave {

/// A = V diag(values) V^T
template <class T>
struct SymmetricEigen {
  Vector3<T> values;   ///< descending
  Matrix3<T> vectors;  ///< V, a rotation; column i belongs to values[i]
};

/// F = U diag(values) V^T
template <class T>
struct SingularValues {
  Matrix3<T> U;       ///< a rotation
  Vector3<T> values;  ///< descending in magnitude; the first two are not negative, the last has the sign of det F
  Matrix3<T> V;       ///< a rotation
};

/// F = R S
template <class T>
struct Polar {
  Matrix3<T> rotation;    ///< R = U V^T, the rotation nearest to F, also for inverted F
  Symmetric3<T> stretch;  ///< S = V diag(values) V^T; of its eigenvalues only the smallest is ever negative
};

/// F = Q R
template <class T>
struct OrthogonalTriangular {
  Matrix3<T> Q;  ///< a rotation
  Matrix3<T> R;  ///< upper triangular, r11 >= 0 and r22 >= 0, r33 with the sign of det F
};

namespace detail {

template <class T>
inline constexpr bool is_single = std::is_same_v<scalar_of<T>, float>;
template <class T>
inline constexpr scalar_of<T> epsilon = std::numeric_limits<scalar_of<T>>::epsilon();

/// The largest power of two not above x; 1 if x is 0 or subnormal.
template <std::floating_point S>
CLEAVE_INLINE S binade(S x) {
  typename Format<S>::Bits bits;
  __builtin_memcpy(&bits, &x, sizeof(S));
  bits &= ~Format<S>::fraction_mask;
  __builtin_memcpy(&x, &bits, sizeof(S));
  return x == S(0) ? S(1) : x;
}
template <class S>
CLEAVE_INLINE Lanes<S> binade(Lanes<S> x) {
  const Lanes<S> power = from_bits<S>(to_bits(x) & ~Format<S>::fraction_mask);
  return select(power == S(0), S(1), power);
}

template <class T>
CLEAVE_INLINE void swap_if(const mask_of<T>& m, T& a, T& b) {
  const T c = select(m, b, a);
  b = select(m, a, b);
  a = c;
}

/// A unit vector normal to the unit vector n; y for n = x. [Duff et al. 2017, Building an Orthonormal Basis, Revisited]
template <class T>
CLEAVE_INLINE Vector3<T> unit_normal(const Vector3<T>& n) {
  const T sign = copysign(T(1), n[2]);
  const T a = T(-1) / (sign + n[2]);
  return {n[0] * n[1] * a, sign + n[1] * n[1] * a, -n[1]};
}

/// The rotation by at most 45 degrees that makes a symmetric 2x2 matrix diagonal, given the difference of its second and first
/// diagonal element and twice its off-diagonal element.
template <class T>
struct PlaneRotation {
  T tangent, cosine, sine;
};
template <class T>
CLEAVE_INLINE PlaneRotation<T> diagonalizing_rotation(const T& difference, const T& twice_coupling, const mask_of<T>& done) {
  const T denominator = abs(difference) + sqrt(difference * difference + twice_coupling * twice_coupling);
  const T quotient = copysign(T(1), difference) * twice_coupling / denominator;
  const T tangent = select(done || denominator == T(0), T(0), quotient);
  const T cosine = select(done, T(1), rsqrt(tangent * tangent + T(1)));
  return {tangent, cosine, cosine * tangent};
}
/// (a, b) <- (c a - s b, s a + c b)
template <class T>
CLEAVE_INLINE void rotate(const PlaneRotation<T>& g, T& a, T& b) {
  const T old = a;
  a = g.cosine * old - g.sine * b;
  b = g.sine * old + g.cosine * b;
}

/// Columns p and q.
template <class T>
CLEAVE_INLINE void rotate_columns(const PlaneRotation<T>& g, Matrix3<T>& a, int p, int q) {
  for (int i = 0; i < 3; ++i) rotate(g, a(i, p), a(i, q));
}

/// One Jacobi rotation of the plane (p, q); r is the remaining axis.
template <class T>
CLEAVE_INLINE void jacobi_rotation(Symmetric3<T>& a, Matrix3<T>& v, const T& negligible, int p, int q, int r) {
  const T coupling = a(p, q);
  const mask_of<T> done = abs(coupling) <= negligible;
  const PlaneRotation<T> g = diagonalizing_rotation(T(a(q, q) - a(p, p)), T(coupling + coupling), done);
  a(p, p) = a(p, p) - g.tangent * coupling;
  a(q, q) = a(q, q) + g.tangent * coupling;
  a(p, q) = select(done, coupling, T(0));
  rotate(g, a(r, p), a(r, q));
  rotate_columns(g, v, p, q);
}

/// One rotation of the columns p and q of b that makes them orthogonal, accumulated in v. Returns where there was none to do.
template <class T>
CLEAVE_INLINE mask_of<T> one_sided_rotation(Matrix3<T>& b, Matrix3<T>& v, int p, int q) {
  const Vector3<T> x = b.column(p), y = b.column(q);
  const T xx = dot(x, x), yy = dot(y, y), xy = dot(x, y);
  const T tolerance = T(epsilon<T>) * epsilon<T>;
  // A column below the precision of the (scaled) matrix is zero; its products with others would underflow.
  const mask_of<T> done = xy * xy <= tolerance * xx * yy || min(xx, yy) <= tolerance * T(1e-4);
  const PlaneRotation<T> g = diagonalizing_rotation(T(yy - xx), T(xy + xy), done);
  rotate_columns(g, b, p, q);
  rotate_columns(g, v, p, q);
  return done;
}

template <class T>
CLEAVE_INLINE void swap_columns_if(const mask_of<T>& m, Matrix3<T>& a, int p, int q) {
  for (int i = 0; i < 3; ++i) {
    const T old = a(i, p);
    a(i, p) = select(m, a(i, q), old);
    a(i, q) = select(m, -old, a(i, q));  // the sign keeps the determinant
  }
}

}  // namespace detail

/// Cyclic Jacobi rotations, which converge for every symmetric matrix, faster than quadratically at the end.
template <class T>
CLEAVE_OUT_OF_LINE SymmetricEigen<T> symmetric_eigen(const Symmetric3<T>& A) {
  T largest = abs(A[0]);
  for (int k = 1; k < 6; ++k) largest = max(largest, abs(A[k]));
  const T scale = detail::binade(largest);
  Symmetric3<T> a = A / scale;
  Matrix3<T> v = identity<T>();
  const T negligible(detail::epsilon<T> * scalar_of<T>(0.25));
  constexpr int most_sweeps = detail::is_single<T> ? 5 : 6;
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    detail::jacobi_rotation(a, v, negligible, 0, 1, 2);
    detail::jacobi_rotation(a, v, negligible, 0, 2, 1);
    detail::jacobi_rotation(a, v, negligible, 1, 2, 0);
    if (!any(max(max(abs(a(0, 1)), abs(a(0, 2))), abs(a(1, 2))) > negligible)) break;
  }
  const auto order = [&](int p, int q) {
    const mask_of<T> wrong = a(p, p) < a(q, q);
    detail::swap_columns_if(wrong, v, p, q);
    detail::swap_if(wrong, a(p, p), a(q, q));
  };
  order(0, 1);
  order(0, 2);
  order(1, 2);
  return {{scale * a(0, 0), scale * a(1, 1), scale * a(2, 2)}, v};
}

/// log A = V diag(log values) V^T of a positive definite A; NaN where an eigenvalue is negative.
template <class T>
CLEAVE_INLINE Symmetric3<T> log(const Symmetric3<T>& A) {
  const auto [values, vectors] = symmetric_eigen(A);
  return symmetric_product(vectors, diagonal(Vector3<T>(log(values[0]), log(values[1]), log(values[2]))));
}

namespace detail {

/// (log a - log b) / (a - b) for a >= b > 0, and its limit 1/b for a = b: log(1 + x)/x / b with x = (a - b)/b.
template <class T>
CLEAVE_INLINE T logarithm_difference_quotient(const T& a, const T& b) {
  const T x = (a - b) / b;
  return select(x == T(0), T(1), log1p(x) / x) / b;
}

}  // namespace detail

/// In the axes of A the derivative is d(log A)_ij = (log a_i - log a_j)/(a_i - a_j) dA_ij, smooth where eigenvalues meet.
/// [Daleckii and Krein 1965]
template <class T, int N>
CLEAVE_INLINE Symmetric3<Dual<T, N>> log(const Symmetric3<Dual<T, N>>& A) {
  Symmetric3<T> value;
  for (int k = 0; k < 6; ++k) value[k] = A[k].value;
  const auto [values, V] = symmetric_eigen(value);
  const Symmetric3<T> logarithm = symmetric_product(V, diagonal(Vector3<T>(log(values[0]), log(values[1]), log(values[2]))));
  Symmetric3<T> slope;
  for (int i = 0; i < 3; ++i)
    for (int j = i; j < 3; ++j) slope(i, j) = detail::logarithm_difference_quotient(values[i], values[j]);
  Symmetric3<Dual<T, N>> result;
  for (int k = 0; k < 6; ++k) result[k].value = logarithm[k];
  for (int n = 0; n < N; ++n) {
    Symmetric3<T> dA;
    for (int k = 0; k < 6; ++k) dA[k] = A[k].derivative[n];
    Symmetric3<T> turned = symmetric_product(transpose(V), dA);
    for (int k = 0; k < 6; ++k) turned[k] = turned[k] * slope[k];
    const Symmetric3<T> derivative = symmetric_product(V, turned);
    for (int k = 0; k < 6; ++k) result[k].derivative[n] = derivative[k];
  }
  return result;
}

/// One-sided Jacobi: rotations V make the columns of B = F V orthogonal, so that B = U diag(values). Small singular values
/// come out as precise as the norm allows, which the eigenvalues of F^T F would not.
template <class T>
CLEAVE_OUT_OF_LINE SingularValues<T> svd(const Matrix3<T>& F) {
  T largest = abs(F[0]);
  for (int k = 1; k < 9; ++k) largest = max(largest, abs(F[k]));
  const T scale = detail::binade(largest);
  Matrix3<T> b = F / scale;
  Matrix3<T> v = identity<T>();
  constexpr int most_sweeps = detail::is_single<T> ? 6 : 7;
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    const mask_of<T> done01 = detail::one_sided_rotation(b, v, 0, 1);
    const mask_of<T> done02 = detail::one_sided_rotation(b, v, 0, 2);
    const mask_of<T> done12 = detail::one_sided_rotation(b, v, 1, 2);
    if (all(done01 && done02 && done12)) break;
  }
  T square[3] = {squared_norm(b.column(0)), squared_norm(b.column(1)), squared_norm(b.column(2))};
  const auto order = [&](int p, int q) {
    const mask_of<T> wrong = square[p] < square[q];
    detail::swap_columns_if(wrong, b, p, q);
    detail::swap_columns_if(wrong, v, p, q);
    detail::swap_if(wrong, square[p], square[q]);
  };
  order(0, 1);
  order(0, 2);
  order(1, 2);

  const T nothing(std::numeric_limits<scalar_of<T>>::min());
  const Vector3<T> x = b.column(0), y = b.column(1), z = b.column(2);
  const T first = sqrt(square[0]);
  const Vector3<T> u0 = select(square[0] <= nothing, Vector3<T>(T(1), T(0), T(0)), x / first);
  // Orthogonal twice over: the first time leaves rounding errors of x, which may outweigh y.
  Vector3<T> w = y - dot(u0, y) * u0;
  const T roundoff = T(4) * detail::epsilon<T> * first;
  const mask_of<T> is_rank_one = squared_norm(w) <= roundoff * roundoff;
  w = select(is_rank_one, detail::unit_normal(u0), w * rsqrt(squared_norm(w)));
  w = w - dot(u0, w) * u0;
  const Vector3<T> u1 = w * rsqrt(squared_norm(w));
  const Vector3<T> u2 = cross(u0, u1);
  return {Matrix3<T>::from_columns(u0, u1, u2), {scale * first, scale * max(dot(u1, y), T(0)), scale * dot(u2, z)}, v};
}

namespace detail {

template <class T>
CLEAVE_OUT_OF_LINE Polar<T> polar_from_svd(const Matrix3<T>& F) {
  const SingularValues<T> s = svd(F);
  return {s.U * transpose(s.V), symmetric_product(s.V, diagonal(s.values))};
}

}  // namespace detail

/// With the invariants of S, x = tr S, y = (x^2 - |F|^2) / 2, J = det F, the theorem of Cayley and Hamilton gives
///   (x y - J) R = x cof F + (x^2 - y) F - F F^T F,
/// and x is the largest root of (x^2 - |F|^2)^2 - 8 J x - 4 |cof F|^2 = 0. An error in x only stretches R, along the principal
/// axes; a step R (3 I - R^T R) / 2 removes it. Arguments for which x y - J = (s1 + s2)(s2 + s3)(s3 + s1) is small, where the
/// rotation is hardly determined, take the singular value decomposition.
template <class T>
CLEAVE_INLINE Polar<T> polar(const Matrix3<T>& F) {
  using S = scalar_of<T>;
  const Symmetric3<T> C = right_cauchy_green(F);
  const Matrix3<T> H = cofactor(F);
  const T size = rsqrt(trace(C)), size2 = size * size;
  const T J = (F[0] * H[0] + F[1] * H[1] + F[2] * H[2]) * (size2 * size);
  const T h = squared_norm(H) * (size2 * size2);

  // All of this is for |F| = 1. The root is at most sqrt(3); for J >= 0 the map x -> sqrt(1 + 2 sqrt(|cof F|^2 + 2 J x)) has
  // a slope below 1/9 and stays above the root, as Newton's method does.
  const T bound(1.7320508075688772935);
  const T contracted = sqrt(T(1) + T(2) * sqrt(max(h + (S(2) * bound) * J, T(0))));
  T x = select(J >= T(0), contracted, bound);
  T step(0);
  constexpr int newton_steps = detail::is_single<T> ? 2 : 4;
  for (int i = 0; i < newton_steps; ++i) {
    const T a = x * x - T(1);
    step = (a * a - T(8) * (J * x) - T(4) * h) / (T(4) * (a * x) - T(8) * J);
    x = x - step;
  }
  const T x2 = x * x;
  const T determination = T(0.5) * x * (x2 - T(1)) - J;

  const T d = T(1) / determination;
  const Symmetric3<T> W = (T(0.5) * (x2 + T(1))) * identity<T>() - size2 * C;
  Matrix3<T> R = (size * d) * (F * Matrix3<T>(W)) + (x * size2 * d) * H;
  const Symmetric3<T> E = right_cauchy_green(R);
  R = R * Matrix3<T>(T(1.5) * identity<T>() - T(0.5) * E);

  Polar<T> result{R, symmetric_part(transpose(R) * F)};
  const T least_determination(detail::is_single<T> ? S(0.03) : S(0.02));
  const T largest_step(detail::is_single<T> ? S(3e-3) : S(1e-5));
  const mask_of<T> determined = determination > least_determination && abs(step) < largest_step;
  if (!all(determined)) {
    const Polar<T> robust = detail::polar_from_svd(F);
    result.rotation = select(determined, result.rotation, robust.rotation);
    result.stretch = select(determined, result.stretch, robust.stretch);
  }
  return result;
}

/// W = R^T dR of the rotation of F = R S along dF: skew, with W S + S W = R^T dF - dF^T R. By its axial vector w,
/// (tr S I - S) w is that of the right-hand side. Where s2 + s3 = 0 the rotation jumps, and W is infinite: the product of the
/// sums of two principal stretches is then taken as large as rounding makes it, so that W stays finite.
template <class T>
CLEAVE_INLINE Matrix3<T> rotation_rate(const Polar<T>& p, const Matrix3<T>& dF) {
  const Matrix3<T> A = transpose(p.rotation) * dF;
  const T size = trace(p.stretch);
  const Symmetric3<T> sums = size * identity<T>() - p.stretch, c = cofactor(sums);
  const T product = sums[0] * c[0] + sums[3] * c[3] + sums[4] * c[4];
  const T least = T(detail::epsilon<T>) * (size * size * size) + T(std::numeric_limits<scalar_of<T>>::min());
  const Vector3<T> w = (T(1) / max(product, least)) * (c * Vector3<T>(A(2, 1) - A(1, 2), A(0, 2) - A(2, 0), A(1, 0) - A(0, 1)));
  return {T(0), -w[2], w[1], w[2], T(0), -w[0], -w[1], w[0], T(0)};
}

/// The derivatives from dF = dR S + R dS with dR = R W.
template <class T, int N>
CLEAVE_INLINE Polar<Dual<T, N>> polar(const Matrix3<Dual<T, N>>& F) {
  Matrix3<T> value;
  for (int k = 0; k < 9; ++k) value[k] = F[k].value;
  const Polar<T> p = polar(value);
  const Matrix3<T>& R = p.rotation;
  Polar<Dual<T, N>> result;
  for (int k = 0; k < 9; ++k) result.rotation[k].value = R[k];
  for (int k = 0; k < 6; ++k) result.stretch[k].value = p.stretch[k];
  for (int i = 0; i < N; ++i) {
    Matrix3<T> dF;
    for (int k = 0; k < 9; ++k) dF[k] = F[k].derivative[i];
    const Matrix3<T> W = rotation_rate(p, dF), dR = R * W;
    const Symmetric3<T> dS = symmetric_part(transpose(R) * dF - W * Matrix3<T>(p.stretch));
    for (int k = 0; k < 9; ++k) result.rotation[k].derivative[i] = dR[k];
    for (int k = 0; k < 6; ++k) result.stretch[k].derivative[i] = dS[k];
  }
  return result;
}

/// Gram and Schmidt's orthogonalization, done twice where once leaves rounding errors. A first column of 0 gives the axis x for
/// the first column of Q, a second one along the first any normal of it.
template <class T>
CLEAVE_INLINE OrthogonalTriangular<T> qr(const Matrix3<T>& F) {
  const Vector3<T> x = F.column(0), y = F.column(1), z = F.column(2);
  const T nothing(std::numeric_limits<scalar_of<T>>::min());
  const T xx = squared_norm(x);
  const mask_of<T> no_first = xx <= nothing;
  const T inverse_r11 = rsqrt(select(no_first, T(1), xx));
  const Vector3<T> q0 = select(no_first, Vector3<T>(T(1), T(0), T(0)), inverse_r11 * x);
  const T r11 = select(no_first, T(0), xx * inverse_r11);

  const T r12 = dot(q0, y);
  Vector3<T> w = y - r12 * q0;
  const T again = dot(q0, w);
  w = w - again * q0;
  const T ww = squared_norm(w);
  // What is left after the first step is rounding errors of it, unless it is larger than they can be.
  const T roundoff = T(4) * detail::epsilon<T> * r12;
  const mask_of<T> no_second = ww <= max(nothing, roundoff * roundoff);
  const T inverse_r22 = rsqrt(select(no_second, T(1), ww));
  const T r22 = select(no_second, T(0), ww * inverse_r22);
  Vector3<T> q1 = inverse_r22 * w;
  if (any(no_second)) q1 = select(no_second, detail::unit_normal(q0), q1);
  const Vector3<T> q2 = cross(q0, q1);
  return {Matrix3<T>::from_columns(q0, q1, q2), {r11, r12 + again, dot(q0, z), T(0), r22, dot(q1, z), T(0), T(0), dot(q2, z)}};
}

}  // namespace cleave

#endif
