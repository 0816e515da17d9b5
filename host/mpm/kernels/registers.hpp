#pragma once

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

/// Numbers side by side in as many registers as they fill. Vectors wider than a register the compiler takes apart, number after
/// number through memory; a structure of registers it keeps in registers.
namespace cleave::mpm::kernel {

#define CLEAVE_INLINE inline __attribute__((always_inline))

#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512DQ__)
#define CLEAVE_REGISTER_BYTES 64
#elif defined(__AVX2__) && defined(__FMA__)
#define CLEAVE_REGISTER_BYTES 32
#else
#define CLEAVE_REGISTER_BYTES 16
#endif
inline constexpr int register_bytes = CLEAVE_REGISTER_BYTES;

/// `Count` registers R: a vector of numbers, or of what comparing numbers gives.
template <class R, int Count>
struct Registers {
  using Register = R;
  using Number = std::remove_cvref_t<decltype(std::declval<R&>()[0])>;
  static constexpr int count = Count;
  static constexpr int each = int(sizeof(R) / sizeof(Number));
  static constexpr int lanes = Count * each;
  R r[Count];

  /// f(register of each operand), for all of them. f may give another kind of register.
  template <class F, class... Operand>
  static CLEAVE_INLINE auto map(F f, const Operand&... operand) {
    const auto one = [&](auto i) __attribute__((always_inline)) { return f(operand.r[decltype(i)::value]...); };
    return [&]<int... I>(std::integer_sequence<int, I...>) __attribute__((always_inline)) {
      return Registers<decltype(one(std::integral_constant<int, 0>{})), Count>{{one(std::integral_constant<int, I>{})...}};
    }
    (std::make_integer_sequence<int, Count>{});
  }

#define CLEAVE_OPERATOR(op)                                                       \
  friend CLEAVE_INLINE auto operator op(const Registers& a, const Registers& b) { \
    return map(                                                                   \
        [](R x, R y) __attribute__((always_inline)) { return x op y; }, a, b);    \
  }                                                                               \
  friend CLEAVE_INLINE auto operator op(const Registers& a, Number b) {           \
    return map(                                                                   \
        [b](R x) __attribute__((always_inline)) { return x op b; }, a);           \
  }                                                                               \
  friend CLEAVE_INLINE auto operator op(Number a, const Registers& b) {           \
    return map(                                                                   \
        [a](R y) __attribute__((always_inline)) { return a op y; }, b);           \
  }
  CLEAVE_OPERATOR(+)
  CLEAVE_OPERATOR(-)
  CLEAVE_OPERATOR(*)
  CLEAVE_OPERATOR(/)
  CLEAVE_OPERATOR(<)
  CLEAVE_OPERATOR(<=)
  CLEAVE_OPERATOR(>)
  CLEAVE_OPERATOR(>=)
  CLEAVE_OPERATOR(==)
  CLEAVE_OPERATOR(!=)
  CLEAVE_OPERATOR(&)
  CLEAVE_OPERATOR(|)
#undef CLEAVE_OPERATOR
  friend CLEAVE_INLINE Registers operator-(const Registers& a) {
    return map(
        [](R x) __attribute__((always_inline)) { return -x; }, a);
  }
  friend CLEAVE_INLINE Registers operator~(const Registers& a) {
    return map(
        [](R x) __attribute__((always_inline)) { return ~x; }, a);
  }
  template <class Other>
  CLEAVE_INLINE Registers& operator+=(const Other& b) {
    return *this = *this + b;
  }
  template <class Other>
  CLEAVE_INLINE Registers& operator-=(const Other& b) {
    return *this = *this - b;
  }
  template <class Other>
  CLEAVE_INLINE Registers& operator*=(const Other& b) {
    return *this = *this * b;
  }
  CLEAVE_INLINE Registers& operator&=(const Registers& b) { return *this = *this & b; }
  CLEAVE_INLINE Registers& operator|=(const Registers& b) { return *this = *this | b; }
  CLEAVE_INLINE Number operator[](int lane) const { return r[lane / each][lane % each]; }
};

/// Whether any bit of a register is set.
template <class R>
CLEAVE_INLINE bool any_bit(R m) {
#if CLEAVE_REGISTER_BYTES == 64
  if constexpr (sizeof(R) == 64) return _mm512_test_epi32_mask(reinterpret_cast<__m512i>(m), reinterpret_cast<__m512i>(m)) != 0;
#endif
#if CLEAVE_REGISTER_BYTES >= 32
  if constexpr (sizeof(R) == 32) return !_mm256_testz_si256(reinterpret_cast<__m256i>(m), reinterpret_cast<__m256i>(m));
#endif
  std::uint64_t words[sizeof(R) / 8], all = 0;
  std::memcpy(words, &m, sizeof m);
  for (const auto word : words) all |= word;
  return all != 0;
}

}  // namespace cleave::mpm::kernel
