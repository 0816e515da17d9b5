/// The linear map that the unbroken bonds of a point follow best.
#ifndef CLEAVE_PERIDYNAMICS_SHAPE_TENSOR_HPP
#define CLEAVE_PERIDYNAMICS_SHAPE_TENSOR_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace cleave::peridynamics {

using Matrix = std::array<std::array<double, 3>, 3>;

/// Sums over the bonds of a point, weighed by their stiffness K: those of the shape tensor [Silling et al. 2007, eq. 128].
struct ShapeTensor {
  Matrix rest{};      ///< sum K xi xi^T, of unbroken bonds
  Matrix deformed{};  ///< sum K y xi^T
  Matrix moving{};    ///< sum K (v_j - v_i) xi^T
  double full = 0;    ///< sum K |xi|^2, of all bonds
};

struct LocalMotion {
  Matrix gradient;  ///< F
  Matrix rate;      ///< dF/dt
};

/// The rotation R with the largest tr(R^T A) near the identity, by turning until A R^T is symmetric [Mueller et al. 2016].
inline Matrix rotation_of(const Matrix& A) {
  Matrix R = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (int n = 0; n < 60; ++n) {
    std::array<double, 3> turn{};
    double along = 0;
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t a = 0; a < 3; ++a) {
        const std::size_t b = (a + 1) % 3, d = (a + 2) % 3;
        turn[a] += R[b][c] * A[d][c] - R[d][c] * A[b][c];
        along += R[a][c] * A[a][c];
      }
    for (double& t : turn) t /= std::abs(along) + 1e-300;
    const double angle = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    if (!(angle > 1e-12)) break;
    const double s = std::sin(angle) / angle, k = (1 - std::cos(angle)) / (angle * angle);
    Matrix next;
    for (std::size_t c = 0; c < 3; ++c) {
      const double projected = turn[0] * R[0][c] + turn[1] * R[1][c] + turn[2] * R[2][c];
      for (std::size_t a = 0; a < 3; ++a) {
        const std::size_t b = (a + 1) % 3, d = (a + 2) % 3;
        next[a][c] = std::cos(angle) * R[a][c] + s * (turn[b] * R[d][c] - turn[d] * R[b][c]) + k * projected * turn[a];
      }
    }
    R = next;
  }
  return R;
}

/// F = (sum K y xi^T + e R)(sum K xi xi^T + e)^-1. e is small, and next to nothing where no bond is broken: in directions that
/// no unbroken bond has, F is the rotation R of the others. The rate is that of F with R as it is.
inline LocalMotion local_motion(const ShapeTensor& s) {
  const Matrix R = rotation_of(s.deformed);
  const double broken = s.full - (s.rest[0][0] + s.rest[1][1] + s.rest[2][2]);
  const double e = 0.01 * std::max(broken, 0.0) + 1e-12 * s.full + 1e-300;
  Matrix M = s.rest;
  for (std::size_t a = 0; a < 3; ++a) M[a][a] += e;
  Matrix inverse;
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b) {
      const std::size_t p = (b + 1) % 3, q = (b + 2) % 3, u = (a + 1) % 3, v = (a + 2) % 3;
      inverse[a][b] = M[p][u] * M[q][v] - M[p][v] * M[q][u];
    }
  const double determinant = M[0][0] * inverse[0][0] + M[0][1] * inverse[1][0] + M[0][2] * inverse[2][0];
  LocalMotion motion{};
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t c = 0; c < 3; ++c) {
        motion.gradient[a][b] += (s.deformed[a][c] + e * R[a][c]) * inverse[c][b] / determinant;
        motion.rate[a][b] += s.moving[a][c] * inverse[c][b] / determinant;
      }
  return motion;
}

}  // namespace cleave::peridynamics

#endif
