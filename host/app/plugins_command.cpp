#include "app/plugins_command.hpp"

#include "common/error.hpp"
#include "plugins/parameters.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

namespace cleave::app {
namespace {

using plugins::Description;
using plugins::Found;
using plugins::Parameter;
using plugins::Registry;
using plugins::State;

constexpr plugins::Kind kinds[] = {plugins::Kind::elasticity, plugins::Kind::plasticity, plugins::Kind::damage,
                                   plugins::Kind::constraint, plugins::Kind::discretization};

const Found& usable(const Registry& registry, const std::string& id) {
  for (const Found& found : registry.found())
    if (found.refusal.empty() && found.description->id == id) return found;
  throw InputError(registry.unknown_id(id));
}

const char* type_word(cleave_type type) {
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
      return "list of numbers";
  }
  return "";
}

const char* tensor_word(cleave_tensor tensor) {
  switch (tensor) {
    case CLEAVE_SCALAR:
      return "scalar";
    case CLEAVE_VECTOR:
      return "vector";
    case CLEAVE_SYMMETRIC:
      return "symmetric tensor";
    case CLEAVE_MATRIX:
      return "tensor";
  }
  return "";
}

const char* monotonicity_word(cleave_monotonicity monotonicity) {
  switch (monotonicity) {
    case CLEAVE_FREE:
      return "free";
    case CLEAVE_NEVER_DECREASES:
      return "never decreases";
    case CLEAVE_NEVER_INCREASES:
      return "never increases";
  }
  return "";
}

bool has_default(const Parameter& parameter) { return !parameter.required && !parameter.in_set; }

std::vector<double> initial_values(const State& state) {
  return {state.initial.begin(), state.initial.begin() + int(state.tensor)};
}

// ---------------------------------------------------------------- JSON

template <class Range>
toml::array array_of(const Range& values) {
  toml::array array;
  for (const auto& value : values) array.push_back(value);
  return array;
}

/// JSON knows no infinity: a bound that is none is left out.
void insert_bound(toml::table& table, const char* key, double bound) {
  if (std::isfinite(bound)) table.insert(key, bound);
}

toml::table to_json(const Parameter& parameter) {
  toml::table table{{"key", parameter.key},           {"type", type_word(parameter.type)},
                    {"unit", parameter.unit},         {"description", parameter.description},
                    {"required", parameter.required}, {"alternative", parameter.in_set}};
  if (has_default(parameter)) {
    if (const auto* list = std::get_if<std::vector<double>>(&parameter.default_value))
      table.insert("default", array_of(*list));
    else
      std::visit(
          [&](const auto& value) {
            if constexpr (!std::is_same_v<std::decay_t<decltype(value)>, std::vector<double>>) table.insert("default", value);
          },
          parameter.default_value);
  }
  insert_bound(table, "minimum", parameter.minimum);
  insert_bound(table, "maximum", parameter.maximum);
  if (parameter.minimum_open) table.insert("minimum_open", true);
  if (parameter.maximum_open) table.insert("maximum_open", true);
  insert_bound(table, "physical_minimum", parameter.physical_minimum);
  insert_bound(table, "physical_maximum", parameter.physical_maximum);
  if (!parameter.choices.empty()) table.insert("choices", array_of(parameter.choices));
  if (parameter.type == CLEAVE_TYPE_NUMBER_LIST) {
    table.insert("min_count", std::int64_t(parameter.min_count));
    table.insert("max_count", std::int64_t(parameter.max_count));
  }
  if (parameter.needs != decltype(parameter.needs){})
    table.insert("capabilities_if_not_zero", toml::array{array_of(plugins::capability_names(parameter.needs[0])),
                                                         array_of(plugins::capability_names(parameter.needs[1]))});
  return table;
}

toml::table to_json(const State& state) {
  return toml::table{{"name", state.name},
                     {"tensor", tensor_word(state.tensor)},
                     {"unit", state.unit},
                     {"description", state.description},
                     {"monotonicity", monotonicity_word(state.monotonicity)},
                     {"initial", array_of(initial_values(state))}};
}

toml::table to_json(const Found& found) {
  const Description& description = *found.description;
  toml::array parameters, states, alternatives;
  for (const auto& parameter : description.parameters) parameters.push_back(to_json(parameter));
  for (const auto& state : description.states) states.push_back(to_json(state));
  for (const auto& alternative : description.alternatives) {
    toml::array sets;
    for (const auto& set : alternative.sets) sets.push_back(array_of(set));
    alternatives.push_back(toml::table{{"optional", alternative.optional}, {"sets", std::move(sets)}});
  }
  return toml::table{
      {"id", description.id},
      {"kind", plugins::name(description.kind)},
      {"version", description.version},
      {"author", description.author},
      {"summary", description.summary},
      {"source", description.source},
      {"abi", fmt::format("{}.{}", description.abi_major, description.abi_minor)},
      {"path", found.path.string()},
      {"from_manifest", found.from_manifest},
      {"capabilities", array_of(plugins::capability_names(description.capabilities))},
      {"parameters", std::move(parameters)},
      {"alternatives", std::move(alternatives)},
      {"states", std::move(states)},
  };
}

std::string json_text(const toml::table& table) {
  std::ostringstream text;
  text << toml::json_formatter(table) << '\n';
  return text.str();
}

std::string list_json(const Registry& registry) {
  toml::array search_path, usable_plugins, refused;
  for (const auto& directory : registry.search_path()) search_path.push_back(directory.string());
  for (const Found& found : registry.found()) {
    if (found.refusal.empty())
      usable_plugins.push_back(to_json(found));
    else
      refused.push_back(toml::table{{"path", found.path.string()}, {"reason", found.refusal}});
  }
  return json_text(toml::table{
      {"search_path", std::move(search_path)}, {"plugins", std::move(usable_plugins)}, {"refused", std::move(refused)}});
}

// ---------------------------------------------------------------- text

std::string joined(const std::vector<std::string>& words, const char* separator) {
  return fmt::format("{}", fmt::join(words, separator));
}

std::string list_text(const Registry& registry) {
  std::string text;
  std::size_t width = 0;
  for (const Found& found : registry.found())
    if (found.refusal.empty()) width = std::max(width, found.description->id.size());
  for (const auto kind : kinds)
    for (const auto& id : registry.ids(kind)) {
      const Description& description = *registry.find(id);
      text += fmt::format("{:<{}}  {:<7} {}\n", id, width, description.version, description.summary);
    }
  if (text.empty()) text = "no plugins found\n";
  const auto refused = std::count_if(registry.found().begin(), registry.found().end(),
                                     [](const Found& found) { return !found.refusal.empty(); });
  if (refused > 0) text += fmt::format("{} refused; --explain says why\n", refused);
  return text;
}

std::string explanation(const Registry& registry) {
  std::string text = "\nsearch path\n";
  for (const auto& directory : registry.search_path()) {
    std::error_code error;
    const bool exists = std::filesystem::is_directory(directory, error);
    text += fmt::format("  {}{}\n", directory.string(), exists ? "" : "  (does not exist)");
  }
  text += "\nfiles\n";
  for (const Found& found : registry.found()) {
    text += fmt::format("  {}\n", found.path.string());
    if (found.refusal.empty())
      text += fmt::format("    {}, {}\n", found.description->id,
                          found.from_manifest ? "described by its manifest" : "described by the library itself");
    else
      text += fmt::format("    refused: {}\n", found.refusal);
  }
  return text;
}

std::string parameter_text(const Parameter& parameter) {
  std::string line = parameter.key;
  if (!parameter.unit.empty() && parameter.unit != "1") line += " [" + parameter.unit + "]";
  line += fmt::format(", {}", type_word(parameter.type));
  if (!parameter.choices.empty()) line += ": " + joined(parameter.choices, " | ");
  if (parameter.type == CLEAVE_TYPE_NUMBER_LIST) line += fmt::format(" ({} to {})", parameter.min_count, parameter.max_count);
  if (parameter.required) line += ", required";
  if (has_default(parameter)) line += ", default " + plugins::value_text(parameter.default_value);
  std::string text = fmt::format("  {}\n      {}\n", line, parameter.description);
  if (parameter.type == CLEAVE_TYPE_BOOLEAN || parameter.type == CLEAVE_TYPE_TEXT) return text;
  const std::string valid = plugins::bounds_text(parameter.minimum, parameter.minimum_open, parameter.maximum,
                                                 parameter.maximum_open, parameter.unit);
  if (valid != "finite") text += fmt::format("      {}", valid);
  const std::string usual =
      plugins::bounds_text(parameter.physical_minimum, false, parameter.physical_maximum, false, parameter.unit);
  const bool narrower = parameter.physical_minimum != parameter.minimum || parameter.physical_maximum != parameter.maximum;
  if (narrower) text += fmt::format("{}usually {}", valid != "finite" ? "; " : "      ", usual);
  if (valid != "finite" || narrower) text += '\n';
  const bool list = parameter.type == CLEAVE_TYPE_NUMBER_LIST;
  for (std::size_t i = 0; i < parameter.needs.size(); ++i)
    if (const auto needs = plugins::capability_names(parameter.needs[i]); !needs.empty())
      text += fmt::format("      where {} is not 0: {}\n", list ? fmt::format("element {}", i) : "it", joined(needs, ", "));
  return text;
}

std::string describe_text(const Found& found) {
  const Description& description = *found.description;
  std::string text = fmt::format("{} {}\n{}\n", description.id, description.version, description.summary);
  if (!description.source.empty()) text += fmt::format("source: {}\n", description.source);
  if (!description.author.empty()) text += fmt::format("author: {}\n", description.author);
  text += fmt::format("library: {}\ncapabilities: {}\n", found.path.string(),
                      joined(plugins::capability_names(description.capabilities), ", "));
  text += description.parameters.empty() ? "\nno parameters\n" : "\nparameters\n";
  for (const auto& parameter : description.parameters) text += parameter_text(parameter);
  for (const auto& alternatives : description.alternatives) {
    std::vector<std::string> sets;
    for (const auto& set : alternatives.sets) sets.push_back(joined(set, " and "));
    text += fmt::format("  {} {}\n", alternatives.optional ? "at most one of:" : "give one of:", joined(sets, ", or "));
  }
  text += description.states.empty() ? "\nno state\n" : "\nstate of every point\n";
  for (const auto& state : description.states) {
    const auto initial = initial_values(state);
    text += fmt::format("  {}{}, {}, starts at {}", state.name, state.unit == "1" ? "" : " [" + state.unit + "]",
                        tensor_word(state.tensor),
                        initial.size() == 1 ? plugins::number_text(initial[0]) : plugins::value_text(initial));
    if (state.monotonicity != CLEAVE_FREE) text += fmt::format(", {}", monotonicity_word(state.monotonicity));
    text += fmt::format("\n      {}\n", state.description);
  }
  return text;
}

// ---------------------------------------------------------------- Markdown

/// Text in the cell of a table.
std::string cell(const std::string& text) {
  std::string escaped;
  for (const char c : text) escaped += c == '|' ? std::string("\\|") : std::string(1, c);
  return escaped;
}

std::string type_cell(const Parameter& parameter) {
  if (!parameter.choices.empty()) return "`" + joined(parameter.choices, "`, `") + "`";
  if (parameter.type != CLEAVE_TYPE_NUMBER_LIST) return type_word(parameter.type);
  return parameter.min_count == parameter.max_count ? fmt::format("{} numbers", parameter.min_count)
                                                    : fmt::format("{} to {} numbers", parameter.min_count, parameter.max_count);
}

std::string default_cell(const Parameter& parameter) {
  if (parameter.required) return "required";
  if (parameter.in_set) return "";
  const std::string text = plugins::value_text(parameter.default_value);
  return text.empty() ? "" : "`" + text + "`";
}

/// Bounds of validity, then what is usual. The unit has a column of its own.
std::string bounds_cell(const Parameter& parameter) {
  if (parameter.type == CLEAVE_TYPE_BOOLEAN || parameter.type == CLEAVE_TYPE_TEXT) return "";
  const std::string valid = plugins::bounds_text(parameter.minimum, parameter.minimum_open, parameter.maximum,
                                                 parameter.maximum_open, "1"),
                    usual = plugins::bounds_text(parameter.physical_minimum, false, parameter.physical_maximum, false, "1");
  const bool narrower = parameter.physical_minimum != parameter.minimum || parameter.physical_maximum != parameter.maximum;
  return (valid == "finite" ? "" : valid) + (narrower ? (valid == "finite" ? "usually " : "; usually ") + usual : "");
}

std::string meaning_cell(const Parameter& parameter) {
  std::string text = parameter.description;
  const bool list = parameter.type == CLEAVE_TYPE_NUMBER_LIST;
  for (std::size_t i = 0; i < parameter.needs.size(); ++i)
    if (const auto needs = plugins::capability_names(parameter.needs[i]); !needs.empty())
      text += fmt::format("; where {} is not 0: {}", list ? fmt::format("element {}", i) : "it", joined(needs, ", "));
  return cell(text);
}

std::string markdown(const Description& description, const char* heading) {
  std::string text = fmt::format("{} `{}` {}\n\n{}.\n", heading, description.id, description.version, description.summary);
  if (!description.source.empty()) text += fmt::format("Source: {}.\n", description.source);
  if (!description.author.empty()) text += fmt::format("Author: {}.\n", description.author);
  const auto capabilities = plugins::capability_names(description.capabilities);
  if (!capabilities.empty()) text += fmt::format("\nCapabilities: {}.\n", joined(capabilities, ", "));
  if (description.parameters.empty()) {
    text += "\nNo parameters.\n";
  } else {
    text += "\n| parameter | type | unit | default | bounds | meaning |\n|---|---|---|---|---|---|\n";
    for (const auto& parameter : description.parameters)
      text += fmt::format("| `{}` | {} | {} | {} | {} | {} |\n", parameter.key, type_cell(parameter), parameter.unit,
                          default_cell(parameter), bounds_cell(parameter), meaning_cell(parameter));
  }
  for (const auto& alternatives : description.alternatives) {
    std::vector<std::string> sets;
    for (const auto& set : alternatives.sets) sets.push_back("`" + joined(set, "` and `") + "`");
    text += fmt::format("\n{} {}.\n", alternatives.optional ? "At most one of:" : "One of:", joined(sets, ", or "));
  }
  if (description.states.empty()) return text;
  text += "\n| state | type | unit | initially | change | meaning |\n|---|---|---|---|---|---|\n";
  for (const auto& state : description.states) {
    const auto initial = initial_values(state);
    text += fmt::format("| `{}` | {} | {} | {} | {} | {} |\n", state.name, tensor_word(state.tensor), state.unit,
                        initial.size() == 1 ? plugins::number_text(initial[0]) : plugins::value_text(initial),
                        monotonicity_word(state.monotonicity), cell(state.description));
  }
  return text;
}

std::string reference_page(const Registry& registry) {
  std::string text =
      "# Plugins\n\n"
      "What each plugin says of itself, written by `cleave plugins --markdown`. A parameter without a default is required, or\n"
      "belongs to the alternatives named below the table. Outside its bounds the formulas mean nothing and the value is "
      "refused;\n"
      "outside of what is usual a scene is warned. All units are SI.\n";
  for (const auto kind : kinds) {
    const auto ids = registry.ids(kind);
    if (ids.empty()) continue;
    std::string title = plugins::name(kind);
    title.front() = char(title.front() - 'a' + 'A');
    text += fmt::format("\n## {}\n", title);
    for (const auto& id : ids) text += "\n" + markdown(*registry.find(id), "###");
  }
  return text;
}

}  // namespace

std::string describe_plugins(const Registry& registry, const PluginsOptions& options) {
  if (options.markdown && (options.json || options.explain))
    throw InputError("--markdown: error: goes with neither --json nor --explain");
  if (!options.id.empty()) {
    const Found& found = usable(registry, options.id);
    if (options.markdown) return markdown(*found.description, "#");
    if (options.json) return json_text(to_json(found));
    return describe_text(found) + (options.explain ? explanation(registry) : "");
  }
  if (options.markdown) return reference_page(registry);
  if (options.json) return list_json(registry);
  return list_text(registry) + (options.explain ? explanation(registry) : "");
}

int plugins_command(const PluginsOptions& options) {
  try {
    const Registry registry(Registry::default_search_path());
    std::fputs(describe_plugins(registry, options).c_str(), stdout);
    return 0;
  } catch (const InputError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}

}  // namespace cleave::app
