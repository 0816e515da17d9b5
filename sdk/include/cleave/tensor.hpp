/// Vectors and second-order tensors of three dimensions over any Number: plain, Lanes or Dual.
///
/// A plain number may stand wherever a T does: `2 * a`, `0.5 * moduli.bulk * identity<T>()`.
/// Shapes: Vector3 (x y z), Matrix3 row-major a(i,j), Symmetric3 (xx yy zz xy xz yz), the orders of <cleave/abi.h>.
#ifndef CLEAVE_TENSOR_HPP
#define CLEAVE_TENSOR_HPP

#include <cleave/lanes.hpp>

namespace cleave {

/// x y z.
template <class T>
struct Vector3 {
  T component[3];

  Vector3() = default;
  CLEAVE_INLINE constexpr Vector3(const T& x, const T& y, const T& z) : component{x, y, z} {}

  CLEAVE_INLINE constexpr T& operator[](int i) { return component[i]; }
  CLEAVE_INLINE constexpr const T& operator[](int i) const { return component[i]; }
  CLEAVE_INLINE constexpr T& operator()(int i) { return component[i]; }
  CLEAVE_INLINE constexpr const T& operator()(int i) const { return component[i]; }

  friend CLEAVE_INLINE Vector3 operator+(const Vector3& a, const Vector3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
  friend CLEAVE_INLINE Vector3 operator-(const Vector3& a, const Vector3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
  friend CLEAVE_INLINE Vector3 operator-(const Vector3& a) { return {-a[0], -a[1], -a[2]}; }
  friend CLEAVE_INLINE Vector3 operator*(const T& s, const Vector3& a) { return {s * a[0], s * a[1], s * a[2]}; }
  friend CLEAVE_INLINE Vector3 operator*(const Vector3& a, const T& s) { return s * a; }
  friend CLEAVE_INLINE Vector3 operator/(const Vector3& a, const T& s) { return (T(1) / s) * a; }
  CLEAVE_INLINE Vector3& operator+=(const Vector3& b) { return *this = *this + b; }
  CLEAVE_INLINE Vector3& operator-=(const Vector3& b) { return *this = *this - b; }
  CLEAVE_INLINE Vector3& operator*=(const T& s) { return *this = s * *this; }

  /// a . b
  friend CLEAVE_INLINE T dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  /// a x b
  friend CLEAVE_INLINE Vector3 cross(const Vector3& a, const Vector3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  }
  friend CLEAVE_INLINE T squared_norm(const Vector3& a) { return dot(a, a); }
  friend CLEAVE_INLINE T norm(const Vector3& a) { return sqrt(dot(a, a)); }
  friend CLEAVE_INLINE Vector3 select(const mask_of<T>& m, const Vector3& a, const Vector3& b) {
    return {select(m, a[0], b[0]), select(m, a[1], b[1]), select(m, a[2], b[2])};
  }
};

/// factor * I. Adds to and multiplies with Symmetric3 and Matrix3, and converts to both.
template <class T>
struct ScaledIdentity {
  T factor;

  friend CLEAVE_INLINE ScaledIdentity operator*(const T& s, const ScaledIdentity& a) { return {s * a.factor}; }
  friend CLEAVE_INLINE ScaledIdentity operator*(const ScaledIdentity& a, const T& s) { return {s * a.factor}; }
  friend CLEAVE_INLINE ScaledIdentity operator/(const ScaledIdentity& a, const T& s) { return {a.factor / s}; }
  friend CLEAVE_INLINE ScaledIdentity operator+(const ScaledIdentity& a, const ScaledIdentity& b) {
    return {a.factor + b.factor};
  }
  friend CLEAVE_INLINE ScaledIdentity operator-(const ScaledIdentity& a, const ScaledIdentity& b) {
    return {a.factor - b.factor};
  }
  friend CLEAVE_INLINE ScaledIdentity operator-(const ScaledIdentity& a) { return {-a.factor}; }
};

/// I, in Symmetric3 and Matrix3 expressions: `deviator(b) + p * identity<T>()`.
template <class T>
CLEAVE_INLINE ScaledIdentity<T> identity() {
  return {T(1)};
}

/// Symmetric tensor, stored xx yy zz xy xz yz.
template <class T>
struct Symmetric3 {
  T component[6];

  Symmetric3() = default;
  CLEAVE_INLINE constexpr Symmetric3(const T& xx, const T& yy, const T& zz, const T& xy, const T& xz, const T& yz)
      : component{xx, yy, zz, xy, xz, yz} {}
  CLEAVE_INLINE constexpr Symmetric3(const ScaledIdentity<T>& a) : component{a.factor, a.factor, a.factor, T(0), T(0), T(0)} {}

  /// Component k in storage order.
  CLEAVE_INLINE constexpr T& operator[](int k) { return component[k]; }
  CLEAVE_INLINE constexpr const T& operator[](int k) const { return component[k]; }
  CLEAVE_INLINE constexpr T& operator()(int i, int j) { return component[i == j ? i : i + j + 2]; }
  CLEAVE_INLINE constexpr const T& operator()(int i, int j) const { return component[i == j ? i : i + j + 2]; }
  CLEAVE_INLINE constexpr const T& xx() const { return component[0]; }
  CLEAVE_INLINE constexpr const T& yy() const { return component[1]; }
  CLEAVE_INLINE constexpr const T& zz() const { return component[2]; }
  CLEAVE_INLINE constexpr const T& xy() const { return component[3]; }
  CLEAVE_INLINE constexpr const T& xz() const { return component[4]; }
  CLEAVE_INLINE constexpr const T& yz() const { return component[5]; }

  friend CLEAVE_INLINE Symmetric3 operator+(const Symmetric3& a, const Symmetric3& b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]};
  }
  friend CLEAVE_INLINE Symmetric3 operator-(const Symmetric3& a, const Symmetric3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5]};
  }
  friend CLEAVE_INLINE Symmetric3 operator+(const Symmetric3& a, const ScaledIdentity<T>& b) {
    return {a[0] + b.factor, a[1] + b.factor, a[2] + b.factor, a[3], a[4], a[5]};
  }
  friend CLEAVE_INLINE Symmetric3 operator+(const ScaledIdentity<T>& b, const Symmetric3& a) { return a + b; }
  friend CLEAVE_INLINE Symmetric3 operator-(const Symmetric3& a, const ScaledIdentity<T>& b) { return a + (-b); }
  friend CLEAVE_INLINE Symmetric3 operator-(const ScaledIdentity<T>& b, const Symmetric3& a) { return -a + b; }
  friend CLEAVE_INLINE Symmetric3 operator-(const Symmetric3& a) { return {-a[0], -a[1], -a[2], -a[3], -a[4], -a[5]}; }
  friend CLEAVE_INLINE Symmetric3 operator*(const T& s, const Symmetric3& a) {
    return {s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5]};
  }
  friend CLEAVE_INLINE Symmetric3 operator*(const Symmetric3& a, const T& s) { return s * a; }
  friend CLEAVE_INLINE Symmetric3 operator/(const Symmetric3& a, const T& s) { return (T(1) / s) * a; }
  CLEAVE_INLINE Symmetric3& operator+=(const Symmetric3& b) { return *this = *this + b; }
  CLEAVE_INLINE Symmetric3& operator-=(const Symmetric3& b) { return *this = *this - b; }
  CLEAVE_INLINE Symmetric3& operator*=(const T& s) { return *this = s * *this; }

  friend CLEAVE_INLINE Vector3<T> operator*(const Symmetric3& a, const Vector3<T>& x) {
    return {a[0] * x[0] + a[3] * x[1] + a[4] * x[2], a[3] * x[0] + a[1] * x[1] + a[5] * x[2],
            a[4] * x[0] + a[5] * x[1] + a[2] * x[2]};
  }

  friend CLEAVE_INLINE Symmetric3 transpose(const Symmetric3& a) { return a; }
  friend CLEAVE_INLINE T trace(const Symmetric3& a) { return a[0] + a[1] + a[2]; }
  /// cof(a) = det(a) a^-T, defined for singular tensors too.
  friend CLEAVE_INLINE Symmetric3 cofactor(const Symmetric3& a) {
    return {a[1] * a[2] - a[5] * a[5], a[0] * a[2] - a[4] * a[4], a[0] * a[1] - a[3] * a[3],
            a[4] * a[5] - a[3] * a[2], a[3] * a[5] - a[4] * a[1], a[3] * a[4] - a[0] * a[5]};
  }
  friend CLEAVE_INLINE T determinant(const Symmetric3& a) {
    return a[0] * (a[1] * a[2] - a[5] * a[5]) + a[3] * (a[4] * a[5] - a[3] * a[2]) + a[4] * (a[3] * a[5] - a[4] * a[1]);
  }
  friend CLEAVE_INLINE Symmetric3 inverse(const Symmetric3& a) {
    const Symmetric3 c = cofactor(a);
    return c / (a[0] * c[0] + a[3] * c[3] + a[4] * c[4]);
  }
  /// a : b = sum a_ij b_ij
  friend CLEAVE_INLINE T contract(const Symmetric3& a, const Symmetric3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + T(2) * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
  }
  friend CLEAVE_INLINE T squared_norm(const Symmetric3& a) { return contract(a, a); }
  friend CLEAVE_INLINE T norm(const Symmetric3& a) { return sqrt(contract(a, a)); }
  /// a - tr(a)/3 I
  friend CLEAVE_INLINE Symmetric3 deviator(const Symmetric3& a) {
    const T mean = (a[0] + a[1] + a[2]) * T(1.0 / 3.0);
    return {a[0] - mean, a[1] - mean, a[2] - mean, a[3], a[4], a[5]};
  }
  /// a a
  friend CLEAVE_INLINE Symmetric3 square(const Symmetric3& a) {
    return {a[0] * a[0] + a[3] * a[3] + a[4] * a[4], a[3] * a[3] + a[1] * a[1] + a[5] * a[5],
            a[4] * a[4] + a[5] * a[5] + a[2] * a[2], a[3] * (a[0] + a[1]) + a[4] * a[5],
            a[4] * (a[0] + a[2]) + a[3] * a[5],      a[5] * (a[1] + a[2]) + a[3] * a[4]};
  }
  friend CLEAVE_INLINE Symmetric3 select(const mask_of<T>& m, const Symmetric3& a, const Symmetric3& b) {
    return {select(m, a[0], b[0]), select(m, a[1], b[1]), select(m, a[2], b[2]),
            select(m, a[3], b[3]), select(m, a[4], b[4]), select(m, a[5], b[5])};
  }
};

/// General tensor, row-major.
template <class T>
struct Matrix3 {
  T component[9];

  Matrix3() = default;
  CLEAVE_INLINE constexpr Matrix3(const T& a00, const T& a01, const T& a02, const T& a10, const T& a11, const T& a12,
                                  const T& a20, const T& a21, const T& a22)
      : component{a00, a01, a02, a10, a11, a12, a20, a21, a22} {}
  CLEAVE_INLINE constexpr Matrix3(const ScaledIdentity<T>& a)
      : component{a.factor, T(0), T(0), T(0), a.factor, T(0), T(0), T(0), a.factor} {}
  CLEAVE_INLINE constexpr Matrix3(const Symmetric3<T>& a) : component{a[0], a[3], a[4], a[3], a[1], a[5], a[4], a[5], a[2]} {}

  static CLEAVE_INLINE Matrix3 from_columns(const Vector3<T>& a, const Vector3<T>& b, const Vector3<T>& c) {
    return {a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]};
  }

  /// Component k in storage order.
  CLEAVE_INLINE constexpr T& operator[](int k) { return component[k]; }
  CLEAVE_INLINE constexpr const T& operator[](int k) const { return component[k]; }
  CLEAVE_INLINE constexpr T& operator()(int i, int j) { return component[3 * i + j]; }
  CLEAVE_INLINE constexpr const T& operator()(int i, int j) const { return component[3 * i + j]; }
  CLEAVE_INLINE Vector3<T> row(int i) const { return {component[3 * i], component[3 * i + 1], component[3 * i + 2]}; }
  CLEAVE_INLINE Vector3<T> column(int j) const { return {component[j], component[3 + j], component[6 + j]}; }

  friend CLEAVE_INLINE Matrix3 operator+(const Matrix3& a, const Matrix3& b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4],
            a[5] + b[5], a[6] + b[6], a[7] + b[7], a[8] + b[8]};
  }
  friend CLEAVE_INLINE Matrix3 operator-(const Matrix3& a, const Matrix3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4],
            a[5] - b[5], a[6] - b[6], a[7] - b[7], a[8] - b[8]};
  }
  friend CLEAVE_INLINE Matrix3 operator+(const Matrix3& a, const ScaledIdentity<T>& b) {
    return {a[0] + b.factor, a[1], a[2], a[3], a[4] + b.factor, a[5], a[6], a[7], a[8] + b.factor};
  }
  friend CLEAVE_INLINE Matrix3 operator+(const ScaledIdentity<T>& b, const Matrix3& a) { return a + b; }
  friend CLEAVE_INLINE Matrix3 operator-(const Matrix3& a, const ScaledIdentity<T>& b) { return a + (-b); }
  friend CLEAVE_INLINE Matrix3 operator-(const ScaledIdentity<T>& b, const Matrix3& a) { return -a + b; }
  friend CLEAVE_INLINE Matrix3 operator-(const Matrix3& a) {
    return {-a[0], -a[1], -a[2], -a[3], -a[4], -a[5], -a[6], -a[7], -a[8]};
  }
  friend CLEAVE_INLINE Matrix3 operator*(const T& s, const Matrix3& a) {
    return {s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5], s * a[6], s * a[7], s * a[8]};
  }
  friend CLEAVE_INLINE Matrix3 operator*(const Matrix3& a, const T& s) { return s * a; }
  friend CLEAVE_INLINE Matrix3 operator/(const Matrix3& a, const T& s) { return (T(1) / s) * a; }
  CLEAVE_INLINE Matrix3& operator+=(const Matrix3& b) { return *this = *this + b; }
  CLEAVE_INLINE Matrix3& operator-=(const Matrix3& b) { return *this = *this - b; }
  CLEAVE_INLINE Matrix3& operator*=(const T& s) { return *this = s * *this; }

  friend CLEAVE_INLINE Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
    return {a[0] * b[0] + a[1] * b[3] + a[2] * b[6], a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
            a[0] * b[2] + a[1] * b[5] + a[2] * b[8], a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
            a[3] * b[1] + a[4] * b[4] + a[5] * b[7], a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[3] + a[8] * b[6], a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
            a[6] * b[2] + a[7] * b[5] + a[8] * b[8]};
  }
  friend CLEAVE_INLINE Vector3<T> operator*(const Matrix3& a, const Vector3<T>& x) {
    return {a[0] * x[0] + a[1] * x[1] + a[2] * x[2], a[3] * x[0] + a[4] * x[1] + a[5] * x[2],
            a[6] * x[0] + a[7] * x[1] + a[8] * x[2]};
  }

  friend CLEAVE_INLINE Matrix3 transpose(const Matrix3& a) { return {a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]}; }
  friend CLEAVE_INLINE T trace(const Matrix3& a) { return a[0] + a[4] + a[8]; }
  friend CLEAVE_INLINE T determinant(const Matrix3& a) {
    return a[0] * (a[4] * a[8] - a[5] * a[7]) + a[1] * (a[5] * a[6] - a[3] * a[8]) + a[2] * (a[3] * a[7] - a[4] * a[6]);
  }
  /// cof(a) = det(a) a^-T = d det / d a, defined for singular tensors too.
  friend CLEAVE_INLINE Matrix3 cofactor(const Matrix3& a) {
    return {a[4] * a[8] - a[5] * a[7], a[5] * a[6] - a[3] * a[8], a[3] * a[7] - a[4] * a[6],
            a[2] * a[7] - a[1] * a[8], a[0] * a[8] - a[2] * a[6], a[1] * a[6] - a[0] * a[7],
            a[1] * a[5] - a[2] * a[4], a[2] * a[3] - a[0] * a[5], a[0] * a[4] - a[1] * a[3]};
  }
  /// The derivative of cof(a) along b; bilinear and symmetric in a and b.
  friend CLEAVE_INLINE Matrix3 delta_cofactor(const Matrix3& a, const Matrix3& b) {
    return {a[4] * b[8] + b[4] * a[8] - a[5] * b[7] - b[5] * a[7], a[5] * b[6] + b[5] * a[6] - a[3] * b[8] - b[3] * a[8],
            a[3] * b[7] + b[3] * a[7] - a[4] * b[6] - b[4] * a[6], a[2] * b[7] + b[2] * a[7] - a[1] * b[8] - b[1] * a[8],
            a[0] * b[8] + b[0] * a[8] - a[2] * b[6] - b[2] * a[6], a[1] * b[6] + b[1] * a[6] - a[0] * b[7] - b[0] * a[7],
            a[1] * b[5] + b[1] * a[5] - a[2] * b[4] - b[2] * a[4], a[2] * b[3] + b[2] * a[3] - a[0] * b[5] - b[0] * a[5],
            a[0] * b[4] + b[0] * a[4] - a[1] * b[3] - b[1] * a[3]};
  }
  friend CLEAVE_INLINE Matrix3 inverse(const Matrix3& a) {
    const Matrix3 c = cofactor(a);
    return transpose(c) / (a[0] * c[0] + a[1] * c[1] + a[2] * c[2]);
  }
  /// a : b = sum a_ij b_ij
  friend CLEAVE_INLINE T contract(const Matrix3& a, const Matrix3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5] + a[6] * b[6] + a[7] * b[7] +
           a[8] * b[8];
  }
  friend CLEAVE_INLINE T squared_norm(const Matrix3& a) { return contract(a, a); }
  friend CLEAVE_INLINE T norm(const Matrix3& a) { return sqrt(contract(a, a)); }
  /// a - tr(a)/3 I
  friend CLEAVE_INLINE Matrix3 deviator(const Matrix3& a) { return a - ScaledIdentity<T>{(a[0] + a[4] + a[8]) * T(1.0 / 3.0)}; }
  /// (a + a^T) / 2
  friend CLEAVE_INLINE Symmetric3<T> symmetric_part(const Matrix3& a) {
    const T half(0.5);
    return {a[0], a[4], a[8], half * (a[1] + a[3]), half * (a[2] + a[6]), half * (a[5] + a[7])};
  }
  friend CLEAVE_INLINE Matrix3 select(const mask_of<T>& m, const Matrix3& a, const Matrix3& b) {
    return {select(m, a[0], b[0]), select(m, a[1], b[1]), select(m, a[2], b[2]), select(m, a[3], b[3]), select(m, a[4], b[4]),
            select(m, a[5], b[5]), select(m, a[6], b[6]), select(m, a[7], b[7]), select(m, a[8], b[8])};
  }
  friend CLEAVE_INLINE Matrix3 operator*(const ScaledIdentity<T>& a, const Matrix3& b) { return a.factor * b; }
  friend CLEAVE_INLINE Matrix3 operator*(const Matrix3& a, const ScaledIdentity<T>& b) { return b.factor * a; }

  /// F F^T
  friend CLEAVE_INLINE Symmetric3<T> left_cauchy_green(const Matrix3& F) {
    return {F[0] * F[0] + F[1] * F[1] + F[2] * F[2], F[3] * F[3] + F[4] * F[4] + F[5] * F[5],
            F[6] * F[6] + F[7] * F[7] + F[8] * F[8], F[0] * F[3] + F[1] * F[4] + F[2] * F[5],
            F[0] * F[6] + F[1] * F[7] + F[2] * F[8], F[3] * F[6] + F[4] * F[7] + F[5] * F[8]};
  }
  /// F^T F
  friend CLEAVE_INLINE Symmetric3<T> right_cauchy_green(const Matrix3& F) { return left_cauchy_green(transpose(F)); }
  /// a s a^T
  friend CLEAVE_INLINE Symmetric3<T> symmetric_product(const Matrix3& a, const Symmetric3<T>& s) {
    const Matrix3 b = a * Matrix3(s);
    return {b[0] * a[0] + b[1] * a[1] + b[2] * a[2], b[3] * a[3] + b[4] * a[4] + b[5] * a[5],
            b[6] * a[6] + b[7] * a[7] + b[8] * a[8], b[0] * a[3] + b[1] * a[4] + b[2] * a[5],
            b[0] * a[6] + b[1] * a[7] + b[2] * a[8], b[3] * a[6] + b[4] * a[7] + b[5] * a[8]};
  }
};

/// Products of two symmetric tensors are not symmetric.
template <class T>
CLEAVE_INLINE Matrix3<T> operator*(const Symmetric3<T>& a, const Symmetric3<T>& b) {
  return Matrix3<T>(a) * Matrix3<T>(b);
}
template <class T>
CLEAVE_INLINE Symmetric3<T> operator*(const Symmetric3<T>& a, const ScaledIdentity<T>& b) {
  return b.factor * a;
}
template <class T>
CLEAVE_INLINE Symmetric3<T> operator*(const ScaledIdentity<T>& a, const Symmetric3<T>& b) {
  return a.factor * b;
}
/// a b^T
template <class T>
CLEAVE_INLINE Matrix3<T> outer(const Vector3<T>& a, const Vector3<T>& b) {
  return {a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[0], a[1] * b[1], a[1] * b[2], a[2] * b[0], a[2] * b[1], a[2] * b[2]};
}
/// a a^T
template <class T>
CLEAVE_INLINE Symmetric3<T> outer(const Vector3<T>& a) {
  return {a[0] * a[0], a[1] * a[1], a[2] * a[2], a[0] * a[1], a[0] * a[2], a[1] * a[2]};
}
/// The diagonal tensor with the given entries.
template <class T>
CLEAVE_INLINE Symmetric3<T> diagonal(const Vector3<T>& d) {
  return {d[0], d[1], d[2], T(0), T(0), T(0)};
}

}  // namespace cleave

#endif
