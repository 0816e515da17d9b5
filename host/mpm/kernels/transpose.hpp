#pragma once

#include "mpm/kernels/row.hpp"

/// Between components of lanes (one row of a tile per component) and one record of 16 numbers per particle.
namespace cleave::mpm::kernel {

inline constexpr int record_size = 16;

template <class T>
CLEAVE_INLINE void transpose_quads(Quad<T>& a, Quad<T>& b, Quad<T>& c, Quad<T>& d) {
  if constexpr (Quad<T>::count == 1) {
    using R = typename Quad<T>::Register;
    const R ab_low = __builtin_shufflevector(a.r[0], b.r[0], 0, 4, 1, 5),
            ab_high = __builtin_shufflevector(a.r[0], b.r[0], 2, 6, 3, 7);
    const R cd_low = __builtin_shufflevector(c.r[0], d.r[0], 0, 4, 1, 5),
            cd_high = __builtin_shufflevector(c.r[0], d.r[0], 2, 6, 3, 7);
    a.r[0] = __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5);
    b.r[0] = __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7);
    c.r[0] = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5);
    d.r[0] = __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
  } else {
    const auto low = [](const auto& x, const auto& y) { return __builtin_shufflevector(x, y, 0, 2); };
    const auto high = [](const auto& x, const auto& y) { return __builtin_shufflevector(x, y, 1, 3); };
    const Quad<T> p{{low(a.r[0], b.r[0]), low(c.r[0], d.r[0])}}, q{{high(a.r[0], b.r[0]), high(c.r[0], d.r[0])}},
        r{{low(a.r[1], b.r[1]), low(c.r[1], d.r[1])}}, s{{high(a.r[1], b.r[1]), high(c.r[1], d.r[1])}};
    a = p;
    b = q;
    c = r;
    d = s;
  }
}

/// rows: quads*4 rows of `lanes` numbers -> records[lane * record_size + row]
template <class T, int Quads>
CLEAVE_INLINE void lanes_to_records(const T* rows, T* records) {
  constexpr int lanes = 64 / int(sizeof(T));
#if CLEAVE_REGISTER_BYTES == 64
  if constexpr (sizeof(T) == 4 && Quads == 4) {
    __m512 r[16], t[16];
    for (int i = 0; i < 16; i++) r[i] = _mm512_load_ps(reinterpret_cast<const float*>(rows) + 16 * i);
    for (int i = 0; i < 16; i += 2) {
      t[i] = _mm512_unpacklo_ps(r[i], r[i + 1]);
      t[i + 1] = _mm512_unpackhi_ps(r[i], r[i + 1]);
    }
    for (int i = 0; i < 16; i += 4) {
      const __m512d a = _mm512_castps_pd(t[i]), b = _mm512_castps_pd(t[i + 1]), c = _mm512_castps_pd(t[i + 2]),
                    d = _mm512_castps_pd(t[i + 3]);
      r[i] = _mm512_castpd_ps(_mm512_unpacklo_pd(a, c));
      r[i + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(a, c));
      r[i + 2] = _mm512_castpd_ps(_mm512_unpacklo_pd(b, d));
      r[i + 3] = _mm512_castpd_ps(_mm512_unpackhi_pd(b, d));
    }
    for (int i = 0; i < 4; i++) {
      const __m512 a = _mm512_shuffle_f32x4(r[i], r[i + 4], 0x88), b = _mm512_shuffle_f32x4(r[i], r[i + 4], 0xdd),
                   c = _mm512_shuffle_f32x4(r[i + 8], r[i + 12], 0x88), d = _mm512_shuffle_f32x4(r[i + 8], r[i + 12], 0xdd);
      float* out = reinterpret_cast<float*>(records);
      _mm512_store_ps(out + 16 * i, _mm512_shuffle_f32x4(a, c, 0x88));
      _mm512_store_ps(out + 16 * (i + 8), _mm512_shuffle_f32x4(a, c, 0xdd));
      _mm512_store_ps(out + 16 * (i + 4), _mm512_shuffle_f32x4(b, d, 0x88));
      _mm512_store_ps(out + 16 * (i + 12), _mm512_shuffle_f32x4(b, d, 0xdd));
    }
    return;
  }
#endif
  for (int q = 0; q < Quads; q++)
    for (int l = 0; l < lanes; l += 4) {
      const T* p = rows + 4 * q * lanes + l;
      Quad<T> a = load_quad(p), b = load_quad(p + lanes), c = load_quad(p + 2 * lanes), d = load_quad(p + 3 * lanes);
      transpose_quads<T>(a, b, c, d);
      T* out = records + l * record_size + 4 * q;
      store_quad<T>(out, a);
      store_quad<T>(out + record_size, b);
      store_quad<T>(out + 2 * record_size, c);
      store_quad<T>(out + 3 * record_size, d);
    }
}

/// records[lane * record_size + row] -> quads*4 rows of `lanes` numbers
template <class T, int Quads>
CLEAVE_INLINE void records_to_lanes(const T* records, T* rows) {
  constexpr int lanes = 64 / int(sizeof(T));
#if CLEAVE_REGISTER_BYTES == 64
  if constexpr (sizeof(T) == 4 && Quads == 4) {
    lanes_to_records<T, Quads>(records, rows);  // a 16x16 transpose is its own inverse
    return;
  }
#elif CLEAVE_REGISTER_BYTES == 32
  // Written in the pieces they are read in: two halves of 16 bytes would not be forwarded to a read of 32.
  if constexpr (sizeof(T) == 4) {
    for (int q = 0; q < Quads; q++)
      for (int l = 0; l < lanes; l += 8) {
        const float* p = reinterpret_cast<const float*>(records) + l * record_size + 4 * q;
        const auto two = [&](int i) __attribute__((always_inline)) {
          return _mm256_set_m128(_mm_load_ps(p + (i + 4) * record_size), _mm_load_ps(p + i * record_size));
        };
        const __m256 a = two(0), b = two(1), c = two(2), d = two(3);
        const __m256 ab_low = _mm256_unpacklo_ps(a, b), ab_high = _mm256_unpackhi_ps(a, b), cd_low = _mm256_unpacklo_ps(c, d),
                     cd_high = _mm256_unpackhi_ps(c, d);
        float* out = reinterpret_cast<float*>(rows) + 4 * q * lanes + l;
        _mm256_store_ps(out, _mm256_shuffle_ps(ab_low, cd_low, 0x44));
        _mm256_store_ps(out + lanes, _mm256_shuffle_ps(ab_low, cd_low, 0xee));
        _mm256_store_ps(out + 2 * lanes, _mm256_shuffle_ps(ab_high, cd_high, 0x44));
        _mm256_store_ps(out + 3 * lanes, _mm256_shuffle_ps(ab_high, cd_high, 0xee));
      }
    return;
  }
#endif
  for (int q = 0; q < Quads; q++)
    for (int l = 0; l < lanes; l += 4) {
      const T* p = records + l * record_size + 4 * q;
      Quad<T> a = load_quad(p), b = load_quad(p + record_size), c = load_quad(p + 2 * record_size),
              d = load_quad(p + 3 * record_size);
      transpose_quads<T>(a, b, c, d);
      T* out = rows + 4 * q * lanes + l;
      store_quad<T>(out, a);
      store_quad<T>(out + lanes, b);
      store_quad<T>(out + 2 * lanes, c);
      store_quad<T>(out + 3 * lanes, d);
    }
}

}  // namespace cleave::mpm::kernel
