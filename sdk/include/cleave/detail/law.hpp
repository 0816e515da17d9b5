/// What the laws evaluated at material points have in common: strain measure, fibers, flags.
#ifndef CLEAVE_DETAIL_LAW_HPP
#define CLEAVE_DETAIL_LAW_HPP

#include <cleave/about.hpp>
#include <cleave/detail/batch.hpp>
#include <cleave/tensor.hpp>

#include <array>

namespace cleave {

/// Unit directions in the reference frame, orthogonal to each other.
template <class T>
struct Fibers {
  Vector3<T> first, second;
};

namespace detail {

template <class Law>
inline constexpr bool is_law_of_b = [] {
  if constexpr (requires { Law::accepts; })
    return Law::accepts == Accepts::left_cauchy_green;
  else
    return false;
}();
template <class Law>
inline constexpr bool is_law_of_F = [] {
  if constexpr (requires { Law::accepts; })
    return Law::accepts == Accepts::deformation_gradient;
  else
    return false;
}();
template <class Law, class T>
using StrainOf = std::conditional_t<is_law_of_b<Law>, Symmetric3<T>, Matrix3<T>>;

template <class Law>
inline constexpr int fiber_count = [] {
  if constexpr (requires { Law::fibers; })
    return int(Law::fibers);
  else
    return 0;
}();
/// Fibres (and the F that carries them along, of a damage law) are read only where a parameter says so.
template <class Law>
inline constexpr bool has_optional_fibers = [] {
  if constexpr (requires { Law::optional_fibers; })
    return bool(Law::optional_fibers);
  else
    return false;
}();
template <class Law>
inline constexpr bool is_inversion_safe = [] {
  if constexpr (requires { Law::inversion_safe; })
    return bool(Law::inversion_safe);
  else
    return false;
}();
template <class Law>
inline constexpr bool is_isotropic = [] {
  if constexpr (requires { Law::isotropic; })
    return bool(Law::isotropic);
  else
    return is_law_of_b<Law>;
}();

template <class Law>
inline constexpr std::uint64_t fiber_capabilities = has_optional_fibers<Law>
                                                        ? 0
                                                        : (fiber_count<Law> > 0 ? CLEAVE_NEEDS_FIBER : 0) |
                                                              (fiber_count<Law> > 1 ? CLEAVE_NEEDS_SECOND_FIBER : 0);
template <class Law>
inline constexpr std::uint64_t common_capabilities =
    (is_law_of_b<Law> ? CLEAVE_ACCEPTS_B | CLEAVE_ACCEPTS_F : 0) | (is_law_of_F<Law> ? CLEAVE_ACCEPTS_F : 0) |
    (is_isotropic<Law> ? CLEAVE_ISOTROPIC : 0) |
    (is_inversion_safe<Law> ? CLEAVE_INVERSION_SAFE : 0) | fiber_capabilities<Law> | CLEAVE_SINGLE | CLEAVE_DOUBLE;

template <class Law, class T>
CLEAVE_INLINE StrainOf<Law, T> strain_of(const Matrix3<T>& F) {
  if constexpr (is_law_of_b<Law>)
    return left_cauchy_green(F);
  else
    return F;
}

/// Without a fiber field the material has fibers along x (and y).
template <class Law, class S>
CLEAVE_INLINE Fibers<Lanes<S>> load_fibers(const Chunk<S>& chunk, const cleave_component* first,
                                           const cleave_component* second) {
  using T = Lanes<S>;
  Fibers<T> fibers;
  if constexpr (fiber_count < Law >> 0) {
    fibers.first = first ? chunk.load_vector(first) : Vector3<T>(T(1), T(0), T(0));
    fibers.second = second ? chunk.load_vector(second) : Vector3<T>(T(0), T(1), T(0));
  }
  return fibers;
}

/// State variables of a point.
template <class T, std::size_t N, class S>
CLEAVE_INLINE std::array<T, N> load_state(const Chunk<S>& chunk, const cleave_component* c) {
  std::array<T, N> state;
  for (std::size_t i = 0; i < N; ++i) state[i] = chunk.load(c + i);
  return state;
}

}  // namespace detail
}  // namespace cleave

#endif
