/// Lanes<S>: as many numbers of type S (float or double) as one vector register holds, with the arithmetic of one number.
///
/// A formula written once as `template <class T>` runs on T = float, double, Lanes<float>, Lanes<double> and Dual<...>.
/// It may use + - * /, comparisons, and the free functions select, any, all, none, min, max, abs, sqrt, rsqrt, floor, fma,
/// copysign declared here and those of <cleave/math.hpp>. Branches become `select(mask, a, b)`: both sides are evaluated.
///
/// The width is fixed by the instruction set the translation unit is compiled for: 64 bytes with AVX-512 (F, VL, DQ),
/// 32 with AVX, 16 otherwise. Code for different instruction sets belongs into different shared objects.
#ifndef CLEAVE_LANES_HPP
#define CLEAVE_LANES_HPP

#include <cmath>
#include <concepts>
#include <cstdint>
#include <type_traits>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

/// CLEAVE_INLINE: always inlined, so that lanes stay in registers. CLEAVE_FLATTEN: a function into which all calls are inlined.
/// Not under a sanitizer, whose instrumentation of functions of that size takes compilers many minutes.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define CLEAVE_INLINE inline
#define CLEAVE_FLATTEN
#else
#define CLEAVE_INLINE __attribute__((always_inline)) inline
#define CLEAVE_FLATTEN __attribute__((flatten))
#endif

#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512DQ__)
#define CLEAVE_LANE_BYTES 64
#elif defined(__AVX__)
#define CLEAVE_LANE_BYTES 32
#else
#define CLEAVE_LANE_BYTES 16
#endif

namespace cleave {

template <class A>
concept Arithmetic = std::is_arithmetic_v<A>;

namespace detail {

typedef float FloatVector __attribute__((vector_size(CLEAVE_LANE_BYTES)));
typedef double DoubleVector __attribute__((vector_size(CLEAVE_LANE_BYTES)));
typedef std::int32_t Int32Vector __attribute__((vector_size(CLEAVE_LANE_BYTES)));
typedef std::int64_t Int64Vector __attribute__((vector_size(CLEAVE_LANE_BYTES)));
typedef std::uint32_t Uint32Vector __attribute__((vector_size(CLEAVE_LANE_BYTES)));
typedef std::uint64_t Uint64Vector __attribute__((vector_size(CLEAVE_LANE_BYTES)));

/// Register<S>: the vector types for S and the instructions that differ between instruction sets. Masks are one bit per
/// lane with AVX-512 and all-ones or all-zeros integers elsewhere. (The maskz forms do what the plain ones do; g++ 12 calls
/// the plain ones a use of an uninitialized value.)
template <class S>
struct Register;

#if CLEAVE_LANE_BYTES == 64

template <>
struct Register<float> {
  using Vector = FloatVector;
  using Integer = Int32Vector;
  using Unsigned = Uint32Vector;
  using Mask = __mmask16;
  static constexpr unsigned all_bits = 0xffffu;

  static CLEAVE_INLINE Mask less(Vector a, Vector b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
  static CLEAVE_INLINE Mask less_equal(Vector a, Vector b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
  static CLEAVE_INLINE Mask equal(Vector a, Vector b) { return _mm512_cmp_ps_mask(a, b, _CMP_EQ_OQ); }
  static CLEAVE_INLINE Mask unequal(Vector a, Vector b) { return _mm512_cmp_ps_mask(a, b, _CMP_NEQ_UQ); }
  static CLEAVE_INLINE Vector select(Mask m, Vector a, Vector b) { return _mm512_mask_blend_ps(m, b, a); }
  static CLEAVE_INLINE Mask mask_from_bits(unsigned bits) { return static_cast<Mask>(bits); }
  static CLEAVE_INLINE unsigned bits(Mask m) { return m; }

  static CLEAVE_INLINE Vector min(Vector a, Vector b) { return _mm512_maskz_min_ps(0xffff, b, a); }
  static CLEAVE_INLINE Vector max(Vector a, Vector b) { return _mm512_maskz_max_ps(0xffff, b, a); }
  static CLEAVE_INLINE Vector sqrt(Vector a) { return _mm512_maskz_sqrt_ps(0xffff, a); }
  static CLEAVE_INLINE Vector floor(Vector a) {
    return _mm512_maskz_roundscale_ps(0xffff, a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
  }
  static CLEAVE_INLINE Vector fma(Vector a, Vector b, Vector c) { return _mm512_fmadd_ps(a, b, c); }
  /// 14 bits, and one Newton step. At 0, infinity, negative numbers and NaN the estimate is already the answer.
  static CLEAVE_INLINE Vector rsqrt(Vector a) {
    const Vector y = _mm512_maskz_rsqrt14_ps(0xffff, a);
    const Vector e = fma(-(a * y), y, Vector{} + 1.0f);
    return select(equal(e, e), fma(y * 0.5f, e, y), y);
  }
};

template <>
struct Register<double> {
  using Vector = DoubleVector;
  using Integer = Int64Vector;
  using Unsigned = Uint64Vector;
  using Mask = __mmask8;
  static constexpr unsigned all_bits = 0xffu;

  static CLEAVE_INLINE Mask less(Vector a, Vector b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
  static CLEAVE_INLINE Mask less_equal(Vector a, Vector b) { return _mm512_cmp_pd_mask(a, b, _CMP_LE_OQ); }
  static CLEAVE_INLINE Mask equal(Vector a, Vector b) { return _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ); }
  static CLEAVE_INLINE Mask unequal(Vector a, Vector b) { return _mm512_cmp_pd_mask(a, b, _CMP_NEQ_UQ); }
  static CLEAVE_INLINE Vector select(Mask m, Vector a, Vector b) { return _mm512_mask_blend_pd(m, b, a); }
  static CLEAVE_INLINE Mask mask_from_bits(unsigned bits) { return static_cast<Mask>(bits); }
  static CLEAVE_INLINE unsigned bits(Mask m) { return m; }

  static CLEAVE_INLINE Vector min(Vector a, Vector b) { return _mm512_maskz_min_pd(0xff, b, a); }
  static CLEAVE_INLINE Vector max(Vector a, Vector b) { return _mm512_maskz_max_pd(0xff, b, a); }
  static CLEAVE_INLINE Vector sqrt(Vector a) { return _mm512_maskz_sqrt_pd(0xff, a); }
  static CLEAVE_INLINE Vector floor(Vector a) {
    return _mm512_maskz_roundscale_pd(0xff, a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
  }
  static CLEAVE_INLINE Vector fma(Vector a, Vector b, Vector c) { return _mm512_fmadd_pd(a, b, c); }
  /// 14 bits, then a third-order and a Newton step.
  static CLEAVE_INLINE Vector rsqrt(Vector a) {
    const Vector y0 = _mm512_maskz_rsqrt14_pd(0xff, a);
    const Vector one = Vector{} + 1.0;
    const Vector e0 = fma(-(a * y0), y0, one);
    const Vector y1 = fma(y0 * e0, fma(e0, Vector{} + 0.375, Vector{} + 0.5), y0);
    const Vector e1 = fma(-(a * y1), y1, one);
    return select(equal(e1, e1), fma(y1 * 0.5, e1, y1), y0);
  }
};

#else

/// What the compiler's own vector arithmetic gives on every machine.
template <class S, class V, class I, class U>
struct PortableRegister {
  using Vector = V;
  using Integer = I;
  using Unsigned = U;
  using Mask = I;
  static constexpr int width = CLEAVE_LANE_BYTES / sizeof(S);
  static constexpr unsigned all_bits = (1u << width) - 1u;

  static CLEAVE_INLINE Mask less(V a, V b) { return reinterpret_cast<Mask>(a < b); }
  static CLEAVE_INLINE Mask less_equal(V a, V b) { return reinterpret_cast<Mask>(a <= b); }
  static CLEAVE_INLINE Mask equal(V a, V b) { return reinterpret_cast<Mask>(a == b); }
  static CLEAVE_INLINE Mask unequal(V a, V b) { return reinterpret_cast<Mask>(a != b); }
  static CLEAVE_INLINE V select(Mask m, V a, V b) { return m ? a : b; }
  static CLEAVE_INLINE Mask mask_from_bits(unsigned bits) {
    Mask m;
    for (int i = 0; i < width; ++i) m[i] = (bits >> i) & 1u ? -1 : 0;
    return m;
  }
  static CLEAVE_INLINE unsigned bits(Mask m) {
    unsigned b = 0;
    for (int i = 0; i < width; ++i) b |= (m[i] != 0 ? 1u : 0u) << i;
    return b;
  }
  static CLEAVE_INLINE V min(V a, V b) { return b < a ? b : a; }
  static CLEAVE_INLINE V max(V a, V b) { return a < b ? b : a; }
  static CLEAVE_INLINE V sqrt(V a) {
    for (int i = 0; i < width; ++i) a[i] = std::sqrt(a[i]);
    return a;
  }
  /// Numbers beyond 1/epsilon have no fraction; below, adding and subtracting 1/epsilon rounds to the nearest integer.
  static CLEAVE_INLINE V floor(V a) {
    constexpr S no_fraction = sizeof(S) == 4 ? S(8388608) : S(4503599627370496);
    const V magnitude = reinterpret_cast<V>(reinterpret_cast<I>(a) & ~reinterpret_cast<I>(-V{}));
    const V rounded = (magnitude + no_fraction) - no_fraction;
    const V with_sign =
        reinterpret_cast<V>(reinterpret_cast<I>(rounded) | (reinterpret_cast<I>(a) & reinterpret_cast<I>(-V{})));
    const V lowered = with_sign > a ? with_sign - S(1) : with_sign;
    return magnitude < no_fraction ? lowered : a;
  }
  static CLEAVE_INLINE V fma(V a, V b, V c) { return a * b + c; }
};

#if CLEAVE_LANE_BYTES == 32

template <>
struct Register<float> : PortableRegister<float, FloatVector, Int32Vector, Uint32Vector> {
  static CLEAVE_INLINE unsigned bits(Mask m) {
    return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<FloatVector>(m)));
  }
  static CLEAVE_INLINE Vector min(Vector a, Vector b) { return _mm256_min_ps(b, a); }
  static CLEAVE_INLINE Vector max(Vector a, Vector b) { return _mm256_max_ps(b, a); }
  static CLEAVE_INLINE Vector sqrt(Vector a) { return _mm256_sqrt_ps(a); }
  static CLEAVE_INLINE Vector floor(Vector a) { return _mm256_floor_ps(a); }
#if defined(__FMA__)
  static CLEAVE_INLINE Vector fma(Vector a, Vector b, Vector c) { return _mm256_fmadd_ps(a, b, c); }
#endif
  static CLEAVE_INLINE Vector rsqrt(Vector a) { return 1.0f / sqrt(a); }
};

template <>
struct Register<double> : PortableRegister<double, DoubleVector, Int64Vector, Uint64Vector> {
  static CLEAVE_INLINE unsigned bits(Mask m) {
    return static_cast<unsigned>(_mm256_movemask_pd(reinterpret_cast<DoubleVector>(m)));
  }
  static CLEAVE_INLINE Vector min(Vector a, Vector b) { return _mm256_min_pd(b, a); }
  static CLEAVE_INLINE Vector max(Vector a, Vector b) { return _mm256_max_pd(b, a); }
  static CLEAVE_INLINE Vector sqrt(Vector a) { return _mm256_sqrt_pd(a); }
  static CLEAVE_INLINE Vector floor(Vector a) { return _mm256_floor_pd(a); }
#if defined(__FMA__)
  static CLEAVE_INLINE Vector fma(Vector a, Vector b, Vector c) { return _mm256_fmadd_pd(a, b, c); }
#endif
  static CLEAVE_INLINE Vector rsqrt(Vector a) { return 1.0 / sqrt(a); }
};

#else

template <>
struct Register<float> : PortableRegister<float, FloatVector, Int32Vector, Uint32Vector> {
#if defined(__SSE2__)
  static CLEAVE_INLINE unsigned bits(Mask m) {
    return static_cast<unsigned>(_mm_movemask_ps(reinterpret_cast<FloatVector>(m)));
  }
  static CLEAVE_INLINE Vector min(Vector a, Vector b) { return _mm_min_ps(b, a); }
  static CLEAVE_INLINE Vector max(Vector a, Vector b) { return _mm_max_ps(b, a); }
  static CLEAVE_INLINE Vector sqrt(Vector a) { return _mm_sqrt_ps(a); }
#endif
#if defined(__SSE4_1__)
  static CLEAVE_INLINE Vector floor(Vector a) { return _mm_floor_ps(a); }
#endif
  static CLEAVE_INLINE Vector rsqrt(Vector a) { return 1.0f / sqrt(a); }
};

template <>
struct Register<double> : PortableRegister<double, DoubleVector, Int64Vector, Uint64Vector> {
#if defined(__SSE2__)
  static CLEAVE_INLINE unsigned bits(Mask m) {
    return static_cast<unsigned>(_mm_movemask_pd(reinterpret_cast<DoubleVector>(m)));
  }
  static CLEAVE_INLINE Vector min(Vector a, Vector b) { return _mm_min_pd(b, a); }
  static CLEAVE_INLINE Vector max(Vector a, Vector b) { return _mm_max_pd(b, a); }
  static CLEAVE_INLINE Vector sqrt(Vector a) { return _mm_sqrt_pd(a); }
#endif
#if defined(__SSE4_1__)
  static CLEAVE_INLINE Vector floor(Vector a) { return _mm_floor_pd(a); }
#endif
  static CLEAVE_INLINE Vector rsqrt(Vector a) { return 1.0 / sqrt(a); }
};

#endif
#endif

}  // namespace detail

template <class S>
struct Lanes;

/// One truth value per lane: the result of comparing Lanes<S>. Combine with && || ! (or & | ^), reduce with any, all, none.
/// Formulas that also run on plain numbers should use && and ||: compilers warn of & between two bools.
template <class S>
struct LaneMask {
  using Register = detail::Register<S>;
  static constexpr int width = CLEAVE_LANE_BYTES / sizeof(S);

  typename Register::Mask native;

  LaneMask() = default;
  CLEAVE_INLINE LaneMask(bool everywhere) : native(Register::mask_from_bits(everywhere ? Register::all_bits : 0u)) {}
  explicit CLEAVE_INLINE LaneMask(typename Register::Mask m) requires(!std::is_same_v<typename Register::Mask, bool>)
      : native(m) {}

  /// Lane i is bit i.
  static CLEAVE_INLINE LaneMask from_bits(unsigned bits) { return LaneMask(Register::mask_from_bits(bits)); }
  /// True in lanes 0 .. count-1.
  static CLEAVE_INLINE LaneMask first(int count) {
    return from_bits(count >= width ? Register::all_bits : (1u << (count < 0 ? 0 : count)) - 1u);
  }
  CLEAVE_INLINE unsigned bits() const { return Register::bits(native); }
  CLEAVE_INLINE bool operator[](int lane) const { return (bits() >> lane) & 1u; }

  friend CLEAVE_INLINE LaneMask operator&(LaneMask a, LaneMask b) {
    return LaneMask(static_cast<typename Register::Mask>(a.native & b.native));
  }
  friend CLEAVE_INLINE LaneMask operator|(LaneMask a, LaneMask b) {
    return LaneMask(static_cast<typename Register::Mask>(a.native | b.native));
  }
  friend CLEAVE_INLINE LaneMask operator^(LaneMask a, LaneMask b) {
    return LaneMask(static_cast<typename Register::Mask>(a.native ^ b.native));
  }
  friend CLEAVE_INLINE LaneMask operator!(LaneMask a) { return LaneMask(static_cast<typename Register::Mask>(~a.native)); }
  /// Both sides are evaluated, as always on lanes.
  friend CLEAVE_INLINE LaneMask operator&&(LaneMask a, LaneMask b) { return a & b; }
  friend CLEAVE_INLINE LaneMask operator||(LaneMask a, LaneMask b) { return a | b; }
  CLEAVE_INLINE LaneMask& operator&=(LaneMask b) { return *this = *this & b; }
  CLEAVE_INLINE LaneMask& operator|=(LaneMask b) { return *this = *this | b; }

  friend CLEAVE_INLINE bool any(LaneMask m) { return m.bits() != 0; }
  friend CLEAVE_INLINE bool all(LaneMask m) { return m.bits() == Register::all_bits; }
  friend CLEAVE_INLINE bool none(LaneMask m) { return m.bits() == 0; }

  /// a where the mask holds, b elsewhere; either may be a plain number.
  friend CLEAVE_INLINE Lanes<S> select(LaneMask m, Lanes<S> a, Lanes<S> b) {
    return Lanes<S>(Register::select(m.native, a.native, b.native));
  }
};

template <class S>
struct Lanes {
  static_assert(std::is_same_v<S, float> || std::is_same_v<S, double>);
  using Scalar = S;
  using Mask = LaneMask<S>;
  using Register = detail::Register<S>;
  using Vector = typename Register::Vector;
  using Integer = typename Register::Integer;
  static constexpr int width = CLEAVE_LANE_BYTES / sizeof(S);

  Vector native;

  Lanes() = default;
  /// The same number in every lane.
  template <Arithmetic A>
  CLEAVE_INLINE Lanes(A everywhere) : native(static_cast<S>(everywhere) - Vector{}) {}
  explicit CLEAVE_INLINE Lanes(Vector v) : native(v) {}

  /// [address] aligned to the register size.
  static CLEAVE_INLINE Lanes load(const S* address) {
    Lanes x;
    __builtin_memcpy(&x.native, __builtin_assume_aligned(address, CLEAVE_LANE_BYTES), sizeof(Vector));
    return x;
  }
  static CLEAVE_INLINE Lanes load_unaligned(const S* address) {
    Lanes x;
    __builtin_memcpy(&x.native, address, sizeof(Vector));
    return x;
  }
  /// Lanes 0 .. count-1 from memory, `otherwise` in the rest; reads nothing beyond address[count-1].
  static CLEAVE_INLINE Lanes load_first(const S* address, int count, S otherwise) {
    Lanes x(otherwise);
    for (int i = 0; i < count && i < width; ++i) x.native[i] = address[i];
    return x;
  }
  /// [address] aligned to the register size.
  CLEAVE_INLINE void store(S* address) const {
    __builtin_memcpy(__builtin_assume_aligned(address, CLEAVE_LANE_BYTES), &native, sizeof(Vector));
  }
  CLEAVE_INLINE void store_unaligned(S* address) const { __builtin_memcpy(address, &native, sizeof(Vector)); }
  /// Writes nothing beyond address[count-1].
  CLEAVE_INLINE void store_first(S* address, int count) const {
    for (int i = 0; i < count && i < width; ++i) address[i] = native[i];
  }
  CLEAVE_INLINE S operator[](int lane) const { return native[lane]; }
  CLEAVE_INLINE void set(int lane, S value) { native[lane] = value; }

  friend CLEAVE_INLINE Lanes operator+(Lanes a, Lanes b) { return Lanes(a.native + b.native); }
  friend CLEAVE_INLINE Lanes operator-(Lanes a, Lanes b) { return Lanes(a.native - b.native); }
  friend CLEAVE_INLINE Lanes operator*(Lanes a, Lanes b) { return Lanes(a.native * b.native); }
  friend CLEAVE_INLINE Lanes operator/(Lanes a, Lanes b) { return Lanes(a.native / b.native); }
  friend CLEAVE_INLINE Lanes operator+(Lanes a) { return a; }
  friend CLEAVE_INLINE Lanes operator-(Lanes a) { return Lanes(-a.native); }
  CLEAVE_INLINE Lanes& operator+=(Lanes b) { return *this = *this + b; }
  CLEAVE_INLINE Lanes& operator-=(Lanes b) { return *this = *this - b; }
  CLEAVE_INLINE Lanes& operator*=(Lanes b) { return *this = *this * b; }
  CLEAVE_INLINE Lanes& operator/=(Lanes b) { return *this = *this / b; }

  friend CLEAVE_INLINE Mask operator<(Lanes a, Lanes b) { return Mask(Register::less(a.native, b.native)); }
  friend CLEAVE_INLINE Mask operator<=(Lanes a, Lanes b) { return Mask(Register::less_equal(a.native, b.native)); }
  friend CLEAVE_INLINE Mask operator>(Lanes a, Lanes b) { return Mask(Register::less(b.native, a.native)); }
  friend CLEAVE_INLINE Mask operator>=(Lanes a, Lanes b) { return Mask(Register::less_equal(b.native, a.native)); }
  friend CLEAVE_INLINE Mask operator==(Lanes a, Lanes b) { return Mask(Register::equal(a.native, b.native)); }
  friend CLEAVE_INLINE Mask operator!=(Lanes a, Lanes b) { return Mask(Register::unequal(a.native, b.native)); }

  /// As std::min and std::max: the first argument if the two do not compare.
  friend CLEAVE_INLINE Lanes min(Lanes a, Lanes b) { return Lanes(Register::min(a.native, b.native)); }
  friend CLEAVE_INLINE Lanes max(Lanes a, Lanes b) { return Lanes(Register::max(a.native, b.native)); }
  friend CLEAVE_INLINE Lanes sqrt(Lanes a) { return Lanes(Register::sqrt(a.native)); }
  /// 1 / sqrt(a) to about one unit in the last place; infinity at 0.
  friend CLEAVE_INLINE Lanes rsqrt(Lanes a) { return Lanes(Register::rsqrt(a.native)); }
  friend CLEAVE_INLINE Lanes floor(Lanes a) { return Lanes(Register::floor(a.native)); }
  /// a b + c, rounded once where the machine can.
  friend CLEAVE_INLINE Lanes fma(Lanes a, Lanes b, Lanes c) { return Lanes(Register::fma(a.native, b.native, c.native)); }
  friend CLEAVE_INLINE Lanes abs(Lanes a) {
    return Lanes(reinterpret_cast<Vector>(reinterpret_cast<Integer>(a.native) & ~sign_bit()));
  }
  /// The magnitude of a with the sign of b.
  friend CLEAVE_INLINE Lanes copysign(Lanes a, Lanes b) {
    return Lanes(reinterpret_cast<Vector>((reinterpret_cast<Integer>(a.native) & ~sign_bit()) |
                                          (reinterpret_cast<Integer>(b.native) & sign_bit())));
  }

 private:
  static CLEAVE_INLINE Integer sign_bit() { return reinterpret_cast<Integer>(-Vector{}); }
};

/// scalar_of<T>: the floating-point type underneath a number, lanes or duals. mask_of<T>: what comparing two T gives.
namespace detail {
template <class T>
struct NumberTraits;
template <std::floating_point S>
struct NumberTraits<S> {
  using Scalar = S;
  using Mask = bool;
};
template <class S>
struct NumberTraits<Lanes<S>> {
  using Scalar = S;
  using Mask = LaneMask<S>;
};
}  // namespace detail
template <class T>
using scalar_of = typename detail::NumberTraits<T>::Scalar;
template <class T>
using mask_of = typename detail::NumberTraits<T>::Mask;

/// What the formulas accept: a floating-point number, Lanes or Dual.
template <class T>
concept Number = requires {
  typename detail::NumberTraits<T>::Scalar;
};

/// The same vocabulary for plain numbers. A mask is a bool (or the int that & and | of two bools give).
template <std::integral M>
CLEAVE_INLINE bool any(M m) {
  return m != 0;
}
template <std::integral M>
CLEAVE_INLINE bool all(M m) {
  return m != 0;
}
template <std::integral M>
CLEAVE_INLINE bool none(M m) {
  return m == 0;
}
template <Arithmetic A, Arithmetic B>
CLEAVE_INLINE std::common_type_t<A, B> select(bool m, A a, B b) {
  using C = std::common_type_t<A, B>;
  return m ? static_cast<C>(a) : static_cast<C>(b);
}
template <Arithmetic A, Arithmetic B>
CLEAVE_INLINE std::common_type_t<A, B> min(A a, B b) {
  const std::common_type_t<A, B> x = a, y = b;
  return y < x ? y : x;
}
template <Arithmetic A, Arithmetic B>
CLEAVE_INLINE std::common_type_t<A, B> max(A a, B b) {
  const std::common_type_t<A, B> x = a, y = b;
  return x < y ? y : x;
}
template <std::floating_point S>
CLEAVE_INLINE S abs(S a) {
  return std::fabs(a);
}
template <std::floating_point S>
CLEAVE_INLINE S sqrt(S a) {
  return std::sqrt(a);
}
template <std::floating_point S>
CLEAVE_INLINE S rsqrt(S a) {
  return S(1) / std::sqrt(a);
}
template <std::floating_point S>
CLEAVE_INLINE S floor(S a) {
  return std::floor(a);
}
template <Arithmetic A, Arithmetic B>
CLEAVE_INLINE std::common_type_t<A, B> copysign(A a, B b) {
  using C = std::common_type_t<A, B>;
  return std::copysign(static_cast<C>(a), static_cast<C>(b));
}
template <Arithmetic A, Arithmetic B, Arithmetic C>
CLEAVE_INLINE std::common_type_t<A, B, C> fma(A a, B b, C c) {
  using D = std::common_type_t<A, B, C>;
#if defined(__FMA__)
  return std::fma(static_cast<D>(a), static_cast<D>(b), static_cast<D>(c));
#else
  return static_cast<D>(a) * static_cast<D>(b) + static_cast<D>(c);
#endif
}

}  // namespace cleave

#endif
