#include "plugins/description.hpp"

#include "plugins/parameters.hpp"

#include <cleave/constraint.h>
#include <cleave/damage.h>
#include <cleave/discretization.h>
#include <cleave/elasticity.h>
#include <cleave/plasticity.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <sstream>

namespace cleave::plugins {
namespace {

constexpr Kind all_kinds[] = {Kind::elasticity, Kind::plasticity, Kind::damage, Kind::constraint, Kind::discretization};

[[noreturn]] void refuse(const std::string& reason) { throw Refusal(reason); }
void require(bool holds, const std::string& reason) {
  if (!holds) refuse(reason);
}

std::string text(const char* value, const std::string& what) {
  require(value != nullptr, what + " is null");
  return value;
}

/// Size of a struct in version 1.0, by its last member there: what every plugin of major version 1 has. Members that a later
/// minor version appends are looked at behind CLEAVE_HAS.
template <class Struct>
constexpr std::size_t first_size = 0;
#define CLEAVE_FIRST_SIZE(type, last) \
  template <>                         \
  constexpr std::size_t first_size<type> = offsetof(type, last) + sizeof(type::last)
CLEAVE_FIRST_SIZE(cleave_plugin, initial_state);
CLEAVE_FIRST_SIZE(cleave_about, source);
CLEAVE_FIRST_SIZE(cleave_schema, capabilities);
CLEAVE_FIRST_SIZE(cleave_parameter_schema, needs);
CLEAVE_FIRST_SIZE(cleave_state_schema, initial);
CLEAVE_FIRST_SIZE(cleave_alternatives, optional);
CLEAVE_FIRST_SIZE(cleave_elasticity, evaluate_f64);
CLEAVE_FIRST_SIZE(cleave_plasticity, return_map_f64);
CLEAVE_FIRST_SIZE(cleave_damage, drive_f64);
CLEAVE_FIRST_SIZE(cleave_constraint, project);
CLEAVE_FIRST_SIZE(cleave_discretization, restore);
#undef CLEAVE_FIRST_SIZE

template <class Struct>
const Struct& whole(const Struct* pointer, const std::string& what) {
  static_assert(first_size<Struct> > 0);
  require(pointer != nullptr, what + " is null");
  require(pointer->struct_size >= first_size<Struct>, what + " is too small: struct_size " +
                                                          std::to_string(pointer->struct_size) + ", this ABI needs " +
                                                          std::to_string(first_size<Struct>));
  return *pointer;
}

template <class Element>
const Element& element(const Element* const* array, std::uint32_t index, const std::string& what) {
  require(array != nullptr, what + "s are counted but their array is null");
  return whole(array[index], what + " " + std::to_string(index));
}

bool is_lower_word(std::string_view word, char separator) {
  if (word.empty() || word.front() == separator || word.back() == separator) return false;
  return std::all_of(word.begin(), word.end(),
                     [&](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == separator; });
}

bool is_version(const std::string& version) {
  int dots = 0;
  bool digit_before = false;
  for (char c : version) {
    if (c == '.') {
      if (!digit_before) return false;
      ++dots;
      digit_before = false;
    } else if (c >= '0' && c <= '9') {
      digit_before = true;
    } else {
      return false;
    }
  }
  return dots == 2 && digit_before;
}

bool is_tensor(std::uint32_t components) {
  return components == CLEAVE_SCALAR || components == CLEAVE_VECTOR || components == CLEAVE_SYMMETRIC ||
         components == CLEAVE_MATRIX;
}

Value default_of(const cleave_parameter_schema& schema, const std::string& what) {
  const bool has_default = !schema.required && !schema.in_set;
  const double number = has_default ? schema.default_number : 0;
  switch (schema.type) {
    case CLEAVE_TYPE_NUMBER:
      return number;
    case CLEAVE_TYPE_INTEGER:
      require(std::abs(number) < 0x1p53 && number == std::floor(number), what + " has a default that is not an integer");
      return std::int64_t(number);
    case CLEAVE_TYPE_BOOLEAN:
      return number != 0;
    case CLEAVE_TYPE_TEXT:
      return has_default ? text(schema.default_text, what + ": its default") : std::string();
    case CLEAVE_TYPE_NUMBER_LIST: {
      if (!has_default || schema.default_count == 0) return std::vector<double>();
      require(schema.default_list != nullptr, what + ": its default is null");
      return std::vector<double>(schema.default_list, schema.default_list + schema.default_count);
    }
  }
  refuse(what + " has an unknown type");
}

Parameter copy(const cleave_parameter_schema& schema, std::uint32_t index) {
  Parameter parameter;
  parameter.key = text(schema.key, "the key of parameter " + std::to_string(index));
  const std::string what = "parameter \"" + parameter.key + "\"";
  parameter.unit = text(schema.unit, what + ": its unit");
  parameter.description = text(schema.description, what + ": its description");
  require(schema.type <= CLEAVE_TYPE_NUMBER_LIST, what + " has an unknown type");
  parameter.type = cleave_type(schema.type);
  parameter.required = schema.required != 0;
  parameter.in_set = schema.in_set != 0;
  parameter.default_value = default_of(schema, what);
  parameter.min_count = schema.min_count;
  parameter.max_count = schema.max_count;
  parameter.minimum = schema.minimum;
  parameter.maximum = schema.maximum;
  parameter.minimum_open = schema.minimum_open != 0;
  parameter.maximum_open = schema.maximum_open != 0;
  parameter.physical_minimum = schema.physical_minimum;
  parameter.physical_maximum = schema.physical_maximum;
  std::copy(std::begin(schema.needs), std::end(schema.needs), parameter.needs.begin());
  require(schema.choice_count == 0 || schema.choices != nullptr, what + ": its choices are null");
  for (std::uint32_t i = 0; i < schema.choice_count; ++i)
    parameter.choices.push_back(text(schema.choices[i], what + ": one of its choices"));
  return parameter;
}

State copy(const cleave_state_schema& schema, std::uint32_t index) {
  State state;
  state.name = text(schema.name, "the name of state variable " + std::to_string(index));
  const std::string what = "state variable \"" + state.name + "\"";
  state.unit = text(schema.unit, what + ": its unit");
  state.description = text(schema.description, what + ": its description");
  require(is_tensor(schema.tensor), what + " has an unknown tensor kind");
  require(schema.monotonicity <= CLEAVE_NEVER_INCREASES, what + " has an unknown monotonicity");
  state.tensor = cleave_tensor(schema.tensor);
  state.monotonicity = cleave_monotonicity(schema.monotonicity);
  std::copy_n(schema.initial, schema.tensor, state.initial.begin());
  return state;
}

Alternatives copy(const cleave_alternatives& schema) {
  Alternatives alternatives;
  alternatives.optional = schema.optional != 0;
  require(schema.set_count == 0 || schema.sets != nullptr, "an alternative of parameters is null");
  for (std::uint32_t i = 0; i < schema.set_count; ++i) {
    std::istringstream keys(text(schema.sets[i], "a set of alternative parameters"));
    auto& set = alternatives.sets.emplace_back();
    for (std::string key; keys >> key;) set.push_back(key);
  }
  return alternatives;
}

void check_functions(Kind kind, const void* table, const Description& description) {
  const auto precisions = [&](bool single_precision, bool double_precision, const char* function) {
    require(single_precision == description.can(CLEAVE_SINGLE),
            std::string(function) + "_f32 and the capability \"single precision\" disagree");
    require(double_precision == description.can(CLEAVE_DOUBLE),
            std::string(function) + "_f64 and the capability \"double precision\" disagree");
    require(single_precision || double_precision, std::string("offers ") + function + " in no precision");
  };
  switch (kind) {
    case Kind::elasticity: {
      const auto& t = whole(static_cast<const cleave_elasticity*>(table), "the elasticity table");
      precisions(t.evaluate_f32, t.evaluate_f64, "evaluate");
      break;
    }
    case Kind::plasticity: {
      const auto& t = whole(static_cast<const cleave_plasticity*>(table), "the plasticity table");
      precisions(t.return_map_f32, t.return_map_f64, "return_map");
      break;
    }
    case Kind::damage: {
      const auto& t = whole(static_cast<const cleave_damage*>(table), "the damage table");
      require(t.model != nullptr, "the damage table has no model()");
      precisions(t.drive_f32, t.drive_f64, "drive");
      break;
    }
    case Kind::constraint: {
      const auto& t = whole(static_cast<const cleave_constraint*>(table), "the constraint table");
      require(t.project != nullptr, "the constraint table has no project()");
      break;
    }
    case Kind::discretization: {
      const auto& t = whole(static_cast<const cleave_discretization*>(table), "the discretization table");
      require(t.add_body && t.stable_step && t.step && t.point_field && t.surface && t.save && t.restore,
              "the discretization table has a null function");
      break;
    }
  }
}

void check(const Parameter& parameter) {
  const std::string what = "parameter \"" + parameter.key + "\"";
  require(is_lower_word(parameter.key, '_'), what + ": a key is made of lower case letters, digits and '_'");
  require(!parameter.description.empty(), what + " has no description");
  const bool numeric = parameter.type != CLEAVE_TYPE_BOOLEAN && parameter.type != CLEAVE_TYPE_TEXT;
  require(!numeric || !parameter.unit.empty(), what + " has no unit (\"1\" if dimensionless)");
  require(parameter.minimum <= parameter.maximum, what + " has a minimum above its maximum");
  require(parameter.physical_minimum <= parameter.physical_maximum, what + " has a physical minimum above its maximum");
  require(parameter.min_count <= parameter.max_count, what + " has a minimum length above its maximum");
  require(!(parameter.required && parameter.in_set), what + " is both required and one of alternatives");
  require(parameter.type == CLEAVE_TYPE_TEXT || parameter.choices.empty(), what + " has choices but is no text");
  if (!parameter.required && !parameter.in_set)
    if (const auto problem = problem_with(parameter, parameter.default_value)) refuse(what + ": its default " + *problem);
}

void check(const State& state) {
  const std::string what = "state variable \"" + state.name + "\"";
  require(is_lower_word(state.name, '_'), what + ": a name is made of lower case letters, digits and '_'");
  require(!state.description.empty(), what + " has no description");
  require(!state.unit.empty(), what + " has no unit (\"1\" if dimensionless)");
  for (double value : state.initial) require(std::isfinite(value), what + " has an initial value that is not finite");
}

}  // namespace

std::optional<Kind> kind_of_id(std::string_view id) {
  const auto slash = id.find('/');
  if (slash == std::string_view::npos || !is_lower_word(id.substr(slash + 1), '-')) return std::nullopt;
  for (Kind kind : all_kinds)
    if (id.substr(0, slash) == name(kind)) return kind;
  return std::nullopt;
}

const char* kind_id(Kind kind) {
  switch (kind) {
    case Kind::elasticity:
      return CLEAVE_KIND_ELASTICITY;
    case Kind::plasticity:
      return CLEAVE_KIND_PLASTICITY;
    case Kind::damage:
      return CLEAVE_KIND_DAMAGE;
    case Kind::constraint:
      return CLEAVE_KIND_CONSTRAINT;
    case Kind::discretization:
      return CLEAVE_KIND_DISCRETIZATION;
  }
  return "";
}

void check_abi(cleave_version version) {
  if (version.major == CLEAVE_ABI_MAJOR && version.minor <= CLEAVE_ABI_MINOR) return;
  const auto text = [](std::uint32_t major, std::uint32_t minor) {
    return std::to_string(major) + "." + std::to_string(minor);
  };
  refuse("speaks plugin ABI " + text(version.major, version.minor) + ", this host speaks " +
         text(CLEAVE_ABI_MAJOR, CLEAVE_ABI_MINOR) + " and older minors; rebuild it with this host's SDK");
}

Description describe(const cleave_plugin& plugin) {
  Description description;
  description.abi_major = plugin.abi.major;
  description.abi_minor = plugin.abi.minor;
  whole(&plugin, "the plugin table");
  require(plugin.kind && plugin.extension && plugin.create && plugin.destroy, "the plugin table has a null function");

  const auto& about = whole(plugin.about, "the plugin's \"about\"");
  description.id = text(about.id, "the plugin's id");
  description.version = text(about.version, "the plugin's version");
  description.author = text(about.author, "the plugin's author");
  description.summary = text(about.summary, "the plugin's summary");
  description.source = text(about.source, "the plugin's source");

  const auto& schema = whole(plugin.schema, "the plugin's schema");
  description.capabilities = schema.capabilities;
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i)
    description.parameters.push_back(copy(element(schema.parameters, i, "parameter"), i));
  for (std::uint32_t i = 0; i < schema.state_count; ++i)
    description.states.push_back(copy(element(schema.states, i, "state variable"), i));
  for (std::uint32_t i = 0; i < schema.alternatives_count; ++i)
    description.alternatives.push_back(copy(element(schema.alternatives, i, "alternative")));

  const auto kind = kind_of_id(description.id);
  require(kind.has_value(), "its id \"" + description.id + "\" is not of the form kind/name with a known kind");
  description.kind = *kind;
  const void* table = plugin.kind(kind_id(*kind));
  require(table != nullptr, "it is named \"" + description.id + "\" but offers no \"" + kind_id(*kind) + "\"");
  check_functions(*kind, table, description);
  check(description);
  return description;
}

void check(const Description& description) {
  const auto kind = kind_of_id(description.id);
  require(kind == description.kind, "its id \"" + description.id + "\" is not of the form kind/name with a known kind");
  require(is_version(description.version), "its version \"" + description.version + "\" is not major.minor.patch");
  require(!description.summary.empty(), "it has no summary");
  std::set<std::string> keys, names;
  for (const auto& parameter : description.parameters) {
    check(parameter);
    require(keys.insert(parameter.key).second, "parameter \"" + parameter.key + "\" is declared twice");
  }
  for (const auto& state : description.states) {
    check(state);
    require(names.insert(state.name).second, "state variable \"" + state.name + "\" is declared twice");
  }
  require(description.state_components() <= int(CLEAVE_MAX_STATE),
          "it declares " + std::to_string(description.state_components()) + " state components, at most " +
              std::to_string(CLEAVE_MAX_STATE) + " are allowed");
  std::set<std::string> in_sets;
  for (const auto& alternatives : description.alternatives) {
    require(!alternatives.sets.empty(), "it declares alternatives without any set");
    for (const auto& set : alternatives.sets) {
      require(!set.empty(), "it declares an empty set of alternative parameters");
      in_sets.insert(set.begin(), set.end());
    }
  }
  for (const auto& parameter : description.parameters)
    require(parameter.in_set == (in_sets.count(parameter.key) == 1),
            "parameter \"" + parameter.key + "\" and the sets of alternatives disagree about each other");
  for (const auto& key : in_sets)
    require(keys.count(key) == 1, "a set of alternatives names \"" + key + "\", which does not exist");
  const bool point_law = description.kind == Kind::elasticity || description.kind == Kind::plasticity;
  require(!point_law || description.can(CLEAVE_ACCEPTS_B) || description.can(CLEAVE_ACCEPTS_F), "it accepts neither b nor F");
}

}  // namespace cleave::plugins
