/// An upper bound of the fastest wave from the spatial tangent.
#ifndef CLEAVE_DETAIL_ACOUSTIC_HPP
#define CLEAVE_DETAIL_ACOUSTIC_HPP

#include <cleave/tensor.hpp>

#include <array>

namespace cleave::detail {

/// a_ijkl with rho_0 c^2 = max m_i n_j a_ijkl m_k n_l over unit vectors: n the direction of the wave, m of the motion.
template <class T>
struct SpatialTangent {
  std::array<T, 81> component;
  CLEAVE_INLINE T& operator()(int i, int j, int k, int l) { return component[27 * i + 9 * j + 3 * k + l]; }
  CLEAVE_INLINE const T& operator()(int i, int j, int k, int l) const { return component[27 * i + 9 * j + 3 * k + l]; }
};

/// The form is bilinear in M = m m^T and N = n n^T, <M, B N>. With M = I/3 + M', |M'|^2 = 2/3, and the same for N,
///
///   <M, B N> <= I:B I/9 + sqrt(2/3)/3 (|dev B I| + |dev B^T I|) + 2/3 |B'|,
///
/// B' acting between deviators, |B'| its largest singular value. Equality for a linear isotropic solid, save that |B'| is
/// taken from a power of B'^T B': (|(B'^T B')^4|_F)^(1/8) exceeds it by less than 11 %.
template <class T>
T acoustic_bound(const SpatialTangent<T>& a) {
  // B between symmetric tensors in the orthonormal basis xx yy zz sqrt2 xy sqrt2 xz sqrt2 yz.
  constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  constexpr double root2 = 1.4142135623730951;
  T B[6][6];
  for (int p = 0; p < 6; ++p)
    for (int q = 0; q < 6; ++q) {
      const int i = row[p], k = column[p], j = row[q], l = column[q];
      const T mean = T(0.25) * (a(i, j, k, l) + a(k, j, i, l) + a(i, l, k, j) + a(k, l, i, j));
      B[p][q] = mean * T((p < 3 ? 1 : root2) * (q < 3 ? 1 : root2));
    }

  // Splits off the means over the first three columns and rows, which are the contractions with I/3.
  T right[6], left[6], both(0);
  for (int p = 0; p < 6; ++p) {
    right[p] = (B[p][0] + B[p][1] + B[p][2]) * T(1.0 / 3);
    left[p] = (B[0][p] + B[1][p] + B[2][p]) * T(1.0 / 3);
  }
  for (int p = 0; p < 3; ++p) both += right[p] * T(1.0 / 3);
  for (int p = 0; p < 6; ++p)
    for (int q = 0; q < 6; ++q) {
      if (q < 3) B[p][q] -= right[p];
      if (p < 3) B[p][q] -= left[q];
      if (p < 3 && q < 3) B[p][q] += both;
    }
  T right_norm(0), left_norm(0), scale(0);
  for (int p = 0; p < 6; ++p) {
    const T r = p < 3 ? right[p] - both : right[p], l = p < 3 ? left[p] - both : left[p];
    right_norm += r * r;
    left_norm += l * l;
    for (int q = 0; q < 6; ++q) scale = max(scale, abs(B[p][q]));
  }

  // Largest singular value; scaled, because its eighth power is taken.
  const T inverse_scale = select(scale > T(0), T(1) / scale, T(0));
  T G[6][6];
  const auto multiply = [](const T(&x)[6][6], const T(&y)[6][6], T(&xty)[6][6]) {
    for (int p = 0; p < 6; ++p)
      for (int q = 0; q < 6; ++q) {
        xty[p][q] = x[0][p] * y[0][q];
        for (int r = 1; r < 6; ++r) xty[p][q] += x[r][p] * y[r][q];
      }
  };
  for (auto& line : B)
    for (T& entry : line) entry = entry * inverse_scale;
  multiply(B, B, G);
  multiply(G, G, B);
  multiply(B, B, G);
  T squares(0);
  for (const auto& line : G)
    for (const T& entry : line) squares += entry * entry;
  const T singular = scale * sqrt(sqrt(sqrt(sqrt(squares))));

  const T bound = both + T(0.81649658092772603) * (sqrt(right_norm) + sqrt(left_norm)) + T(2.0 / 3) * singular;
  return max(bound, T(0));
}

}  // namespace cleave::detail

#endif
