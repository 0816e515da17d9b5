/// Dual<T, N>: a number with its derivatives along N directions, for first derivatives of templated formulas without
/// symbolic work. T is a plain number, Lanes or again a Dual (second derivatives).
///
///   f(value + sum_i derivative[i] eps_i) = f(value) + f'(value) sum_i derivative[i] eps_i,   eps_i eps_j = 0
///
/// Comparisons look at the value alone, and `select`, `min`, `max` carry the derivative of the side they take. Where a
/// derivative does not exist (sqrt at 0) it is what the formula gives: infinite or NaN.
#ifndef CLEAVE_DUAL_HPP
#define CLEAVE_DUAL_HPP

#include <cleave/math.hpp>

namespace cleave {

template <class T, int N>
struct Dual;

namespace detail {
template <class T, int N>
struct NumberTraits<Dual<T, N>> {
  using Scalar = scalar_of<T>;
  using Mask = mask_of<T>;
};
}  // namespace detail

template <class T, int N>
struct Dual {
  using Mask = mask_of<T>;
  static constexpr int directions = N;

  T value;
  T derivative[N];

  Dual() = default;
  /// A constant.
  template <class A>
  requires std::convertible_to<A, T> CLEAVE_INLINE Dual(const A& constant) : value(static_cast<T>(constant)) {
    for (int i = 0; i < N; ++i) derivative[i] = T(0);
  }
  /// The variable that direction i differentiates by.
  static CLEAVE_INLINE Dual variable(const T& at, int i) {
    Dual x(at);
    x.derivative[i] = T(1);
    return x;
  }

  friend CLEAVE_INLINE Dual operator+(const Dual& a, const Dual& b) {
    Dual c;
    c.value = a.value + b.value;
    for (int i = 0; i < N; ++i) c.derivative[i] = a.derivative[i] + b.derivative[i];
    return c;
  }
  friend CLEAVE_INLINE Dual operator-(const Dual& a, const Dual& b) {
    Dual c;
    c.value = a.value - b.value;
    for (int i = 0; i < N; ++i) c.derivative[i] = a.derivative[i] - b.derivative[i];
    return c;
  }
  friend CLEAVE_INLINE Dual operator*(const Dual& a, const Dual& b) {
    return combine(a.value * b.value, a, b.value, b, a.value);
  }
  friend CLEAVE_INLINE Dual operator/(const Dual& a, const Dual& b) {
    const T quotient = a.value / b.value, reciprocal = T(1) / b.value;
    return combine(quotient, a, reciprocal, b, -quotient * reciprocal);
  }
  friend CLEAVE_INLINE Dual operator+(const Dual& a) { return a; }
  friend CLEAVE_INLINE Dual operator-(const Dual& a) { return chain(-a.value, a, T(-1)); }
  CLEAVE_INLINE Dual& operator+=(const Dual& b) { return *this = *this + b; }
  CLEAVE_INLINE Dual& operator-=(const Dual& b) { return *this = *this - b; }
  CLEAVE_INLINE Dual& operator*=(const Dual& b) { return *this = *this * b; }
  CLEAVE_INLINE Dual& operator/=(const Dual& b) { return *this = *this / b; }

  friend CLEAVE_INLINE Mask operator<(const Dual& a, const Dual& b) { return a.value < b.value; }
  friend CLEAVE_INLINE Mask operator<=(const Dual& a, const Dual& b) { return a.value <= b.value; }
  friend CLEAVE_INLINE Mask operator>(const Dual& a, const Dual& b) { return a.value > b.value; }
  friend CLEAVE_INLINE Mask operator>=(const Dual& a, const Dual& b) { return a.value >= b.value; }
  friend CLEAVE_INLINE Mask operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
  friend CLEAVE_INLINE Mask operator!=(const Dual& a, const Dual& b) { return a.value != b.value; }

  friend CLEAVE_INLINE Dual select(const Mask& m, const Dual& a, const Dual& b) {
    Dual c;
    c.value = select(m, a.value, b.value);
    for (int i = 0; i < N; ++i) c.derivative[i] = select(m, a.derivative[i], b.derivative[i]);
    return c;
  }
  friend CLEAVE_INLINE Dual min(const Dual& a, const Dual& b) { return select(b.value < a.value, b, a); }
  friend CLEAVE_INLINE Dual max(const Dual& a, const Dual& b) { return select(a.value < b.value, b, a); }
  friend CLEAVE_INLINE Dual abs(const Dual& a) { return chain(abs(a.value), a, copysign(T(1), a.value)); }
  friend CLEAVE_INLINE Dual copysign(const Dual& a, const Dual& b) {
    return chain(copysign(a.value, b.value), a, copysign(T(1), a.value) * copysign(T(1), b.value));
  }
  friend CLEAVE_INLINE Dual floor(const Dual& a) { return Dual(T(floor(a.value))); }
  friend CLEAVE_INLINE Dual fma(const Dual& a, const Dual& b, const Dual& c) { return a * b + c; }

  friend CLEAVE_INLINE Dual sqrt(const Dual& a) {
    const T root = sqrt(a.value);
    return chain(root, a, T(0.5) / root);
  }
  friend CLEAVE_INLINE Dual rsqrt(const Dual& a) {
    const T root = rsqrt(a.value);
    return chain(root, a, T(-0.5) * root * root * root);
  }
  friend CLEAVE_INLINE Dual cbrt(const Dual& a) {
    const T root = cbrt(a.value);
    return chain(root, a, T(1.0 / 3.0) / (root * root));
  }
  friend CLEAVE_INLINE Dual rcbrt(const Dual& a) {
    const T root = rcbrt(a.value);
    return chain(root, a, T(-1.0 / 3.0) * (root * root) * (root * root));
  }
  friend CLEAVE_INLINE Dual exp(const Dual& a) {
    const T e = exp(a.value);
    return chain(e, a, e);
  }
  friend CLEAVE_INLINE Dual expm1(const Dual& a) {
    const T e = expm1(a.value);
    return chain(e, a, e + T(1));
  }
  friend CLEAVE_INLINE Dual log(const Dual& a) { return chain(log(a.value), a, T(1) / a.value); }
  friend CLEAVE_INLINE Dual log1p(const Dual& a) { return chain(log1p(a.value), a, T(1) / (a.value + T(1))); }
  friend CLEAVE_INLINE Dual sinh(const Dual& a) { return chain(sinh(a.value), a, cosh(a.value)); }
  friend CLEAVE_INLINE Dual cosh(const Dual& a) { return chain(cosh(a.value), a, sinh(a.value)); }
  friend CLEAVE_INLINE Dual asinh(const Dual& a) { return chain(asinh(a.value), a, rsqrt(a.value * a.value + T(1))); }
  friend CLEAVE_INLINE Dual sin(const Dual& a) { return chain(sin(a.value), a, cos(a.value)); }
  friend CLEAVE_INLINE Dual cos(const Dual& a) { return chain(cos(a.value), a, -sin(a.value)); }
  friend CLEAVE_INLINE Dual atan2(const Dual& y, const Dual& x) {
    const T scale = T(1) / (x.value * x.value + y.value * y.value);
    return combine(atan2(y.value, x.value), y, x.value * scale, x, -y.value * scale);
  }
  /// The derivative by the exponent is x^y log x, taken as 0 where x is not positive.
  friend CLEAVE_INLINE Dual pow(const Dual& x, const Dual& y) {
    const T power = pow(x.value, y.value);
    const auto positive = x.value > T(0);
    const T by_exponent = select(positive, T(power * log(select(positive, x.value, T(1)))), T(0));
    return combine(power, x, power_slope(x.value, y.value), y, by_exponent);
  }
  /// A constant exponent needs no logarithm.
  template <Arithmetic A>
  friend CLEAVE_INLINE Dual pow(const Dual& x, A y) {
    const T slope = y == A(0) ? T(0) : T(y * pow(x.value, y - A(1)));
    return chain(T(pow(x.value, y)), x, slope);
  }

 private:
  /// f with df/dx = slope
  static CLEAVE_INLINE Dual chain(const T& f, const Dual& x, const T& slope) {
    Dual c;
    c.value = f;
    for (int i = 0; i < N; ++i) c.derivative[i] = slope * x.derivative[i];
    return c;
  }
  /// f with df/dx = by_x and df/dy = by_y
  static CLEAVE_INLINE Dual combine(const T& f, const Dual& x, const T& by_x, const Dual& y, const T& by_y) {
    Dual c;
    c.value = f;
    for (int i = 0; i < N; ++i) c.derivative[i] = by_x * x.derivative[i] + by_y * y.derivative[i];
    return c;
  }
  /// d(x^y)/dx = y x^(y-1), which is 0 for y = 0 also where x^(y-1) is infinite.
  static CLEAVE_INLINE T power_slope(const T& x, const T& y) { return select(y == T(0), T(0), T(y * pow(x, y - T(1)))); }
};

}  // namespace cleave

#endif
