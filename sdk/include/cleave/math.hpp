/// Elementary functions of plain numbers and of Lanes: exp, expm1, log, log1p, pow, cbrt, rcbrt, sinh, cosh, asinh, sin, cos,
/// atan2.
///
/// On lanes they are computed with lane arithmetic and integer operations alone, so that a plugin needs no vector math library
/// and gives the same answer wherever it runs with the same instruction set. Error: at most 4 units in the last place over the
/// normal range (most below 2). 0, infinity, NaN and arguments outside the domain give what <cmath> gives. A lane never
/// influences its neighbours. On plain numbers the functions are those of <cmath>.
///
/// Valid with -fno-math-errno and -fno-trapping-math; not with -ffast-math, which takes the liberty to drop the corrections.
#ifndef CLEAVE_MATH_HPP
#define CLEAVE_MATH_HPP

#include <cleave/lanes.hpp>
#include <limits>

namespace cleave {

// ------------------------------------------------------------------ plain numbers

template <std::floating_point S>
CLEAVE_INLINE S exp(S x) {
  return std::exp(x);
}
template <std::floating_point S>
CLEAVE_INLINE S expm1(S x) {
  return std::expm1(x);
}
template <std::floating_point S>
CLEAVE_INLINE S log(S x) {
  return std::log(x);
}
template <std::floating_point S>
CLEAVE_INLINE S log1p(S x) {
  return std::log1p(x);
}
template <Arithmetic A, Arithmetic B>
CLEAVE_INLINE std::common_type_t<A, B> pow(A x, B y) {
  using C = std::common_type_t<A, B>;
  return std::pow(static_cast<C>(x), static_cast<C>(y));
}
template <std::floating_point S>
CLEAVE_INLINE S cbrt(S x) {
  return std::cbrt(x);
}
/// 1 / cbrt(x)
template <std::floating_point S>
CLEAVE_INLINE S rcbrt(S x) {
  return S(1) / std::cbrt(x);
}
template <std::floating_point S>
CLEAVE_INLINE S sinh(S x) {
  return std::sinh(x);
}
template <std::floating_point S>
CLEAVE_INLINE S cosh(S x) {
  return std::cosh(x);
}
template <std::floating_point S>
CLEAVE_INLINE S asinh(S x) {
  return std::asinh(x);
}
template <std::floating_point S>
CLEAVE_INLINE S sin(S x) {
  return std::sin(x);
}
template <std::floating_point S>
CLEAVE_INLINE S cos(S x) {
  return std::cos(x);
}
template <Arithmetic A, Arithmetic B>
CLEAVE_INLINE std::common_type_t<A, B> atan2(A y, B x) {
  using C = std::common_type_t<A, B>;
  return std::atan2(static_cast<C>(y), static_cast<C>(x));
}

// ------------------------------------------------------------------ building blocks on lanes

namespace detail {

/// The binary format of S, and ln 2 split so that a binary exponent times ln2_high is exact.
template <class S>
struct Format;
template <>
struct Format<float> {
  using Bits = std::uint32_t;
  static constexpr int fraction_bits = 23;
  static constexpr int exponent_bias = 127;
  static constexpr Bits one = 0x3f800000u, sqrt_half = 0x3f3504f3u, fraction_mask = 0x007fffffu;
  static constexpr float two_to_fraction = 0x1p23f;
  static constexpr float round_to_integer = 0x1.8p23f;
  static constexpr float ln2_high = 0x1.62e4p-1f, ln2_low = 1.428606820e-06f;
  static constexpr float exp_overflow = 90.0f, exp_underflow = -104.0f;
  static constexpr float subnormal_scale = 0x1p24f, subnormal_exponent = 24.0f, subnormal_cube_root = 0x1p8f;
};
template <>
struct Format<double> {
  using Bits = std::uint64_t;
  static constexpr int fraction_bits = 52;
  static constexpr int exponent_bias = 1023;
  static constexpr Bits one = 0x3ff0000000000000u, sqrt_half = 0x3fe6a09e667f3bcdu, fraction_mask = 0x000fffffffffffffu;
  static constexpr double two_to_fraction = 0x1p52;
  static constexpr double round_to_integer = 0x1.8p52;
  static constexpr double ln2_high = 0x1.62e42fefa2p-1, ln2_low = 0x1.9ef35793c7673p-41;
  static constexpr double exp_overflow = 711.0, exp_underflow = -746.0;
  static constexpr double subnormal_scale = 0x1p54, subnormal_exponent = 54.0, subnormal_cube_root = 0x1p18;
};

template <class S>
inline constexpr S infinity = std::numeric_limits<S>::infinity();
template <class S>
inline constexpr S not_a_number = std::numeric_limits<S>::quiet_NaN();
template <class S>
inline constexpr S smallest_normal = std::numeric_limits<S>::min();

template <class S>
CLEAVE_INLINE typename Register<S>::Unsigned to_bits(Lanes<S> x) {
  return reinterpret_cast<typename Register<S>::Unsigned>(x.native);
}
template <class S>
CLEAVE_INLINE Lanes<S> from_bits(typename Register<S>::Unsigned bits) {
  return Lanes<S>(reinterpret_cast<typename Register<S>::Vector>(bits));
}

/// c0 + c1 x + c2 x^2 + ...
template <class S>
CLEAVE_INLINE Lanes<S> polynomial(Lanes<S>, std::type_identity_t<S> c) {
  return c;
}
template <class S, class... C>
CLEAVE_INLINE Lanes<S> polynomial(Lanes<S> x, std::type_identity_t<S> c0, S c1, C... rest) {
  return fma(polynomial(x, c1, rest...), x, Lanes<S>(c0));
}

/// 2^n for whole n while the result is normal. Adding 1.5 2^fraction_bits leaves n in the low bits of the fraction, from where
/// it is shifted into the exponent.
template <class S>
CLEAVE_INLINE Lanes<S> power_of_two(Lanes<S> n) {
  using F = Format<S>;
  return from_bits<S>((to_bits(n + F::round_to_integer) << F::fraction_bits) + F::one);
}

/// x 2^n for whole n. Two factors, because the result may be subnormal and 2^n beyond the range.
template <class S>
CLEAVE_INLINE Lanes<S> scale_by_power_of_two(Lanes<S> x, Lanes<S> n) {
#if CLEAVE_LANE_BYTES == 64
  if constexpr (std::is_same_v<S, float>)
    return Lanes<S>(_mm512_maskz_scalef_ps(0xffff, x.native, n.native));
  else
    return Lanes<S>(_mm512_maskz_scalef_pd(0xff, x.native, n.native));
#else
  const Lanes<S> half = floor(n * S(0.5));
  return x * power_of_two(half) * power_of_two(n - half);
#endif
}

/// x without the lower 27 bits of its fraction.
CLEAVE_INLINE Lanes<double> leading_half(Lanes<double> x) { return from_bits<double>(to_bits(x) & ~std::uint64_t(0x7ffffff)); }

/// The error in a b = product + error, exact if nothing overflows or underflows.
CLEAVE_INLINE Lanes<double> product_error(Lanes<double> a, Lanes<double> b, Lanes<double> product) {
#if defined(__FMA__)
  return fma(a, b, -product);
#else
  // Halves short enough for their products to be exact.
  const Lanes<double> a1 = leading_half(a), a2 = a - a1, b1 = leading_half(b), b2 = b - b1;
  return ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2;
#endif
}

/// exp(x) = 2^exponent (1 + fraction), |fraction| <= sqrt(2) - 1. `low` is a small addend to x.
template <class S>
struct Exponential {
  Lanes<S> exponent, fraction;
};
template <class S>
CLEAVE_INLINE Exponential<S> exponential(Lanes<S> x, Lanes<S> low = S(0)) {
  using F = Format<S>;
  const Lanes<S> clamped = min(max(x, Lanes<S>(F::exp_underflow)), Lanes<S>(F::exp_overflow));
  const Lanes<S> n = (clamped * S(1.4426950408889634) + F::round_to_integer) - F::round_to_integer;
  const Lanes<S> r = (clamped - n * F::ln2_high) - (n * F::ln2_low - low);
  Lanes<S> q;
  if constexpr (std::is_same_v<S, float>)
    q = polynomial<S>(r, 5.000000013e-01f, 1.666666668e-01f, 4.166646501e-02f, 8.333310934e-03f, 1.393364103e-03f,
                      1.989098087e-04f);
  else
    q = polynomial<S>(r, 5.00000000000000000e-01, 1.66666666666666713e-01, 4.16666666666666713e-02, 8.33333333332614105e-03,
                      1.38888888888837525e-03, 1.98412698748004929e-04, 2.48015873255333634e-05, 2.75572554257464351e-06,
                      2.75572736613486373e-07, 2.51052063739570109e-08, 2.09146793765839349e-09);
  return {n, fma(r * r, q, r)};
}

/// x = 2^exponent (1 + fraction) with 1 + fraction in [sqrt(1/2), sqrt(2)), for positive finite x.
template <class S>
struct Logarithm {
  Lanes<S> exponent, fraction;
};
template <class S>
CLEAVE_INLINE Logarithm<S> binary_exponent(Lanes<S> x) {
  using F = Format<S>;
  const LaneMask<S> subnormal = x < smallest_normal<S>;
  const auto shifted = to_bits(select(subnormal, x * F::subnormal_scale, x)) + (F::one - F::sqrt_half);
  const Lanes<S> biased = from_bits<S>((shifted >> F::fraction_bits) | to_bits(Lanes<S>(F::two_to_fraction)));
  const Lanes<S> exponent = biased - select(subnormal, F::two_to_fraction + F::exponent_bias + F::subnormal_exponent,
                                            F::two_to_fraction + F::exponent_bias);
  return {exponent, from_bits<S>((shifted & F::fraction_mask) + F::sqrt_half) - S(1)};
}

/// log(x) + low for positive finite x. With s = f / (2 + f): log(1 + f) = 2 s + s R(s^2) = f - f^2/2 + s (f^2/2 + R).
template <class S>
CLEAVE_INLINE Lanes<S> logarithm(Lanes<S> x, Lanes<S> low = S(0)) {
  using F = Format<S>;
  const auto [k, f] = binary_exponent(x);
  const Lanes<S> s = f / (f + S(2)), z = s * s;
  Lanes<S> r;
  if constexpr (std::is_same_v<S, float>)
    r = z * polynomial<S>(z, 6.666666655e-01f, 4.000012943e-01f, 2.854996859e-01f, 2.335342760e-01f);
  else
    r = z * polynomial<S>(z, 6.66666666666666963e-01, 3.99999999998866151e-01, 2.85714286317643340e-01, 2.22222101992642113e-01,
                          1.81829566080634580e-01, 1.53295007542041783e-01, 1.46436286019097972e-01);
  const Lanes<S> half_square = S(0.5) * f * f;
  return k * F::ln2_high - ((half_square - (s * (half_square + r) + (k * F::ln2_low + low))) - f);
}

/// x^(-1/3) for positive normal x. The logarithm is nearly linear in the bits of a number, which gives 5 bits; the series
/// (1 - e)^(-1/3) = 1 + e/3 + 2/9 e^2 + 14/81 e^3 + ... with e = 1 - x y^3 gives the rest in two steps.
template <class S>
CLEAVE_INLINE Lanes<S> reciprocal_cube_root(Lanes<S> x) {
  using F = Format<S>;
  constexpr bool single = std::is_same_v<S, float>;
  constexpr int dropped = single ? 9 : 32;
  constexpr S unit = single ? S(0x1p14) : S(0x1p20);
  constexpr S guess = S(4.0 / 3.0 * (F::exponent_bias - 0.0470)) * unit;
  const Lanes<S> b = from_bits<S>((to_bits(x) >> dropped) | to_bits(Lanes<S>(F::two_to_fraction))) - F::two_to_fraction;
  Lanes<S> y = from_bits<S>(to_bits((guess - b * S(1.0 / 3.0)) + F::two_to_fraction) << dropped);
  const Lanes<S> e = S(1) - (x * y) * (y * y);
  if constexpr (single) {
    y = y + y * (e * polynomial<S>(e, S(1.0 / 3.0), S(2.0 / 9.0), S(14.0 / 81.0)));
    return y + y * ((S(1) - (x * y) * (y * y)) * S(1.0 / 3.0));
  } else {
    y = y + y * (e * polynomial<S>(e, S(1.0 / 3.0), S(2.0 / 9.0), S(14.0 / 81.0), S(35.0 / 243.0)));
    const Lanes<S> e2 = S(1) - (x * y) * (y * y);
    return y + y * (e2 * polynomial<S>(e2, S(1.0 / 3.0), S(2.0 / 9.0)));
  }
}

/// The two halves of Lanes<float> in double precision, and back.
typedef float HalfFloatVector __attribute__((vector_size(CLEAVE_LANE_BYTES / 2)));
struct Widened {
  Lanes<double> low, high;
};
CLEAVE_INLINE Widened widen(Lanes<float> x) {
  HalfFloatVector half[2];
  __builtin_memcpy(half, &x.native, sizeof(x.native));
  return {Lanes<double>(__builtin_convertvector(half[0], DoubleVector)),
          Lanes<double>(__builtin_convertvector(half[1], DoubleVector))};
}
CLEAVE_INLINE Lanes<float> narrow(Lanes<double> low, Lanes<double> high) {
  const HalfFloatVector half[2] = {__builtin_convertvector(low.native, HalfFloatVector),
                                   __builtin_convertvector(high.native, HalfFloatVector)};
  Lanes<float> x;
  __builtin_memcpy(&x.native, half, sizeof(x.native));
  return x;
}

}  // namespace detail

// ------------------------------------------------------------------ lanes

template <class S>
CLEAVE_INLINE Lanes<S> exp(Lanes<S> x) {
  const auto [n, p] = detail::exponential(x);
  return detail::scale_by_power_of_two(p + S(1), n);
}

/// exp(x) - 1 without cancellation near 0: 2^n (p + 1 - 2^-n).
template <class S>
CLEAVE_INLINE Lanes<S> expm1(Lanes<S> x) {
  const auto [n, p] = detail::exponential(max(x, Lanes<S>(-60)));
  const Lanes<S> one_less = S(1) - detail::scale_by_power_of_two(Lanes<S>(1), -min(n, Lanes<S>(100)));
  return select(x == S(0), x, detail::scale_by_power_of_two(p + one_less, n));
}

template <class S>
CLEAVE_INLINE Lanes<S> log(Lanes<S> x) {
  const Lanes<S> outside = select(x == S(0), -detail::infinity<S>, select(x < S(0), detail::not_a_number<S>, x));
  return select((x > S(0)) & (x < detail::infinity<S>), detail::logarithm(x), outside);
}

/// log(1 + x) without cancellation near 0: what rounding took from 1 + x is given back to the logarithm.
template <class S>
CLEAVE_INLINE Lanes<S> log1p(Lanes<S> x) {
  const Lanes<S> u = x + S(1);
  const Lanes<S> lost = select(abs(x) < S(1), x - (u - S(1)), S(1) - (u - x));
  const Lanes<S> outside = select(x == S(-1), -detail::infinity<S>, select(x < S(-1), detail::not_a_number<S>, x));
  return select((x > S(-1)) & (x < detail::infinity<S>)&(x != S(0)), detail::logarithm(u, lost / u), outside);
}

template <class S>
CLEAVE_INLINE Lanes<S> cbrt(Lanes<S> x) {
  using F = detail::Format<S>;
  const Lanes<S> a = abs(x);
  const LaneMask<S> subnormal = a < detail::smallest_normal<S>;
  const Lanes<S> m = select(subnormal, a * F::subnormal_scale, a);
  const Lanes<S> y = detail::reciprocal_cube_root(m), y2 = y * y, c = m * y2;
  const Lanes<S> root = c + (S(0.5) * m - (c * c) * (S(0.5) * c)) * (y2 * S(2.0 / 3.0));  // halves: no overflow
  const Lanes<S> scaled = select(subnormal, root * (S(1) / F::subnormal_cube_root), root);
  return select((a == S(0)) | (a == detail::infinity<S>), x, copysign(scaled, x));
}

/// 1 / cbrt(x)
template <class S>
CLEAVE_INLINE Lanes<S> rcbrt(Lanes<S> x) {
  using F = detail::Format<S>;
  const Lanes<S> a = abs(x);
  const LaneMask<S> subnormal = a < detail::smallest_normal<S>;
  const Lanes<S> y = detail::reciprocal_cube_root(select(subnormal, a * F::subnormal_scale, a));
  const Lanes<S> scaled = select(subnormal, y * F::subnormal_cube_root, y);
  const Lanes<S> limit = select(a == S(0), detail::infinity<S>, S(0));
  return copysign(select((a == S(0)) | (a == detail::infinity<S>), limit, scaled), x);
}

template <class S>
CLEAVE_INLINE Lanes<S> sinh(Lanes<S> x) {
  const Lanes<S> a = abs(x);
  const auto [n, p] = detail::exponential(a);
  const Lanes<S> t =
      detail::scale_by_power_of_two(p + (S(1) - detail::scale_by_power_of_two(Lanes<S>(1), -min(n, Lanes<S>(100)))), n);
  const Lanes<S> large = detail::scale_by_power_of_two(p + S(1), n - S(1));
  return copysign(select(n > S(40), large, S(0.5) * (t + t / (t + S(1)))), x);
}

template <class S>
CLEAVE_INLINE Lanes<S> cosh(Lanes<S> x) {
  const auto [n, p] = detail::exponential(abs(x));
  const Lanes<S> half = detail::scale_by_power_of_two(p + S(1), n - S(1));
  return half + S(0.25) / half;
}

/// sign(x) log(|x| + sqrt(x^2 + 1)) = sign(x) log1p(|x| + x^2 / (1 + sqrt(x^2 + 1)))
template <class S>
CLEAVE_INLINE Lanes<S> asinh(Lanes<S> x) {
  const Lanes<S> a = abs(x);
  const LaneMask<S> large = a > detail::Format<S>::two_to_fraction;
  const Lanes<S> square = select(large, S(0), a * a);
  const Lanes<S> l = log1p(select(large, a, a + square / (S(1) + sqrt(square + S(1)))));
  return copysign(select(large, l + S(0.69314718055994530942), l), x);
}

namespace detail {

/// exp(y log(a)) for a > 0: the logarithm is carried in two doubles, since its error is multiplied by y.
inline Lanes<double> positive_power(Lanes<double> a, Lanes<double> y) {
  using L = Lanes<double>;
  using F = Format<double>;
  const auto [k, f] = binary_exponent(a);
  // s = f / (2 + f)
  const L d = f + 2.0, d_low = f - (d - 2.0);
  const L s = f / d, sd = s * d;
  const L s_low = (((f - sd) - product_error(s, d, sd)) - s * d_low) / d;
  const L z = s * s, z_low = product_error(s, s, z) + 2.0 * s * s_low;
  const L sz = s * z, sz_low = product_error(s, z, sz) + (s * z_low + s_low * z);
  // log(1 + f) = 2 s + s z w, w = 2/3 + 2/5 z + ...
  const L t = z * polynomial<double>(z, 4.00000000000000022e-01, 2.85714285714294858e-01, 2.22222222215834403e-01,
                                     1.81818183516517490e-01, 1.53845932425795140e-01, 1.33348973085470640e-01,
                                     1.17037807729493681e-01, 1.17486033656080929e-01);
  constexpr double two_thirds = 2.0 / 3.0, two_thirds_low = 0x1.5555555555555p-55;
  const L w = t + two_thirds, w_low = (t - (w - two_thirds)) + two_thirds_low;
  const L v = sz * w, v_low = product_error(sz, w, v) + (sz * w_low + sz_low * w);
  // k ln 2 + 2 s + v, largest first
  const L kl = k * F::ln2_high, two_s = 2.0 * s;
  const L s1 = kl + two_s, back = s1 - kl, e1 = (kl - (s1 - back)) + (two_s - back);
  const L s2 = s1 + v, e2 = (s1 - s2) + v;
  const L low = ((e1 + e2) + (v_low + 2.0 * s_low)) + k * F::ln2_low;
  const L l = s2 + low, l_low = (s2 - l) + low;
  const L log_a = select(a == 0.0, -infinity<double>, select(a == infinity<double>, infinity<double>, l));

  const L p = y * log_a;
  const L p_low = product_error(y, log_a, p) + y * l_low;
  const auto [n, q] = exponential(p, select(abs(p) < 800.0, p_low, 0.0));
  const L power = scale_by_power_of_two(q + 1.0, n);
  return select((a != a) | (y != y), a + y, power);
}

/// The same in single precision, where one double is precise enough.
inline Lanes<float> positive_power(Lanes<float> a, Lanes<float> y) {
  const Widened wide_a = widen(a), wide_y = widen(y);
  return narrow(exp(wide_y.low * log(wide_a.low)), exp(wide_y.high * log(wide_a.high)));
}

}  // namespace detail

/// x^y; NaN for negative x unless y is whole.
template <class S>
CLEAVE_INLINE Lanes<S> pow(Lanes<S> x, std::type_identity_t<Lanes<S>> y) {
  const Lanes<S> power = detail::positive_power(abs(x), y);
  const LaneMask<S> whole = floor(y) == y;
  const LaneMask<S> odd = whole & (floor(y * S(0.5)) * S(2) != y);
  const Lanes<S> with_sign = select(odd, copysign(power, x), power);
  const Lanes<S> in_domain = select((x < S(0)) & !whole & (x > -detail::infinity<S>), detail::not_a_number<S>, with_sign);
  const LaneMask<S> is_one = (y == S(0)) | (x == S(1)) | ((x == S(-1)) & (abs(y) == detail::infinity<S>));
  return select(is_one, S(1), in_domain);
}
template <Arithmetic A, class S>
CLEAVE_INLINE Lanes<S> pow(A x, Lanes<S> y) {
  return pow(Lanes<S>(x), y);
}

namespace detail {

/// x = quarter pi/2 + remainder, |remainder| <= pi/4, for |x| <= reach.
template <class S>
struct QuarterTurns {
  static constexpr S reach = S(1e6);
  Lanes<S> quarter, remainder;
};
CLEAVE_INLINE QuarterTurns<double> quarter_turns(Lanes<double> x) {
  constexpr double magic = Format<double>::round_to_integer;
  const Lanes<double> j = (x * 0.63661977236758134308 + magic) - magic;
  return {j, ((x - j * 0x1.921fb544p+0) - j * 0x1.0b4611a6p-34) - j * 0x1.3198a2e037073p-69};
}
CLEAVE_INLINE QuarterTurns<float> quarter_turns(Lanes<float> x) {
  const Widened wide = widen(x);
  const QuarterTurns<double> low = quarter_turns(wide.low), high = quarter_turns(wide.high);
  return {narrow(low.quarter, high.quarter), narrow(low.remainder, high.remainder)};
}

/// sin(x + quarters pi/2)
template <class S>
CLEAVE_INLINE Lanes<S> shifted_sine(Lanes<S> x, S quarters) {
  const auto [j, r] = quarter_turns(x);
  const Lanes<S> z = r * r;
  Lanes<S> s, c;
  if constexpr (std::is_same_v<S, float>) {
    s = polynomial<S>(z, -1.666666666e-01f, 8.333331831e-03f, -1.984006304e-04f, 2.724686872e-06f);
    c = polynomial<S>(z, 4.166666460e-02f, -1.388829130e-03f, 2.454541908e-05f);
  } else {
    s = polynomial<S>(z, -1.66666666666666657e-01, 8.33333333333333148e-03, -1.98412698412648214e-04, 2.75573192191507828e-06,
                      -2.50521061673357054e-08, 1.60585213499549863e-10, -7.58609478967262055e-13);
    c = polynomial<S>(z, 4.16666666666666644e-02, -1.38888888888873217e-03, 2.48015872986512922e-05, -2.75573172126865886e-07,
                      2.08761340240901448e-09, -1.13817546536629370e-11);
  }
  const Lanes<S> sine = r + (r * z) * s;
  const Lanes<S> half = S(0.5) * z, w = S(1) - half;
  const Lanes<S> cosine = w + (((S(1) - w) - half) + (z * z) * c);
  const Lanes<S> turn = j + quarters;
  const LaneMask<S> use_cosine = floor(turn * S(0.5)) * S(2) != turn;
  const Lanes<S> pair = floor(turn * S(0.5));
  const LaneMask<S> negative = floor(pair * S(0.5)) * S(2) != pair;
  const Lanes<S> magnitude = select(use_cosine, cosine, sine);
  return select(negative, -magnitude, magnitude);
}

}  // namespace detail

/// Beyond 10^6 a lane is handed to <cmath>.
template <class S>
inline Lanes<S> sin(Lanes<S> x) {
  Lanes<S> y = select(x == S(0), x, detail::shifted_sine(x, S(0)));
  const LaneMask<S> far = !(abs(x) <= detail::QuarterTurns<S>::reach);
  if (any(far))
    for (int i = 0; i < Lanes<S>::width; ++i)
      if (far[i]) y.set(i, std::sin(x[i]));
  return y;
}
template <class S>
inline Lanes<S> cos(Lanes<S> x) {
  Lanes<S> y = detail::shifted_sine(x, S(1));
  const LaneMask<S> far = !(abs(x) <= detail::QuarterTurns<S>::reach);
  if (any(far))
    for (int i = 0; i < Lanes<S>::width; ++i)
      if (far[i]) y.set(i, std::cos(x[i]));
  return y;
}

/// The angle of (x, y) in [-pi, pi]. One division: tan(u - pi/4) = (t - 1) / (t + 1) brings t = min/max below tan(pi/8).
template <class S>
inline Lanes<S> atan2(Lanes<S> y, std::type_identity_t<Lanes<S>> x) {
  constexpr bool single = std::is_same_v<S, float>;
  constexpr S pi = S(3.14159265358979323846), pi_low = single ? S(-8.742278000e-08) : S(0x1.1a62633145c07p-53);
  const Lanes<S> ax = abs(x), ay = abs(y);
  const LaneMask<S> steep = ay > ax;
  const Lanes<S> larger = select(steep, ay, ax), smaller = select(steep, ax, ay);
  // Halving keeps larger + smaller finite; equal numbers (also 0 and 0, infinity and infinity) need no division.
  const Lanes<S> scale = select(larger > S(1), S(0.5), S(1)), n = smaller * scale, d = larger * scale;
  const LaneMask<S> high = n > d * S(0.41421356237309504880);
  const LaneMask<S> equal = n == d;
  const Lanes<S> quotient = select(high, n - d, n) / select(high, n + d, d);
  const Lanes<S> t = select(equal, S(0), quotient);
  const Lanes<S> z = t * t;
  Lanes<S> p;
  if constexpr (single)
    p = detail::polynomial<S>(z, -3.333333175e-01f, 1.999953879e-01f, -1.426389711e-01f, 1.074309967e-01f, -6.449835225e-02f);
  else
    p = detail::polynomial<S>(z, -3.33333333333333315e-01, 1.99999999999954797e-01, -1.42857142846578938e-01,
                              1.11111110145610134e-01, -9.09090454988461111e-02, 7.69218253511664840e-02,
                              -6.66450221567144729e-02, 5.85806875686151057e-02, -5.08503049281094077e-02,
                              3.92195525325512925e-02, -1.91620689159025734e-02);
  const Lanes<S> arc = t + (t * z) * p;
  const LaneMask<S> eighth = high | (equal & (d != S(0)));
  const Lanes<S> shallow = select(eighth, S(0.25) * pi + (arc + S(0.25) * pi_low), arc);
  const Lanes<S> first = select(steep, S(0.5) * pi - (shallow - S(0.5) * pi_low), shallow);
  const LaneMask<S> left = copysign(Lanes<S>(1), x) < S(0);
  const Lanes<S> half_plane = select(left, pi - (first - pi_low), first);
  return select((x != x) | (y != y), x + y, copysign(half_plane, y));
}
template <Arithmetic A, class S>
CLEAVE_INLINE Lanes<S> atan2(A y, Lanes<S> x) {
  return atan2(Lanes<S>(y), x);
}

}  // namespace cleave

#endif
