#pragma once

#include <cleave/abi.h>

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace cleave::plugins {

enum class Kind { elasticity, plasticity, damage, constraint, discretization };

/// Value of a plugin parameter, in the alternative that matches its schema's type.
using Value = std::variant<double, std::int64_t, bool, std::string, std::vector<double>>;

/// Host-side copies of the ABI's schema structs: read from a manifest or from a loaded plugin, equal either way.
struct Parameter {
  std::string key, unit, description;
  cleave_type type = CLEAVE_TYPE_NUMBER;
  bool required = false;
  bool in_set = false;  ///< belongs to an alternative set
  Value default_value;
  std::uint32_t min_count = 0, max_count = 0;  ///< of number lists
  double minimum, maximum;                     ///< validity, infinite if unbounded
  bool minimum_open = false, maximum_open = false;
  double physical_minimum, physical_maximum;
  std::vector<std::string> choices;
  std::array<std::uint64_t, 2> needs{};  ///< capabilities the law has only where element 0, 1 of the value is not zero
  bool operator==(const Parameter&) const = default;
};

struct State {
  std::string name, unit, description;
  cleave_tensor tensor = CLEAVE_SCALAR;  ///< its value is the number of components
  cleave_monotonicity monotonicity = CLEAVE_FREE;
  std::array<double, 9> initial{};
  bool operator==(const State&) const = default;
};

struct Alternatives {
  std::vector<std::vector<std::string>> sets;  ///< of keys
  bool optional = false;
  bool operator==(const Alternatives&) const = default;
};

/// A parameter by key, as a scene gives it. Keys not given take the schema's default.
using GivenParameters = std::map<std::string, Value, std::less<>>;

struct Description {
  std::string id;  ///< "elasticity/qr"
  std::string version, author, summary, source;
  Kind kind = Kind::elasticity;
  std::uint32_t abi_major = 0, abi_minor = 0;
  std::vector<Parameter> parameters;
  std::vector<State> states;
  std::vector<Alternatives> alternatives;
  std::uint64_t capabilities = 0;  ///< union of cleave_capability, whatever the parameters

  /// With those that depend on parameters.
  std::uint64_t capabilities_with(const GivenParameters&) const;
  bool can(cleave_capability c) const { return (capabilities & c) != 0; }
  int state_components() const {
    int n = 0;
    for (const auto& s : states) n += int(s.tensor);
    return n;
  }
  bool operator==(const Description&) const = default;
};

const char* name(Kind);                                    ///< "elasticity"
std::vector<std::string> capability_names(std::uint64_t);  ///< {"accepts b", "energy", ...}

}  // namespace cleave::plugins
