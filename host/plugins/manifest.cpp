#include "plugins/manifest.hpp"

#include "common/nesting.hpp"
#include "plugins/description.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>

namespace cleave::plugins {
namespace {

constexpr std::uintmax_t largest_manifest = 1 << 20;

/// Ends the reading of a manifest that is not what cleave-manifest writes.
struct Malformed {};

template <class T>
T get(const toml::table& table, std::string_view key) {
  const auto value = table[key].value<T>();
  if (!value) throw Malformed{};
  return *value;
}

template <class T>
std::vector<T> list(const toml::table& table, std::string_view key) {
  const toml::array* array = table[key].as_array();
  if (!array) throw Malformed{};
  std::vector<T> values;
  for (const auto& node : *array) {
    const auto value = node.value<T>();
    if (!value) throw Malformed{};
    values.push_back(*value);
  }
  return values;
}

/// Tables of an array of tables; an absent array is an empty one.
std::vector<const toml::table*> tables(const toml::table& parent, std::string_view key) {
  std::vector<const toml::table*> found;
  if (!parent.contains(key)) return found;
  const toml::array* array = parent[key].as_array();
  if (!array) throw Malformed{};
  for (const auto& node : *array) {
    if (!node.is_table()) throw Malformed{};
    found.push_back(node.as_table());
  }
  return found;
}

/// Enumerators by the words the manifest uses for them.
template <class Enum, std::size_t N>
Enum named(const std::pair<const char*, Enum> (&names)[N], const std::string& word) {
  for (const auto& [name, value] : names)
    if (word == name) return value;
  throw Malformed{};
}

constexpr std::pair<const char*, cleave_type> types[] = {{"number", CLEAVE_TYPE_NUMBER},
                                                         {"integer", CLEAVE_TYPE_INTEGER},
                                                         {"boolean", CLEAVE_TYPE_BOOLEAN},
                                                         {"text", CLEAVE_TYPE_TEXT},
                                                         {"number_list", CLEAVE_TYPE_NUMBER_LIST}};
constexpr std::pair<const char*, cleave_tensor> tensors[] = {
    {"scalar", CLEAVE_SCALAR}, {"vector", CLEAVE_VECTOR}, {"symmetric", CLEAVE_SYMMETRIC}, {"matrix", CLEAVE_MATRIX}};
constexpr std::pair<const char*, cleave_monotonicity> monotonicities[] = {
    {"free", CLEAVE_FREE}, {"never_decreases", CLEAVE_NEVER_DECREASES}, {"never_increases", CLEAVE_NEVER_INCREASES}};

/// A default is written only where the schema has one; elsewhere it is the empty value of the type.
Value default_value(const toml::table& table, cleave_type type) {
  const bool written = table.contains("default");
  switch (type) {
    case CLEAVE_TYPE_NUMBER:
      return written ? get<double>(table, "default") : 0.0;
    case CLEAVE_TYPE_INTEGER:
      return written ? get<std::int64_t>(table, "default") : std::int64_t(0);
    case CLEAVE_TYPE_BOOLEAN:
      return written && get<bool>(table, "default");
    case CLEAVE_TYPE_TEXT:
      return written ? get<std::string>(table, "default") : std::string();
    case CLEAVE_TYPE_NUMBER_LIST:
      return written ? list<double>(table, "default") : std::vector<double>();
  }
  throw Malformed{};
}

Parameter read_parameter(const toml::table& table) {
  Parameter parameter;
  parameter.key = get<std::string>(table, "key");
  parameter.type = named(types, get<std::string>(table, "type"));
  parameter.unit = get<std::string>(table, "unit");
  parameter.description = get<std::string>(table, "description");
  parameter.required = get<bool>(table, "required");
  parameter.in_set = get<bool>(table, "in_set");
  parameter.default_value = default_value(table, parameter.type);
  parameter.min_count = get<std::uint32_t>(table, "min_count");
  parameter.max_count = get<std::uint32_t>(table, "max_count");
  parameter.minimum = get<double>(table, "minimum");
  parameter.maximum = get<double>(table, "maximum");
  parameter.minimum_open = get<bool>(table, "minimum_open");
  parameter.maximum_open = get<bool>(table, "maximum_open");
  parameter.physical_minimum = get<double>(table, "physical_minimum");
  parameter.physical_maximum = get<double>(table, "physical_maximum");
  parameter.choices = list<std::string>(table, "choices");
  const auto needs = list<std::int64_t>(table, "needs");
  if (needs.size() != parameter.needs.size()) throw Malformed{};
  std::copy(needs.begin(), needs.end(), parameter.needs.begin());
  return parameter;
}

State read_state(const toml::table& table) {
  State state;
  state.name = get<std::string>(table, "name");
  state.unit = get<std::string>(table, "unit");
  state.description = get<std::string>(table, "description");
  state.tensor = named(tensors, get<std::string>(table, "tensor"));
  state.monotonicity = named(monotonicities, get<std::string>(table, "monotonicity"));
  const auto initial = list<double>(table, "initial");
  if (initial.size() != std::size_t(state.tensor)) throw Malformed{};
  std::copy(initial.begin(), initial.end(), state.initial.begin());
  return state;
}

Alternatives read_alternatives(const toml::table& table) {
  Alternatives alternatives;
  alternatives.optional = get<bool>(table, "optional");
  const toml::array* sets = table["sets"].as_array();
  if (!sets) throw Malformed{};
  for (const auto& node : *sets) {
    const toml::array* keys = node.as_array();
    if (!keys) throw Malformed{};
    auto& set = alternatives.sets.emplace_back();
    for (const auto& key : *keys) {
      const auto word = key.value<std::string>();
      if (!word) throw Malformed{};
      set.push_back(*word);
    }
  }
  return alternatives;
}

Description read_description(const toml::table& table) {
  Description description;
  description.id = get<std::string>(table, "id");
  description.version = get<std::string>(table, "version");
  description.author = get<std::string>(table, "author");
  description.summary = get<std::string>(table, "summary");
  description.source = get<std::string>(table, "source");
  const auto abi = list<std::uint32_t>(table, "abi");
  if (abi.size() != 2) throw Malformed{};
  description.abi_major = abi[0];
  description.abi_minor = abi[1];
  description.capabilities = std::uint64_t(get<std::int64_t>(table, "capabilities"));
  for (const auto* parameter : tables(table, "parameter")) description.parameters.push_back(read_parameter(*parameter));
  for (const auto* state : tables(table, "state")) description.states.push_back(read_state(*state));
  for (const auto* set : tables(table, "alternatives")) description.alternatives.push_back(read_alternatives(*set));
  const auto kind = kind_of_id(description.id);
  if (!kind) throw Malformed{};
  description.kind = *kind;
  return description;
}

}  // namespace

std::filesystem::path manifest_path(const std::filesystem::path& library) {
  return std::filesystem::path(library).replace_extension(".cleave.toml");
}

std::optional<Description> read_manifest(const std::filesystem::path& library) {
  const auto path = manifest_path(library);
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  const auto size = std::filesystem::file_size(library, error);
  if (error) return std::nullopt;
  if (std::filesystem::file_size(path, error) > largest_manifest || error) return std::nullopt;
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file || line_nested_too_deep(text.view()) > 0) return std::nullopt;
  try {
    const toml::table table = toml::parse(text.view(), path.string());
    if (get<std::int64_t>(table, "library_bytes") != std::int64_t(size)) return std::nullopt;
    const auto abi = list<std::uint32_t>(table, "abi");
    if (abi.size() == 2) check_abi({abi[0], abi[1]});
    Description description = read_description(table);
    check(description);
    return description;
  } catch (const toml::parse_error&) {
    return std::nullopt;
  } catch (const Malformed&) {
    return std::nullopt;
  }
}

}  // namespace cleave::plugins
