#pragma once

#include "mpm/kernels/tiles.hpp"

/// Rows of the stencil of single numbers: three neighbouring nodes along the last axis and a fourth that counts for nothing. As
/// many neighbouring particles side by side as a register holds rows of; they share a cell, and so the row.
namespace cleave::mpm::kernel {
namespace {

template <class T>
using Quads = std::conditional_t<(4 * sizeof(T) < register_bytes), Part<T>, Quad<T>>;
/// Particles of `Quads`.
template <class T>
inline constexpr int side_by_side = Quads<T>::lanes / 4;

/// Four numbers for each particle.
template <class T>
CLEAVE_INLINE Quads<T> repeat_quad(const T* p) {
  Quad<T> q;
  std::memcpy(&q, p, sizeof q);
#if CLEAVE_REGISTER_BYTES == 64
  if constexpr (sizeof(T) == 4)
    return {{_mm512_broadcast_f32x4(q.r[0])}};
  else
    return {{_mm512_broadcast_f64x4(q.r[0])}};
#elif CLEAVE_REGISTER_BYTES == 32
  if constexpr (sizeof(T) == 4) return {{_mm256_set_m128(q.r[0], q.r[0])}};
#endif
  if constexpr (side_by_side<T> == 1) return q;
}

/// One number of each particle, four times over; they follow each other in memory.
template <class T>
CLEAVE_INLINE Quads<T> spread(const T* p) {
#if CLEAVE_REGISTER_BYTES == 64
  if constexpr (sizeof(T) == 4) {
    const __m512i from = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
    return {{_mm512_permutexvar_ps(from, _mm512_castps128_ps512(_mm_load_ps(p)))}};
  } else {
    const __m512i from = _mm512_setr_epi64(0, 0, 0, 0, 1, 1, 1, 1);
    return {{_mm512_permutexvar_pd(from, _mm512_castpd128_pd512(_mm_load_pd(p)))}};
  }
#elif CLEAVE_REGISTER_BYTES == 32
  if constexpr (sizeof(T) == 4) {
    const __m256i from = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
    const __m128 two = _mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p)));
    return {{_mm256_permutevar8x32_ps(_mm256_castps128_ps256(two), from)}};
  }
#endif
  if constexpr (side_by_side<T> == 1) return *p - Quads<T>{};
}

/// a, b and c for the three nodes, zero for the fourth.
template <class T>
CLEAVE_INLINE Quads<T> for_nodes(const Quads<T>& a, const Quads<T>& b, const Quads<T>& c) {
  if constexpr (Quads<T>::count == 1) {
    using R = typename Quads<T>::Register;
    return [&]<int... I>(std::integer_sequence<int, I...>) __attribute__((always_inline)) {
      constexpr int n = int(sizeof...(I));
      const R ab = __builtin_shufflevector(a.r[0], b.r[0], (I % 4 == 1 ? n + I : I)...);
      const R c0 = __builtin_shufflevector(c.r[0], R{}, (I % 4 == 3 ? n + I : I)...);
      return Quads<T>{{__builtin_shufflevector(ab, c0, (I % 4 < 2 ? I : n + I)...)}};
    }
    (std::make_integer_sequence<int, Quads<T>::lanes>{});
  } else {
    return quad<T>(a[0], b[0], c[0], T(0));
  }
}

/// The sum of each quad, four times over.
template <class T>
CLEAVE_INLINE Quads<T> sum_quads(const Quads<T>& x) {
  using R = typename Quads<T>::Register;
  return [&]<int... I>(std::integer_sequence<int, I...>) __attribute__((always_inline)) {
    if constexpr (Quads<T>::count == 1) {
      const R half = x.r[0] + __builtin_shufflevector(x.r[0], x.r[0], (I ^ 2)...);
      return Quads<T>{{half + __builtin_shufflevector(half, half, (I ^ 1)...)}};
    } else {
      const R half = x.r[0] + x.r[1], sum = half + __builtin_shufflevector(half, half, (I ^ 1)...);
      return Quads<T>{{sum, sum}};
    }
  }
  (std::make_integer_sequence<int, Quads<T>::each>{});
}

/// The sum of all quads.
template <class T>
CLEAVE_INLINE Quad<T> add_up(const Quads<T>& x) {
#if CLEAVE_REGISTER_BYTES == 64
  if constexpr (sizeof(T) == 4) {
    const __m256 half = _mm256_add_ps(_mm512_castps512_ps256(x.r[0]), _mm512_extractf32x8_ps(x.r[0], 1));
    return {{_mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1))}};
  } else {
    return {{_mm256_add_pd(_mm512_castpd512_pd256(x.r[0]), _mm512_extractf64x4_pd(x.r[0], 1))}};
  }
#elif CLEAVE_REGISTER_BYTES == 32
  if constexpr (sizeof(T) == 4) return {{_mm_add_ps(_mm256_castps256_ps128(x.r[0]), _mm256_extractf128_ps(x.r[0], 1))}};
#endif
  if constexpr (side_by_side<T> == 1) return x;
}

}  // namespace
}  // namespace cleave::mpm::kernel
