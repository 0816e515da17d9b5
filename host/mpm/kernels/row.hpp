#pragma once

#include "mpm/kernels/registers.hpp"

/// One row of the transfer stencil: three neighbouring nodes along the last axis, four numbers each (mass and velocity or
/// momentum). A particle meets nine such rows in three dimensions, three in two.
namespace cleave::mpm::kernel {

/// Four numbers: one register, or two of them.
template <class T>
struct QuadOf;
template <>
struct QuadOf<float> {
  typedef float Register __attribute__((vector_size(16)));
};
template <>
struct QuadOf<double> {
  typedef double Register __attribute__((vector_size(register_bytes < 32 ? 16 : 32)));
};
template <class T>
using Quad = Registers<typename QuadOf<T>::Register, int(4 * sizeof(T) / sizeof(typename QuadOf<T>::Register))>;

template <class T>
CLEAVE_INLINE Quad<T> load_quad(const T* p) {
  return *reinterpret_cast<const Quad<T>*>(p);
}
template <class T>
CLEAVE_INLINE void store_quad(T* p, const Quad<T>& v) {
  *reinterpret_cast<Quad<T>*>(p) = v;
}
template <class T>
CLEAVE_INLINE Quad<T> quad(T a, T b, T c, T d) {
  using R = typename Quad<T>::Register;
  if constexpr (Quad<T>::count == 1)
    return {{R{a, b, c, d}}};
  else
    return {{R{a, b}, R{c, d}}};
}

/// Portable form: three registers of four numbers.
template <class T>
struct Row {
  Quad<T> a, b, c;

  static CLEAVE_INLINE Row zero() { return {Quad<T>{}, Quad<T>{}, Quad<T>{}}; }
  static CLEAVE_INLINE Row load(const T* p) { return {load_quad(p), load_quad(p + 4), load_quad(p + 8)}; }
  CLEAVE_INLINE void store(T* p) const {
    store_quad<T>(p, a);
    store_quad<T>(p + 4, b);
    store_quad<T>(p + 8, c);
  }
  /// The same four numbers for each node.
  static CLEAVE_INLINE Row repeat(const T* p) {
    const Quad<T> q = load_quad(p);
    return {q, q, q};
  }
  /// Weight of each node, from three numbers `step` apart.
  static CLEAVE_INLINE Row weights(const T* w, int step) {
    return {w[0] - Quad<T>{}, w[step] - Quad<T>{}, w[2 * step] - Quad<T>{}};
  }
  /// base + x * (offset of the node from the middle one: -1, 0, 1)
  static CLEAVE_INLINE Row add_offset(Row x, Row base) { return {base.a - x.a, base.b, base.c + x.c}; }
  friend CLEAVE_INLINE Row operator+(Row x, Row y) { return {x.a + y.a, x.b + y.b, x.c + y.c}; }
  friend CLEAVE_INLINE Row operator-(Row x, Row y) { return {x.a - y.a, x.b - y.b, x.c - y.c}; }
  friend CLEAVE_INLINE Row operator*(Row x, Row y) { return {x.a * y.a, x.b * y.b, x.c * y.c}; }
  friend CLEAVE_INLINE Row operator*(T k, Row y) { return {k * y.a, k * y.b, k * y.c}; }
  /// k y + z
  static CLEAVE_INLINE Row multiply_add(T k, Row y, Row z) { return {k * y.a + z.a, k * y.b + z.b, k * y.c + z.c}; }
  /// k y - z
  static CLEAVE_INLINE Row multiply_subtract(T k, Row y, Row z) { return {k * y.a - z.a, k * y.b - z.b, k * y.c - z.c}; }
  /// Keeps the compiler from computing a shared product anew for every use.
  CLEAVE_INLINE void pin() {}
  /// Sums over the three nodes, with weights w: out[0..3] = sum w v, out[4..7] = sum w x, out[8..11] = sum w y, and at last
  /// sum w v times the offset of the node.
  static CLEAVE_INLINE void reduce(T* out, Row w, Row v, Row x, Row y) {
    reduce(out, w, v, x);
    store_quad<T>(out + 12, load_quad(out + 8));
    store_quad<T>(out + 8, w.a * y.a + w.b * y.b + w.c * y.c);
  }
  /// The same without y.
  static CLEAVE_INLINE void reduce(T* out, Row w, Row v, Row x) {
    const Quad<T> low = w.a * v.a, high = w.c * v.c;
    store_quad<T>(out, low + w.b * v.b + high);
    store_quad<T>(out + 4, w.a * x.a + w.b * x.b + w.c * x.c);
    store_quad<T>(out + 8, high - low);
  }
};

#if CLEAVE_REGISTER_BYTES == 32
/// A register of two nodes and half a register of the third.
template <>
struct Row<float> {
  __m256 r;
  __m128 s;

  static CLEAVE_INLINE Row zero() { return {_mm256_setzero_ps(), _mm_setzero_ps()}; }
  static CLEAVE_INLINE Row load(const float* p) { return {_mm256_loadu_ps(p), _mm_load_ps(p + 8)}; }
  CLEAVE_INLINE void store(float* p) const {
    _mm256_storeu_ps(p, r);
    _mm_store_ps(p + 8, s);
  }
  static CLEAVE_INLINE Row all(float k) {
    const __m256 x = _mm256_set1_ps(k);
    return {x, _mm256_castps256_ps128(x)};
  }
  static CLEAVE_INLINE Row repeat(const float* p) {
    const __m128 v = _mm_load_ps(p);
    return {_mm256_set_m128(v, v), v};
  }
  static CLEAVE_INLINE Row weights(const float* w, int step) {
    return {_mm256_set_m128(_mm_broadcast_ss(w + step), _mm_broadcast_ss(w)), _mm_broadcast_ss(w + 2 * step)};
  }
  static CLEAVE_INLINE Row add_offset(Row x, Row base) {
    return {_mm256_blend_ps(base.r, _mm256_sub_ps(base.r, x.r), 0x0f), _mm_add_ps(base.s, x.s)};
  }
  friend CLEAVE_INLINE Row operator+(Row x, Row y) { return {x.r + y.r, x.s + y.s}; }
  friend CLEAVE_INLINE Row operator-(Row x, Row y) { return {x.r - y.r, x.s - y.s}; }
  friend CLEAVE_INLINE Row operator*(Row x, Row y) { return {x.r * y.r, x.s * y.s}; }
  friend CLEAVE_INLINE Row operator*(float k, Row y) { return all(k) * y; }
  static CLEAVE_INLINE Row multiply_add(float k, Row y, Row z) { return multiply_add(all(k), y, z); }
  static CLEAVE_INLINE Row multiply_add(Row x, Row y, Row z) {
    return {_mm256_fmadd_ps(x.r, y.r, z.r), _mm_fmadd_ps(x.s, y.s, z.s)};
  }
  static CLEAVE_INLINE Row multiply_subtract(float k, Row y, Row z) {
    const Row x = all(k);
    return {_mm256_fmsub_ps(x.r, y.r, z.r), _mm_fmsub_ps(x.s, y.s, z.s)};
  }
  CLEAVE_INLINE void pin() {}
  static CLEAVE_INLINE __m128 low(__m256 x) { return _mm256_castps256_ps128(x); }
  static CLEAVE_INLINE void reduce_one(float* out, Row w, Row v) {
    const __m256 r = w.r * v.r;
    _mm_store_ps(out, _mm_fmadd_ps(w.s, v.s, _mm_add_ps(low(r), _mm256_extractf128_ps(r, 1))));
  }
  static CLEAVE_INLINE void reduce_offset(float* out, Row w, Row v) {
    _mm_store_ps(out, _mm_fmsub_ps(w.s, v.s, _mm_mul_ps(low(w.r), low(v.r))));
  }
  static CLEAVE_INLINE void reduce(float* out, Row w, Row v, Row x, Row y) {
    reduce_one(out, w, v);
    reduce_one(out + 4, w, x);
    reduce_one(out + 8, w, y);
    reduce_offset(out + 12, w, v);
  }
  static CLEAVE_INLINE void reduce(float* out, Row w, Row v, Row x) {
    reduce_one(out, w, v);
    reduce_one(out + 4, w, x);
    reduce_offset(out + 8, w, v);
  }
};
#endif

#if CLEAVE_REGISTER_BYTES == 64
/// One 512-bit register; the fourth quarter has weight zero and is otherwise carried along.
template <>
struct Row<float> {
  __m512 r;

  static CLEAVE_INLINE Row zero() { return {_mm512_setzero_ps()}; }
  static CLEAVE_INLINE Row load(const float* p) { return {_mm512_loadu_ps(p)}; }
  CLEAVE_INLINE void store(float* p) const { _mm512_storeu_ps(p, r); }
  static CLEAVE_INLINE Row repeat(const float* p) { return {_mm512_broadcast_f32x4(_mm_load_ps(p))}; }
  static CLEAVE_INLINE Row weights(const float* w, int step) {
    __m512 x = _mm512_maskz_broadcastss_ps(0x000f, _mm_load_ss(w));
    x = _mm512_mask_broadcastss_ps(x, 0x00f0, _mm_load_ss(w + step));
    return {_mm512_mask_broadcastss_ps(x, 0x0f00, _mm_load_ss(w + 2 * step))};
  }
  static CLEAVE_INLINE Row offsets() { return {_mm512_setr_ps(-1, -1, -1, -1, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0)}; }
  static CLEAVE_INLINE Row add_offset(Row x, Row base) { return {_mm512_fmadd_ps(x.r, offsets().r, base.r)}; }
  friend CLEAVE_INLINE Row operator+(Row x, Row y) { return {_mm512_add_ps(x.r, y.r)}; }
  friend CLEAVE_INLINE Row operator-(Row x, Row y) { return {_mm512_sub_ps(x.r, y.r)}; }
  friend CLEAVE_INLINE Row operator*(Row x, Row y) { return {_mm512_mul_ps(x.r, y.r)}; }
  friend CLEAVE_INLINE Row operator*(float s, Row y) { return {_mm512_mul_ps(_mm512_set1_ps(s), y.r)}; }
  static CLEAVE_INLINE Row multiply_add(float s, Row y, Row z) { return {_mm512_fmadd_ps(_mm512_set1_ps(s), y.r, z.r)}; }
  static CLEAVE_INLINE Row multiply_subtract(float s, Row y, Row z) { return {_mm512_fmsub_ps(_mm512_set1_ps(s), y.r, z.r)}; }
  CLEAVE_INLINE void pin() { asm("" : "+v"(r)); }
  static CLEAVE_INLINE void sums(float* out, Row v, Row x, Row y, Row z) {
    const __m512 t0 = _mm512_add_ps(_mm512_shuffle_f32x4(v.r, x.r, 0x44), _mm512_shuffle_f32x4(v.r, x.r, 0xEE));
    const __m512 t1 = _mm512_add_ps(_mm512_shuffle_f32x4(y.r, z.r, 0x44), _mm512_shuffle_f32x4(y.r, z.r, 0xEE));
    _mm512_store_ps(out, _mm512_add_ps(_mm512_shuffle_f32x4(t0, t1, 0x88), _mm512_shuffle_f32x4(t0, t1, 0xDD)));
  }
  static CLEAVE_INLINE void reduce(float* out, Row w, Row v, Row x, Row y) {
    const Row value = w * v;
    sums(out, value, w * x, w * y, value * offsets());
  }
  static CLEAVE_INLINE void reduce(float* out, Row w, Row v, Row x) {
    const Row value = w * v;
    sums(out, value, w * x, value * offsets(), zero());
  }
};

template <>
struct Row<double> {
  __m512d r;
  __m256d s;

  static CLEAVE_INLINE Row zero() { return {_mm512_setzero_pd(), _mm256_setzero_pd()}; }
  static CLEAVE_INLINE Row load(const double* p) { return {_mm512_loadu_pd(p), _mm256_load_pd(p + 8)}; }
  CLEAVE_INLINE void store(double* p) const {
    _mm512_storeu_pd(p, r);
    _mm256_store_pd(p + 8, s);
  }
  static CLEAVE_INLINE Row repeat(const double* p) {
    const __m256d v = _mm256_load_pd(p);
    return {_mm512_broadcast_f64x4(v), v};
  }
  static CLEAVE_INLINE Row weights(const double* w, int step) {
    return {_mm512_mask_broadcastsd_pd(_mm512_set1_pd(w[0]), 0xf0, _mm_load_sd(w + step)), _mm256_set1_pd(w[2 * step])};
  }
  static CLEAVE_INLINE Row add_offset(Row x, Row base) {
    return {_mm512_mask_sub_pd(base.r, 0x0f, base.r, x.r), _mm256_add_pd(base.s, x.s)};
  }
  friend CLEAVE_INLINE Row operator+(Row x, Row y) { return {x.r + y.r, x.s + y.s}; }
  friend CLEAVE_INLINE Row operator-(Row x, Row y) { return {x.r - y.r, x.s - y.s}; }
  friend CLEAVE_INLINE Row operator*(Row x, Row y) { return {x.r * y.r, x.s * y.s}; }
  friend CLEAVE_INLINE Row operator*(double k, Row y) { return {_mm512_set1_pd(k) * y.r, _mm256_set1_pd(k) * y.s}; }
  static CLEAVE_INLINE Row multiply_add(double k, Row y, Row z) {
    return {_mm512_fmadd_pd(_mm512_set1_pd(k), y.r, z.r), _mm256_fmadd_pd(_mm256_set1_pd(k), y.s, z.s)};
  }
  static CLEAVE_INLINE Row multiply_subtract(double k, Row y, Row z) {
    return {_mm512_fmsub_pd(_mm512_set1_pd(k), y.r, z.r), _mm256_fmsub_pd(_mm256_set1_pd(k), y.s, z.s)};
  }
  CLEAVE_INLINE void pin() { asm("" : "+v"(r), "+v"(s)); }
  static CLEAVE_INLINE __m256d low(__m512d x) { return _mm512_castpd512_pd256(x); }
  static CLEAVE_INLINE void reduce_one(double* out, Row w, Row v) {
    const __m512d r = w.r * v.r;
    _mm256_store_pd(out, _mm256_fmadd_pd(w.s, v.s, _mm256_add_pd(low(r), _mm512_extractf64x4_pd(r, 1))));
  }
  static CLEAVE_INLINE void reduce_offset(double* out, Row w, Row v) {
    _mm256_store_pd(out, _mm256_fmsub_pd(w.s, v.s, _mm256_mul_pd(low(w.r), low(v.r))));
  }
  static CLEAVE_INLINE void reduce(double* out, Row w, Row v, Row x, Row y) {
    reduce_one(out, w, v);
    reduce_one(out + 4, w, x);
    reduce_one(out + 8, w, y);
    reduce_offset(out + 12, w, v);
  }
  static CLEAVE_INLINE void reduce(double* out, Row w, Row v, Row x) {
    reduce_one(out, w, v);
    reduce_one(out + 4, w, x);
    reduce_offset(out + 8, w, v);
  }
};
#endif

}  // namespace cleave::mpm::kernel
