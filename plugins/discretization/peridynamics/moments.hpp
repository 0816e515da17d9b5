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

/// sum p phi phi^T over the bonds of a family, phi the powers of their directions.
class MomentMatrix {
 public:
  void add(const Moments& phi, double p) {
    for (std::size_t a = 0; a < size; ++a)
      for (std::size_t b = 0; b < phi.size(); ++b) matrix_[a][b] += p * phi[a] * phi[b];
  }

  /// Solves for the coefficients of the polynomial that changes the moments by `change`, by Cholesky's factorisation. What
  /// few bonds leave open is kept small.
  Moments solve(Moments change) {
    double trace = 0;
    for (std::size_t a = 0; a < size; ++a) trace += matrix_[a][a];
    for (std::size_t a = 0; a < size; ++a) {
      matrix_[a][a] += 1e-6 * trace;
      for (std::size_t b = 0; b <= a; ++b) {
        double sum = matrix_[a][b];
        for (std::size_t c = 0; c < b; ++c) sum -= matrix_[a][c] * matrix_[b][c];
        matrix_[a][b] = a == b ? std::sqrt(sum) : sum / matrix_[b][b];
      }
      for (std::size_t c = 0; c < a; ++c) change[a] -= matrix_[a][c] * change[c];
      change[a] /= matrix_[a][a];
    }
    for (std::size_t a = size; a-- > 0;) {
      for (std::size_t c = a + 1; c < size; ++c) change[a] -= matrix_[c][a] * change[c];
      change[a] /= matrix_[a][a];
    }
    return change;
  }

 private:
  static constexpr std::size_t size = 15;
  std::array<Moments, size> matrix_{};
};

}  // namespace cleave::peridynamics

#endif
