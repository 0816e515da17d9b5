// cleave-manifest LIBRARY [OUTPUT]
//
// Writes what a plugin library says of itself as TOML, by default to NAME.cleave.toml beside NAME.so, so that hosts can list
// the plugin without running its code. The library's size in bytes is recorded; a manifest counts only while it matches.
#include <cleave/abi.h>

#include <dlfcn.h>

#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

namespace {

struct Failure {
  std::string reason;
};

std::string quoted(const char* text) {
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
std::string number(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  char text[40];
  std::string result(text, std::to_chars(text, text + sizeof text, value).ptr);
  if (result.find_first_of(".e") == std::string::npos) result += ".0";
  return result;
}

const char* boolean(std::uint32_t value) { return value ? "true" : "false"; }

const char* type_name(std::uint32_t type) {
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

const char* tensor_name(std::uint32_t tensor) {
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

const char* monotonicity_name(std::uint32_t monotonicity) {
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

std::string number_list(const double* values, std::uint32_t count) {
  std::string text = "[";
  for (std::uint32_t i = 0; i < count; ++i) text += (i ? ", " : "") + number(values[i]);
  return text + "]";
}

std::string default_text(const cleave_parameter_schema& p) {
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

void write_parameter(std::ostream& out, const cleave_parameter_schema& p) {
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

void write_alternatives(std::ostream& out, const cleave_alternatives& alternatives) {
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

std::string manifest(const cleave_plugin& plugin, std::uintmax_t library_bytes) {
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

const cleave_plugin& load(const std::filesystem::path& library) {
  // Never closed: the process ends with the manifest written.
  void* handle = dlopen(std::filesystem::absolute(library).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) throw Failure{dlerror()};
  const auto entry = reinterpret_cast<cleave_plugin_entry_fn>(dlsym(handle, CLEAVE_ENTRY_SYMBOL));
  if (!entry) throw Failure{"exports no " CLEAVE_ENTRY_SYMBOL};
  const cleave_host host{sizeof host, {CLEAVE_ABI_MAJOR, CLEAVE_ABI_MINOR}, "cleave-manifest", "1.0.0"};
  const cleave_plugin* plugin = nullptr;
  const cleave_result result = entry(&host, &plugin);
  if (result != CLEAVE_OK || !plugin) throw Failure{CLEAVE_ENTRY_SYMBOL " failed with result " + std::to_string(result)};
  if (plugin->abi.major != CLEAVE_ABI_MAJOR) throw Failure{"speaks another plugin ABI than this program"};
  if (!plugin->about || !plugin->schema) throw Failure{"describes neither itself nor its parameters"};
  return *plugin;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::cerr << "usage: cleave-manifest LIBRARY [OUTPUT]\n";
    return 2;
  }
  const std::filesystem::path library = argv[1];
  const auto output =
      argc == 3 ? std::filesystem::path(argv[2]) : std::filesystem::path(library).replace_extension(".cleave.toml");
  try {
    const std::string text = manifest(load(library), std::filesystem::file_size(library));
    std::ofstream file(output, std::ios::binary);
    file << text;
    if (!file.flush()) throw Failure{"cannot write " + output.string()};
  } catch (const Failure& failure) {
    std::cerr << "cleave-manifest: " << library.string() << ": " << failure.reason << '\n';
    return 1;
  } catch (const std::exception& error) {
    std::cerr << "cleave-manifest: " << library.string() << ": " << error.what() << '\n';
    return 1;
  }
  return 0;
}
