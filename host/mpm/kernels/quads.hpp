#pragma once

#include "mpm/kernels/tiles.hpp"

/// Rows of the stencil of single numbers: three neighbouring nodes along the last axis and a fourth that counts for nothing.
/// Q is Quad<T>, for one particle, or Quads<T>, for as many neighbouring particles of a cell as a register holds rows for.
namespace cleave::mpm::kernel {
namespace {

template <class T>
using Quads = std::conditional_t<(4 * sizeof(T) < register_bytes), Part<T>, Quad<T>>;
/// Particles of Q.
template <class Q>
inline constexpr int side_by_side = Q::lanes / 4;

/// The same four numbers for each particle.
template <class Q, class T>
CLEAVE_INLINE Q repeat_quad(const Quad<T>& q) {
  if constexpr (side_by_side<Q> == 1) {
    return q;
  } else {
#if CLEAVE_REGISTER_BYTES == 64
    if constexpr (sizeof(T) == 4)
      return {{_mm512_broadcast_f32x4(q.r[0])}};
    else
      return {{_mm512_broadcast_f64x4(q.r[0])}};
#elif CLEAVE_REGISTER_BYTES == 32
    return {{_mm256_set_m128(q.r[0], q.r[0])}};
#endif
  }
}

/// One number of each particle, four times over; they follow each other in memory.
template <class Q, class T>
CLEAVE_INLINE Q spread(const T* p) {
  if constexpr (side_by_side<Q> == 1) {
    return *p - Q{};
  } else {
#if CLEAVE_REGISTER_BYTES == 64
    if constexpr (sizeof(T) == 4) {
      const __m512i from = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
      return {{_mm512_permutexvar_ps(from, _mm512_castps128_ps512(_mm_loadu_ps(p)))}};
    } else {
      const __m512i from = _mm512_setr_epi64(0, 0, 0, 0, 1, 1, 1, 1);
      return {{_mm512_permutexvar_pd(from, _mm512_castpd128_pd512(_mm_loadu_pd(p)))}};
    }
#elif CLEAVE_REGISTER_BYTES == 32
    const __m256i from = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
    const __m128 two = _mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p)));
    return {{_mm256_permutevar8x32_ps(_mm256_castps128_ps256(two), from)}};
#endif
  }
}

/// a, b and c for the three nodes, zero for the fourth.
template <class Q>
CLEAVE_INLINE Q for_nodes(const Q& a, const Q& b, const Q& c) {
  using R = typename Q::Register;
  if constexpr (side_by_side<Q> == 1) {
    return quad<typename Q::Number>(a[0], b[0], c[0], 0);
  } else {
    return [&]<int... I>(std::integer_sequence<int, I...>) __attribute__((always_inline)) {
      constexpr int n = Q::lanes;
      const R ab = __builtin_shufflevector(a.r[0], b.r[0], (I % 4 == 1 ? n + I : I)...);
      const R c0 = __builtin_shufflevector(c.r[0], R{}, (I % 4 == 3 ? n + I : I)...);
      return Q{{__builtin_shufflevector(ab, c0, (I % 4 < 2 ? I : n + I)...)}};
    }
    (std::make_integer_sequence<int, Q::lanes>{});
  }
}

/// The sum of each quad, four times over.
template <class Q>
CLEAVE_INLINE Q sum_quads(const Q& x) {
  using R = typename Q::Register;
  return [&]<int... I>(std::integer_sequence<int, I...>) __attribute__((always_inline)) {
    if constexpr (Q::count == 1) {
      const R half = x.r[0] + __builtin_shufflevector(x.r[0], x.r[0], (I ^ 2)...);
      return Q{{half + __builtin_shufflevector(half, half, (I ^ 1)...)}};
    } else {
      const R half = x.r[0] + x.r[1], sum = half + __builtin_shufflevector(half, half, (I ^ 1)...);
      return Q{{sum, sum}};
    }
  }
  (std::make_integer_sequence<int, Q::each>{});
}

/// The sum over the particles.
template <class T, class Q>
CLEAVE_INLINE Quad<T> add_up(const Q& x) {
  if constexpr (side_by_side<Q> == 1) {
    return x;
  } else {
#if CLEAVE_REGISTER_BYTES == 64
    if constexpr (sizeof(T) == 4) {
      const __m256 half = _mm256_add_ps(_mm512_castps512_ps256(x.r[0]), _mm512_extractf32x8_ps(x.r[0], 1));
      return {{_mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1))}};
    } else {
      return {{_mm256_add_pd(_mm512_castpd512_pd256(x.r[0]), _mm512_extractf64x4_pd(x.r[0], 1))}};
    }
#elif CLEAVE_REGISTER_BYTES == 32
    return {{_mm_add_ps(_mm256_castps256_ps128(x.r[0]), _mm256_extractf128_ps(x.r[0], 1))}};
#endif
  }
}

}  // namespace
}  // namespace cleave::mpm::kernel
