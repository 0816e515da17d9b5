/// Weights of bonds that make the stiffness of a family isotropic.
#ifndef CLEAVE_PERIDYNAMICS_MOMENTS_HPP
#define CLEAVE_PERIDYNAMICS_MOMENTS_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace cleave::peridynamics {

/// Moments of fourth order of directions n, the last element being none.
using Moments = std::array<double, 16>;

/// The monomials of fourth order of n.
inline Moments fourth_powers(const std::array<double, 3>& n) {
  const double x = n[0], y = n[1], z = n[2], xx = x * x, xy = x * y, xz = x * z, yy = y * y, yz = y * z, zz = z * z;
  return {xx * xx, xx * xy, xx * xz, xx * yy, xx * yz, xx * zz, xy * yy, xy * yz,
          xy * zz, xz * zz, yy * yy, yy * yz, yy * zz, yz * zz, zz * zz, 0};
}

inline double dot(const Moments& a, const Moments& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
  return sum;
}

/// Their means over all directions of space, or of the plane: (d_ab d_cd + d_ac d_bd + d_ad d_bc)/(D (D + 2)).
inline Moments isotropic_moments(int dimension) {
  Moments mean{};
  const double unit = 1.0 / (dimension * (dimension + 2));
  mean[0] = mean[10] = 3 * unit;
  mean[3] = unit;
  if (dimension == 3) {
    mean[14] = 3 * unit;
    mean[5] = mean[12] = unit;
  }
  return mean;
}

/// sum p phi phi^T over the bonds of a family, phi the powers of their directions. Its elements are moments of eighth order,
/// of which there are 45.
class MomentMatrix {
 public:
  void add(const Moments& phi, double p) {
    const double xxxx = p * phi[0], zzzz = p * phi[14];
    for (std::size_t k = 0; k < size; ++k) moments_[k] += xxxx * phi[k];
    for (std::size_t r = 1; r < 5; ++r) {
      const double* powers = &phi[start(r)];
      double* moments = &moments_[start(r + 4)];
      for (std::size_t k = 0; k < 5; ++k) moments[k] += p * powers[0] * phi[10 + k];
      for (std::size_t k = 1; k <= r; ++k) moments[4 + k] += zzzz * powers[k];
    }
  }

  /// Solves for the coefficients of the polynomial that changes the moments by `change`, by Cholesky's factorisation. What
  /// few bonds leave open is kept small.
  Moments solve(Moments change) const {
    std::array<Moments, size> matrix;
    for (std::size_t r = 0, a = 0; r < 5; ++r)
      for (std::size_t k = 0; k <= r; ++k, ++a)
        for (std::size_t s = 0, b = 0; s < 5; ++s)
          for (std::size_t l = 0; l <= s; ++l, ++b) matrix[a][b] = moments_[start(r + s) + k + l];
    double trace = 0;
    for (std::size_t a = 0; a < size; ++a) trace += matrix[a][a];
    for (std::size_t a = 0; a < size; ++a) {
      matrix[a][a] += 1e-6 * trace;
      for (std::size_t b = 0; b <= a; ++b) {
        double sum = matrix[a][b];
        for (std::size_t c = 0; c < b; ++c) sum -= matrix[a][c] * matrix[b][c];
        matrix[a][b] = a == b ? std::sqrt(sum) : sum / matrix[b][b];
      }
      for (std::size_t c = 0; c < a; ++c) change[a] -= matrix[a][c] * change[c];
      change[a] /= matrix[a][a];
    }
    for (std::size_t a = size; a-- > 0;) {
      for (std::size_t c = a + 1; c < size; ++c) change[a] -= matrix[c][a] * change[c];
      change[a] /= matrix[a][a];
    }
    return change;
  }

 private:
  static constexpr std::size_t size = 15;
  /// Monomials x^(n-r) y^(r-k) z^k stand at start(r) + k, whatever their order n.
  static constexpr std::size_t start(std::size_t r) { return r * (r + 1) / 2; }
  std::array<double, 45> moments_{};
};

}  // namespace cleave::peridynamics

#endif
