/// Four numbers of each of as many neighbours as a register has lanes, turned into four registers.
///
/// Points are named by twice their place, which is what an address of numbers of four bytes multiplies by eight.
/// The numbers of a point lie together, so that a neighbour costs one load; hardware gathers of the four are three times as
/// slow.
#ifndef CLEAVE_PERIDYNAMICS_NEIGHBOUR_LANES_HPP
#define CLEAVE_PERIDYNAMICS_NEIGHBOUR_LANES_HPP

#include <cleave/lanes.hpp>

#include <cstring>

namespace cleave::peridynamics {

template <class S>
struct Four {
  Lanes<S> x, y, z, w;
};

#if CLEAVE_LANE_BYTES == 64

CLEAVE_INLINE Four<float> load_neighbours(const float* points, const std::uint16_t* n) {
  const auto row = [&](int k) { return _mm_loadu_ps(points + 2 * std::size_t(n[k])); };
  const auto rows = [&](int k) {
    __m512 v = _mm512_castps128_ps512(row(k));
    v = _mm512_insertf32x4(v, row(k + 4), 1);
    v = _mm512_insertf32x4(v, row(k + 8), 2);
    return _mm512_insertf32x4(v, row(k + 12), 3);
  };
  const __m512 a = rows(0), b = rows(1), c = rows(2), d = rows(3);
  const auto low = [](__m512 u, __m512 v) { return _mm512_castps_pd(_mm512_maskz_unpacklo_ps(0xffff, u, v)); };
  const auto high = [](__m512 u, __m512 v) { return _mm512_castps_pd(_mm512_maskz_unpackhi_ps(0xffff, u, v)); };
  const __m512d ab_xy = low(a, b), cd_xy = low(c, d), ab_zw = high(a, b), cd_zw = high(c, d);
  const auto lanes = [](__m512d v) { return Lanes<float>(detail::FloatVector(_mm512_castpd_ps(v))); };
  return {lanes(_mm512_maskz_unpacklo_pd(0xff, ab_xy, cd_xy)), lanes(_mm512_maskz_unpackhi_pd(0xff, ab_xy, cd_xy)),
          lanes(_mm512_maskz_unpacklo_pd(0xff, ab_zw, cd_zw)), lanes(_mm512_maskz_unpackhi_pd(0xff, ab_zw, cd_zw))};
}

CLEAVE_INLINE Four<double> load_neighbours(const double* points, const std::uint16_t* n) {
  const auto row = [&](int k) { return _mm256_loadu_pd(points + 2 * std::size_t(n[k])); };
  const auto rows = [&](int k) { return _mm512_maskz_insertf64x4(0xff, _mm512_castpd256_pd512(row(k)), row(k + 4), 1); };
  const __m512d a = rows(0), b = rows(1), c = rows(2), d = rows(3);
  const __m512d ab_xz = _mm512_maskz_unpacklo_pd(0xff, a, b), cd_xz = _mm512_maskz_unpacklo_pd(0xff, c, d);
  const __m512d ab_yw = _mm512_maskz_unpackhi_pd(0xff, a, b), cd_yw = _mm512_maskz_unpackhi_pd(0xff, c, d);
  const __m512i first = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13), second = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
  const auto lanes = [](__m512d u, __m512i order, __m512d v) {
    return Lanes<double>(detail::DoubleVector(_mm512_permutex2var_pd(u, order, v)));
  };
  return {lanes(ab_xz, first, cd_xz), lanes(ab_yw, first, cd_yw), lanes(ab_xz, second, cd_xz), lanes(ab_yw, second, cd_yw)};
}

#elif CLEAVE_LANE_BYTES == 32

CLEAVE_INLINE Four<float> load_neighbours(const float* points, const std::uint16_t* n) {
  const auto row = [&](int k) { return _mm_loadu_ps(points + 2 * std::size_t(n[k])); };
  const auto rows = [&](int k) { return _mm256_insertf128_ps(_mm256_castps128_ps256(row(k)), row(k + 4), 1); };
  const __m256 a = rows(0), b = rows(1), c = rows(2), d = rows(3);
  const auto low = [](__m256 u, __m256 v) { return _mm256_castps_pd(_mm256_unpacklo_ps(u, v)); };
  const auto high = [](__m256 u, __m256 v) { return _mm256_castps_pd(_mm256_unpackhi_ps(u, v)); };
  const __m256d ab_xy = low(a, b), cd_xy = low(c, d), ab_zw = high(a, b), cd_zw = high(c, d);
  const auto lanes = [](__m256d v) { return Lanes<float>(detail::FloatVector(_mm256_castpd_ps(v))); };
  return {lanes(_mm256_unpacklo_pd(ab_xy, cd_xy)), lanes(_mm256_unpackhi_pd(ab_xy, cd_xy)),
          lanes(_mm256_unpacklo_pd(ab_zw, cd_zw)), lanes(_mm256_unpackhi_pd(ab_zw, cd_zw))};
}

CLEAVE_INLINE Four<double> load_neighbours(const double* points, const std::uint16_t* n) {
  const auto row = [&](int k) { return _mm256_loadu_pd(points + 2 * std::size_t(n[k])); };
  const __m256d a = row(0), b = row(1), c = row(2), d = row(3);
  const __m256d ab_xz = _mm256_unpacklo_pd(a, b), cd_xz = _mm256_unpacklo_pd(c, d);
  const __m256d ab_yw = _mm256_unpackhi_pd(a, b), cd_yw = _mm256_unpackhi_pd(c, d);
  const auto lanes = [](__m256d v) { return Lanes<double>(detail::DoubleVector(v)); };
  return {lanes(_mm256_permute2f128_pd(ab_xz, cd_xz, 0x20)), lanes(_mm256_permute2f128_pd(ab_yw, cd_yw, 0x20)),
          lanes(_mm256_permute2f128_pd(ab_xz, cd_xz, 0x31)), lanes(_mm256_permute2f128_pd(ab_yw, cd_yw, 0x31))};
}

#else

template <class S>
CLEAVE_INLINE Four<S> load_neighbours(const S* points, const std::uint16_t* n) {
  Four<S> four;
  for (int k = 0; k < Lanes<S>::width; ++k) {
    const S* row = points + 2 * std::size_t(n[k]);
    four.x.native[k] = row[0];
    four.y.native[k] = row[1];
    four.z.native[k] = row[2];
    four.w.native[k] = row[3];
  }
  return four;
}

#endif

CLEAVE_INLINE Lanes<float> from_integer(detail::Int32Vector i) {
  return Lanes<float>(__builtin_convertvector(i, detail::FloatVector));
}
CLEAVE_INLINE detail::Uint32Vector integer_bits(Lanes<float> x) { return reinterpret_cast<detail::Uint32Vector>(x.native); }

/// As many numbers of 16 bits as there are lanes.
template <class S>
CLEAVE_INLINE Lanes<S> load_small(const std::uint16_t* address) {
  if constexpr (std::is_same_v<S, float>) {
    typedef std::uint16_t Small __attribute__((vector_size(CLEAVE_LANE_BYTES / 2)));
    Small small;
    std::memcpy(&small, address, sizeof small);
#if CLEAVE_LANE_BYTES == 64
    return from_integer(
        reinterpret_cast<detail::Int32Vector>(_mm512_maskz_cvtepu16_epi32(0xffff, reinterpret_cast<__m256i>(small))));
#else
    return Lanes<S>(__builtin_convertvector(__builtin_convertvector(small, detail::Int32Vector), detail::FloatVector));
#endif
  } else {
    typedef std::uint16_t Small __attribute__((vector_size(CLEAVE_LANE_BYTES / 4)));
    Small small;
    std::memcpy(&small, address, sizeof small);
    return Lanes<S>(__builtin_convertvector(__builtin_convertvector(small, detail::Int64Vector), detail::DoubleVector));
  }
}

/// The sum of all lanes, pair by pair.
template <class S>
CLEAVE_INLINE S total(Lanes<S> a) {
  S sum[Lanes<S>::width];
  a.store_unaligned(sum);
  for (int half = Lanes<S>::width / 2; half > 0; half /= 2)
    for (int k = 0; k < half; ++k) sum[k] += sum[k + half];
  return sum[0];
}

/// 1/sqrt(a) for positive a, to about one unit in the last place.
CLEAVE_INLINE Lanes<float> inverse_root(Lanes<float> a) {
#if CLEAVE_LANE_BYTES == 64
  const Lanes<float> y(detail::FloatVector(_mm512_maskz_rsqrt14_ps(0xffff, a.native)));
  return fma(0.5f * y, fma(-(a * y), y, Lanes<float>(1)), y);
#else
  return rsqrt(a);
#endif
}
CLEAVE_INLINE Lanes<double> inverse_root(Lanes<double> a) { return rsqrt(a); }

/// 1/a for positive a, to about one unit in the last place.
CLEAVE_INLINE Lanes<float> reciprocal(Lanes<float> a) {
#if CLEAVE_LANE_BYTES == 64
  const Lanes<float> y(detail::FloatVector(_mm512_maskz_rcp14_ps(0xffff, a.native)));
  return y * (2.0f - a * y);
#else
  return 1.0f / a;
#endif
}
CLEAVE_INLINE Lanes<double> reciprocal(Lanes<double> a) { return 1.0 / a; }

/// Sums of vectors that lose nothing to rounding but the last bits of double: equal and opposite forces stay so.
template <class S>
struct Sum;
template <>
struct Sum<double> {
  Lanes<double> sum = 0;
  CLEAVE_INLINE void add(Lanes<double> a) { sum += a; }
  double all() const { return total(sum); }
};
template <>
struct Sum<float> {
  typedef float Half __attribute__((vector_size(CLEAVE_LANE_BYTES / 2)));
  Lanes<double> low = 0, high = 0;
  static CLEAVE_INLINE Lanes<double> widened(Half half) {
#if CLEAVE_LANE_BYTES == 64
    return Lanes<double>(detail::DoubleVector(_mm512_maskz_cvtps_pd(0xff, half)));
#else
    return Lanes<double>(__builtin_convertvector(half, detail::DoubleVector));
#endif
  }
  CLEAVE_INLINE void add(Lanes<float> a) {
    Half half[2];
    std::memcpy(half, &a.native, sizeof half);
    low += widened(half[0]);
    high += widened(half[1]);
  }
  double all() const { return total(low + high); }
};

}  // namespace cleave::peridynamics

#endif
