// What the manifest of a plugin library says: the text cleave-manifest writes beside it, and conformance checks compare with.
#ifndef CLEAVE_TOOLS_MANIFEST_TEXT_HPP
#define CLEAVE_TOOLS_MANIFEST_TEXT_HPP

#include <cleave/abi.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <sstream>
#include <string>

namespace cleave::manifest {

/// Why a plugin cannot be described.
struct Failure {
  std::string reason;
};

inline std::string quoted(const char* text) {
  if (!text) throw Failure{"a text of the plugin's description is null"};
  std::string result = "\"";
  for (; *text; ++text) {
    const auto c = static_cast<unsigned char>(*text);
    if (c == '"' || c == '\\') {
      result += '\\';
      result += *text;
    } else if (c < 0x20 || c == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04X", c);
      result += escape;
    } else {
      result += *text;
    }
  }
  return result + '"';
}

/// The shortest TOML float that reads back as the same double.
inline std::string number(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  char text[40];
  std::string result(text, std::to_chars(text, text + sizeof text, value).ptr);
  if (result.find_first_of(".e") == std::string::npos) result += ".0";
  return result;
}

inline const char* boolean(std::uint32_t value) { return value ? "true" : "false"; }

inline const char* type_name(std::uint32_t type) {
  switch (type) {
    case CLEAVE_TYPE_NUMBER:
      return "number";
    case CLEAVE_TYPE_INTEGER:
      return "integer";
    case CLEAVE_TYPE_BOOLEAN:
      return "boolean";
    case CLEAVE_TYPE_TEXT:
      return "text";
    case CLEAVE_TYPE_NUMBER_LIST:
      return "number_list";
  }
  throw Failure{"a parameter has an unknown type"};
}

inline const char* tensor_name(std::uint32_t tensor) {
  switch (tensor) {
    case CLEAVE_SCALAR:
      return "scalar";
    case CLEAVE_VECTOR:
      return "vector";
    case CLEAVE_SYMMETRIC:
      return "symmetric";
    case CLEAVE_MATRIX:
      return "matrix";
  }
  throw Failure{"a state variable has an unknown tensor kind"};
}

inline const char* monotonicity_name(std::uint32_t monotonicity) {
  switch (monotonicity) {
    case CLEAVE_FREE:
      return "free";
    case CLEAVE_NEVER_DECREASES:
      return "never_decreases";
    case CLEAVE_NEVER_INCREASES:
      return "never_increases";
  }
  throw Failure{"a state variable has an unknown monotonicity"};
}

inline std::string number_list(const double* values, std::uint32_t count) {
  std::string text = "[";
  for (std::uint32_t i = 0; i < count; ++i) text += (i ? ", " : "") + number(values[i]);
  return text + "]";
}

inline std::string default_text(const cleave_parameter_schema& p) {
  switch (p.type) {
    case CLEAVE_TYPE_NUMBER:
      return number(p.default_number);
    case CLEAVE_TYPE_INTEGER:
      return std::to_string(static_cast<long long>(p.default_number));
    case CLEAVE_TYPE_BOOLEAN:
      return boolean(p.default_number != 0);
    case CLEAVE_TYPE_TEXT:
      return quoted(p.default_text);
    default:
      return number_list(p.default_list, p.default_count);
  }
}

inline void write_parameter(std::ostream& out, const cleave_parameter_schema& p) {
  out << "\n[[parameter]]\nkey = " << quoted(p.key) << "\ntype = \"" << type_name(p.type) << "\"\nunit = " << quoted(p.unit)
      << "\ndescription = " << quoted(p.description) << "\nrequired = " << boolean(p.required)
      << "\nin_set = " << boolean(p.in_set) << '\n';
  if (!p.required && !p.in_set) out << "default = " << default_text(p) << '\n';
  out << "min_count = " << p.min_count << "\nmax_count = " << p.max_count << "\nminimum = " << number(p.minimum)
      << "\nmaximum = " << number(p.maximum) << "\nminimum_open = " << boolean(p.minimum_open)
      << "\nmaximum_open = " << boolean(p.maximum_open) << "\nphysical_minimum = " << number(p.physical_minimum)
      << "\nphysical_maximum = " << number(p.physical_maximum) << "\nchoices = [";
  for (std::uint32_t i = 0; i < p.choice_count; ++i) out << (i ? ", " : "") << quoted(p.choices[i]);
  out << "]\nneeds = [" << p.needs[0] << ", " << p.needs[1] << "]\n";
}

inline void write_alternatives(std::ostream& out, const cleave_alternatives& alternatives) {
  out << "\n[[alternatives]]\noptional = " << boolean(alternatives.optional) << "\nsets = [";
  for (std::uint32_t i = 0; i < alternatives.set_count; ++i) {
    std::istringstream keys(alternatives.sets[i]);
    out << (i ? ", [" : "[");
    bool first = true;
    for (std::string key; keys >> key; first = false) out << (first ? "" : ", ") << quoted(key.c_str());
    out << "]";
  }
  out << "]\n";
}

inline std::string manifest(const cleave_plugin& plugin, std::uintmax_t library_bytes) {
  const auto& about = *plugin.about;
  const auto& schema = *plugin.schema;
  const std::string id = about.id;
  std::ostringstream out;
  out << "# Written by cleave-manifest when the library was built.\n"
      << "id = " << quoted(about.id) << "\nkind = " << quoted(id.substr(0, id.find('/')).c_str())
      << "\nversion = " << quoted(about.version) << "\nauthor = " << quoted(about.author)
      << "\nsummary = " << quoted(about.summary) << "\nsource = " << quoted(about.source) << "\nabi = [" << plugin.abi.major
      << ", " << plugin.abi.minor << "]\ncapabilities = " << schema.capabilities << "\nlibrary_bytes = " << library_bytes
      << '\n';
  for (std::uint32_t i = 0; i < schema.alternatives_count; ++i) write_alternatives(out, *schema.alternatives[i]);
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i) write_parameter(out, *schema.parameters[i]);
  for (std::uint32_t i = 0; i < schema.state_count; ++i) {
    const auto& state = *schema.states[i];
    out << "\n[[state]]\nname = " << quoted(state.name) << "\ntensor = \"" << tensor_name(state.tensor)
        << "\"\nunit = " << quoted(state.unit) << "\ndescription = " << quoted(state.description) << "\nmonotonicity = \""
        << monotonicity_name(state.monotonicity) << "\"\ninitial = " << number_list(state.initial, state.tensor) << '\n';
  }
  return out.str();
}

}  // namespace cleave::manifest

#endif
