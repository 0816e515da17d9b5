/// Matrices of three rows and columns, for checks that turn and stretch what they hand to a law.
#ifndef CLEAVE_TESTKIT_TENSOR3_HPP
#define CLEAVE_TESTKIT_TENSOR3_HPP

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace cleave::testkit {

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<double, 9>;     ///< row-major, as Random::rotation() gives it
using Symmetric3 = std::array<double, 6>;  ///< xx yy zz xy xz yz, as the ABI has it

inline Matrix3 diagonal(double x, double y, double z) { return {x, 0, 0, 0, y, 0, 0, 0, z}; }
inline Matrix3 identity() { return diagonal(1, 1, 1); }

inline Matrix3 product(const Matrix3& a, const Matrix3& b) {
  Matrix3 ab{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) ab[3 * i + j] += a[3 * i + k] * b[3 * k + j];
  return ab;
}
inline Vector3 product(const Matrix3& a, const Vector3& v) {
  Vector3 av{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) av[i] += a[3 * i + k] * v[k];
  return av;
}
/// a + scale b
template <std::size_t N>
std::array<double, N> sum(const std::array<double, N>& a, const std::array<double, N>& b, double scale = 1) {
  std::array<double, N> c = a;
  for (std::size_t i = 0; i < N; ++i) c[i] += scale * b[i];
  return c;
}
template <std::size_t N>
double dot(const std::array<double, N>& a, const std::array<double, N>& b) {
  double d = 0;
  for (std::size_t i = 0; i < N; ++i) d += a[i] * b[i];
  return d;
}

inline Matrix3 transpose(const Matrix3& a) { return {a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]}; }
inline double determinant(const Matrix3& a) {
  return a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6]);
}

inline Matrix3 full(const Symmetric3& s) { return {s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]}; }
/// The mean of a and its transpose.
inline Symmetric3 symmetric_part(const Matrix3& a) {
  return {a[0], a[4], a[8], (a[1] + a[3]) / 2, (a[2] + a[6]) / 2, (a[5] + a[7]) / 2};
}
/// b = F F^T
inline Symmetric3 left_cauchy_green(const Matrix3& F) { return symmetric_part(product(F, transpose(F))); }
/// Q a Q^T
inline Matrix3 turned(const Matrix3& Q, const Matrix3& a) { return product(product(Q, a), transpose(Q)); }
inline Symmetric3 turned(const Matrix3& Q, const Symmetric3& s) { return symmetric_part(turned(Q, full(s))); }

inline double norm(const Vector3& v) { return std::sqrt(dot(v, v)); }
inline double norm(const Matrix3& a) { return std::sqrt(dot(a, a)); }
inline double norm(const Symmetric3& s) { return norm(full(s)); }

/// Rotation about a unit axis (Rodrigues).
inline Matrix3 rotation(const Vector3& axis, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  const Matrix3 cross{0, -axis[2], axis[1], axis[2], 0, -axis[0], -axis[1], axis[0], 0};
  Matrix3 R = sum(diagonal(c, c, c), cross, s);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) R[3 * i + j] += (1 - c) * axis[i] * axis[j];
  return R;
}

/// One point's numbers in a Field, and back.
template <std::size_t N>
std::vector<double> numbers(const std::array<double, N>& a) {
  return {a.begin(), a.end()};
}
template <std::size_t N>
std::array<double, N> read(const std::vector<double>& numbers) {
  std::array<double, N> a{};
  for (std::size_t i = 0; i < N; ++i) a[i] = numbers.at(i);
  return a;
}

}  // namespace cleave::testkit

#endif
