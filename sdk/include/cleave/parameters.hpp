/// How a law declares its parameters and state variables: name, unit, default, bounds and meaning beside the member they
/// fill. The SDK turns the declaration into the ABI's schema and fills and checks the members when a material is made.
///
///     double beta;
///     bool hardening;
///     static constexpr auto parameters = describe(
///         &NACC::moduli,                                             // a member that declares parameters of its own
///         number(&NACC::beta, {.key = "cohesion", .valid = non_negative, .description = "tensile strength over p0"}),
///         boolean(&NACC::hardening, {.key = "hardening", .default_value = true, .description = "..."}));
///
/// A parameter without a default is required. A law (or such a member) may have `void complete()` or
/// `void complete(const Surroundings&)`, called once its members are filled; it throws ParameterError to refuse them.
#ifndef CLEAVE_PARAMETERS_HPP
#define CLEAVE_PARAMETERS_HPP

#include "abi.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

namespace cleave {

/// A parameter is refused. The text completes "KEY ...": "must be below 0.5".
struct ParameterError {
  std::string key;
  std::string text;
};

/// A combination the plugin does not offer; the text stands alone.
struct UnsupportedError {
  std::string text;
};

/// The isotropic part of a material's elastic law, not degraded.
class ElasticProbe {
 public:
  explicit ElasticProbe(const cleave_elastic_probe* probe = nullptr)
      : probe_(probe && CLEAVE_HAS(cleave_elastic_probe, probe, tensile_energy) ? probe : nullptr) {}
  explicit operator bool() const { return probe_ != nullptr; }

  double shear_modulus() const { return probe_->shear_modulus; }  ///< mu at rest [Pa]
  double bulk_modulus() const { return probe_->bulk_modulus; }    ///< kappa at rest [Pa]
  /// E = 9 kappa mu / (3 kappa + mu) [Pa]
  double youngs_modulus() const { return 9 * bulk_modulus() * shear_modulus() / (3 * bulk_modulus() + shear_modulus()); }
  /// psi_plus at F = stretch I [J/m^3]; NaN if the law offers no energy.
  double tensile_energy_at_stretch(double stretch) const {
    const double F[9] = {stretch, 0, 0, 0, stretch, 0, 0, 0, stretch};
    return probe_->tensile_energy(probe_, F);
  }

 private:
  const cleave_elastic_probe* probe_;
};

/// What a law may know of the material and scene it becomes part of.
struct Surroundings {
  int dimension = 3;     ///< 2 (plane strain) or 3
  double cell_size = 0;  ///< m; 0 where there is no grid
  double density = 0;    ///< kg/m^3 at rest; 0 where none is known
  ElasticProbe elastic;  ///< the elastic law of the same material; none for an elastic law itself
};

/// Capabilities that a law has only where the first, or the second, element of a parameter is not zero:
/// {CLEAVE_NEEDS_FIBER, CLEAVE_NEEDS_SECOND_FIBER} for a list of which each element belongs to a family of fibres.
using Needs = std::array<std::uint64_t, 2>;

// ---------------------------------------------------------------- what is declared

inline constexpr double infinity = std::numeric_limits<double>::infinity();

struct Bounds {
  double minimum = -infinity, maximum = infinity;
  bool minimum_open = false, maximum_open = false;  ///< the bound itself is excluded
};
inline constexpr Bounds unbounded{};
inline constexpr Bounds positive{.minimum = 0, .minimum_open = true};
inline constexpr Bounds non_negative{.minimum = 0};
constexpr Bounds at_least(double minimum) { return {.minimum = minimum}; }
constexpr Bounds above(double minimum) { return {.minimum = minimum, .minimum_open = true}; }
constexpr Bounds between(double minimum, double maximum) { return {.minimum = minimum, .maximum = maximum}; }
constexpr Bounds strictly_between(double minimum, double maximum) { return {minimum, maximum, true, true}; }

/// Up to nine numbers, the value of a list parameter or of a state variable.
class NumberList {
 public:
  constexpr NumberList() = default;
  constexpr NumberList(double value) : NumberList({value}) {}
  constexpr NumberList(std::initializer_list<double> values) : count_(unsigned(values.size())) {
    std::copy(values.begin(), values.end(), values_.begin());
  }
  constexpr void resize(unsigned count) { count_ = count; }
  constexpr unsigned size() const { return count_; }
  constexpr double* data() { return values_.data(); }
  constexpr const double* data() const { return values_.data(); }
  constexpr double operator[](unsigned i) const { return values_[i]; }
  constexpr const double* begin() const { return data(); }
  constexpr const double* end() const { return data() + count_; }
  static constexpr unsigned capacity = 9;

 private:
  std::array<double, capacity> values_{};
  unsigned count_ = 0;
};

struct NumberSpec {
  const char* key;
  const char* unit = "1";                              ///< SI; "1" if dimensionless
  std::optional<double> default_value = std::nullopt;  ///< none: the scene must give it
  Bounds valid = {};                                   ///< outside, the formulas mean nothing and the parameter is refused
  std::optional<Bounds> physical = std::nullopt;       ///< what materials are known to have; outside, the host warns
  Needs needs{};                                       ///< of a law with optional_fibers
  const char* description;
};

struct IntegerSpec {
  const char* key;
  const char* unit = "1";
  std::optional<int> default_value = std::nullopt;
  Bounds valid = {};
  const char* description;
};

struct BooleanSpec {
  const char* key;
  std::optional<bool> default_value = std::nullopt;
  const char* description;
};

/// One of up to eight words; the member becomes the index of the word (an enum, say).
struct ChoiceSpec {
  const char* key;
  std::array<const char*, 8> choices{};
  const char* default_value = nullptr;
  const char* description;
};

struct ListSpec {
  const char* key;
  const char* unit = "1";
  unsigned min_count = 0, max_count = NumberList::capacity;
  std::optional<NumberList> default_value = std::nullopt;
  Bounds valid = {};  ///< of every element
  Needs needs{};      ///< of a law with optional_fibers
  const char* description;
};

enum class Change { free, never_decreases, never_increases };

/// A number per point (or a vector or tensor) that a law remembers from step to step; the host stores it.
struct StateSpec {
  const char* name;
  const char* unit = "1";
  NumberList initial{};  ///< zero if left out
  Change change = Change::free;
  const char* description;
};

namespace detail {

template <class Owner, class Value, class Spec>
struct Declared {
  using OwnerType = Owner;
  Value Owner::*member;
  Spec spec;
};

template <class Owner, class Group>
struct Nested {
  Group Owner::*member;
};

struct AlternativeSets {
  std::array<const char*, 8> sets{};
  bool optional = false;
};

template <cleave_tensor Tensor>
struct DeclaredState {
  StateSpec spec;
};

template <class... Items>
struct Declarations {
  std::tuple<Items...> items;
};

template <class Item>
constexpr Item declaration(Item item) {
  return item;
}
template <class Owner, class Group>
constexpr Nested<Owner, Group> declaration(Group Owner::*member) {
  return {member};
}

template <class T>
inline constexpr bool is_optional_number = std::is_same_v<T, std::optional<double>>;

}  // namespace detail

/// Collects declarations, in the order in which they are listed to the user.
template <class... Items>
constexpr auto describe(Items... items) {
  return detail::Declarations<decltype(detail::declaration(items))...>{{detail::declaration(items)...}};
}

/// A member `double`, or `std::optional<double>` for a member of alternative sets.
template <class Owner, class Value>
constexpr auto number(Value Owner::*member, NumberSpec spec) {
  static_assert(std::is_same_v<Value, double> || detail::is_optional_number<Value>);
  return detail::Declared<Owner, Value, NumberSpec>{member, spec};
}
template <class Owner>
constexpr auto integer(int Owner::*member, IntegerSpec spec) {
  return detail::Declared<Owner, int, IntegerSpec>{member, spec};
}
template <class Owner>
constexpr auto boolean(bool Owner::*member, BooleanSpec spec) {
  return detail::Declared<Owner, bool, BooleanSpec>{member, spec};
}
template <class Owner, class Enum>
constexpr auto choice(Enum Owner::*member, ChoiceSpec spec) {
  static_assert(std::is_enum_v<Enum> || std::is_same_v<Enum, int>);
  return detail::Declared<Owner, Enum, ChoiceSpec>{member, spec};
}
template <class Owner>
constexpr auto list(NumberList Owner::*member, ListSpec spec) {
  return detail::Declared<Owner, NumberList, ListSpec>{member, spec};
}

/// Each argument lists keys that go together, separated by spaces; the scene gives exactly one of these sets.
template <class... Sets>
constexpr auto one_of(Sets... sets) {
  return detail::AlternativeSets{{sets...}, false};
}
/// As one_of, or none of them.
template <class... Sets>
constexpr auto at_most_one_of(Sets... sets) {
  return detail::AlternativeSets{{sets...}, true};
}

constexpr auto scalar_state(StateSpec spec) { return detail::DeclaredState<CLEAVE_SCALAR>{spec}; }
constexpr auto vector_state(StateSpec spec) { return detail::DeclaredState<CLEAVE_VECTOR>{spec}; }
constexpr auto symmetric_state(StateSpec spec) { return detail::DeclaredState<CLEAVE_SYMMETRIC>{spec}; }
constexpr auto matrix_state(StateSpec spec) { return detail::DeclaredState<CLEAVE_MATRIX>{spec}; }

// ---------------------------------------------------------------- a group that most laws share

/// Elastic moduli of an isotropic solid, given as Young's modulus and Poisson's ratio or as shear and bulk modulus.
struct IsotropicModuli {
  std::optional<double> youngs_modulus, poissons_ratio, shear_modulus, bulk_modulus;

  double shear = 0;  ///< mu [Pa]
  double bulk = 0;   ///< kappa [Pa]
  double lame = 0;   ///< lambda = kappa - 2 mu/3 [Pa]

  /// mu = E / (2 (1 + nu)), kappa = E / (3 (1 - 2 nu)) = lambda + 2 mu/3.
  void complete() {
    if (youngs_modulus) {
      shear = *youngs_modulus / (2 * (1 + *poissons_ratio));
      bulk = *youngs_modulus / (3 * (1 - 2 * *poissons_ratio));
    } else {
      shear = *shear_modulus;
      bulk = *bulk_modulus;
    }
    lame = bulk - 2 * shear / 3;
  }

  static constexpr auto parameters =
      describe(number(&IsotropicModuli::youngs_modulus, {.key = "youngs_modulus",
                                                         .unit = "Pa",
                                                         .valid = positive,
                                                         .physical = between(1, 2e12),
                                                         .description = "stiffness in uniaxial tension"}),
               number(&IsotropicModuli::poissons_ratio, {.key = "poissons_ratio",
                                                         .unit = "1",
                                                         .valid = strictly_between(-1, 0.5),
                                                         .physical = between(0, 0.4999),
                                                         .description = "lateral contraction over extension"}),
               number(&IsotropicModuli::shear_modulus, {.key = "shear_modulus",
                                                        .unit = "Pa",
                                                        .valid = positive,
                                                        .physical = between(0.1, 1e12),
                                                        .description = "stiffness against change of shape"}),
               number(&IsotropicModuli::bulk_modulus, {.key = "bulk_modulus",
                                                       .unit = "Pa",
                                                       .valid = positive,
                                                       .physical = between(0.1, 1e12),
                                                       .description = "stiffness against change of volume"}),
               one_of("youngs_modulus poissons_ratio", "shear_modulus bulk_modulus"));
};

}  // namespace cleave

#endif
