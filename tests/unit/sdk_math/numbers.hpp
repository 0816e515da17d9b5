/// What the tests of the numeric core share: errors in units in the last place, lanes from plain numbers, random rotations.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cleave/tensor.hpp>
#include <cmath>
#include <limits>
#include <random>

namespace cleave::testing {

template <class S>
struct OnScalar : ::testing::Test {};
using Scalars = ::testing::Types<float, double>;

template <class S>
constexpr S infinity = std::numeric_limits<S>::infinity();
template <class S>
constexpr S nan = std::numeric_limits<S>::quiet_NaN();
template <class S>
constexpr double epsilon = std::numeric_limits<S>::epsilon();

/// |computed - exact| in units in the last place of exact; 0 for two NaN or equal infinities, infinite if only one is.
template <class S>
double error_in_ulp(S computed, long double exact) {
  const S rounded = static_cast<S>(exact);
  if (std::isnan(computed) || std::isnan(rounded)) return std::isnan(computed) && std::isnan(rounded) ? 0 : infinity<double>;
  if (std::isinf(computed) || std::isinf(rounded)) return computed == rounded ? 0 : infinity<double>;
  if (exact == 0) return computed == 0 ? 0 : infinity<double>;
  int exponent;
  std::frexp(exact, &exponent);
  exponent = std::max(exponent, std::numeric_limits<S>::min_exponent);
  const long double unit = std::ldexp(1.0L, exponent - std::numeric_limits<S>::digits);
  return static_cast<double>(std::fabs(static_cast<long double>(computed) - exact) / unit);
}

template <class S>
Lanes<S> iota(S first, S step) {
  Lanes<S> x;
  for (int i = 0; i < Lanes<S>::width; ++i) x.set(i, first + step * static_cast<S>(i));
  return x;
}

/// Lane i of a number or tensor, in double precision.
template <std::floating_point S>
double lane(S x, int) {
  return x;
}
template <class S>
double lane(Lanes<S> x, int i) {
  return x[i];
}
template <class T>
Vector3<double> lane(const Vector3<T>& a, int i) {
  return {lane(a[0], i), lane(a[1], i), lane(a[2], i)};
}
template <class T>
Symmetric3<double> lane(const Symmetric3<T>& a, int i) {
  Symmetric3<double> b;
  for (int k = 0; k < 6; ++k) b[k] = lane(a[k], i);
  return b;
}
template <class T>
Matrix3<double> lane(const Matrix3<T>& a, int i) {
  Matrix3<double> b;
  for (int k = 0; k < 9; ++k) b[k] = lane(a[k], i);
  return b;
}

/// The largest component in magnitude; NaN if there is one.
inline double largest(const Matrix3<double>& a) {
  double m = 0;
  for (int k = 0; k < 9; ++k) m = std::max(m, std::fabs(a[k]));
  for (int k = 0; k < 9; ++k)
    if (std::isnan(a[k])) return a[k];
  return m;
}

/// How far Q is from a rotation.
inline double rotation_error(const Matrix3<double>& Q) {
  return std::max(largest(transpose(Q) * Q - identity<double>()), std::fabs(determinant(Q) - 1));
}

class Random {
 public:
  double uniform(double from, double to) { return std::uniform_real_distribution<double>(from, to)(engine_); }
  double normal() { return std::normal_distribution<double>()(engine_); }
  Matrix3<double> matrix() {
    Matrix3<double> a;
    for (int k = 0; k < 9; ++k) a[k] = normal();
    return a;
  }
  /// Uniformly distributed, from a unit quaternion.
  Matrix3<double> rotation() {
    double w = normal(), x = normal(), y = normal(), z = normal();
    const double s = 1 / std::sqrt(w * w + x * x + y * y + z * z);
    w *= s, x *= s, y *= s, z *= s;
    return {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w),    1 - 2 * (x * x + z * z),
            2 * (y * z - x * w),     2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
  }
  Matrix3<double> with_singular_values(double a, double b, double c) {
    return rotation() * Matrix3<double>(a, 0, 0, 0, b, 0, 0, 0, c) * rotation();
  }

 private:
  std::mt19937_64 engine_{20240607};
};

}  // namespace cleave::testing
