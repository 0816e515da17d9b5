/// What an author says about a plugin: identity and what the formulas take.
#ifndef CLEAVE_ABOUT_HPP
#define CLEAVE_ABOUT_HPP

#include "abi.h"

#include <cstdint>
#include <string_view>

namespace cleave {

/// Every law has one: `static constexpr About about{.id = "elasticity/my-law", ...}`.
struct About {
  const char* id;                 ///< "kind/name": lower case letters, digits and '-', stable for ever
  const char* version = "1.0.0";  ///< "major.minor.patch"
  const char* author = "";
  const char* summary;      ///< one line
  const char* source = "";  ///< paper and equations the formulas are from
  double budget = 0;        ///< [ns] cleave_about::budget_ns, held against the clock by `cleave check`; 0: nothing is said
};

/// The strain measure a law's formulas are written in: `static constexpr Accepts accepts = ...`.
enum class Accepts {
  left_cauchy_green,     ///< b = F F^T, six numbers: isotropic laws. The host may store b in place of F; given F, b is formed
  deformation_gradient,  ///< F, nine numbers
};

namespace detail {

enum class Kind { elasticity, plasticity, damage, constraint, discretization, unknown };

constexpr Kind kind_of(std::string_view id) {
  if (id.starts_with("elasticity/")) return Kind::elasticity;
  if (id.starts_with("plasticity/")) return Kind::plasticity;
  if (id.starts_with("damage/")) return Kind::damage;
  if (id.starts_with("constraint/")) return Kind::constraint;
  if (id.starts_with("discretization/")) return Kind::discretization;
  return Kind::unknown;
}

}  // namespace detail
}  // namespace cleave

#endif
