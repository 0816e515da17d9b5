#include "config/law_reader.hpp"

#include "common/nearest.hpp"
#include "plugins/parameters.hpp"

#include <algorithm>

namespace cleave::config {
namespace {

using plugins::Description;
using plugins::Kind;

constexpr Kind all_kinds[] = {Kind::elasticity, Kind::plasticity, Kind::damage, Kind::constraint, Kind::discretization};

std::string article(Kind kind) {
  const bool law = kind != Kind::constraint && kind != Kind::discretization;
  return std::string(kind == Kind::elasticity ? "an " : "a ") + plugins::name(kind) + (law ? " law" : "");
}

std::vector<std::string> short_names(const std::vector<std::string>& ids) {
  std::vector<std::string> names;
  for (const std::string& id : ids) names.push_back(id.substr(id.find('/') + 1));
  return names;
}

std::string there_are(Kind kind, const PluginCatalog& catalog) {
  const auto names = short_names(catalog.ids(kind));
  return names.empty() ? "no " + std::string(plugins::name(kind)) + " plugin was found" : "there are: " + list_text(names);
}

std::string looked_in(const PluginCatalog& catalog) {
  std::vector<std::string> directories;
  for (const auto& directory : catalog.search_path()) directories.push_back(directory.string());
  return directories.empty() ? "" : " (looked in " + list_text(directories) + "; CLEAVE_PLUGIN_PATH adds directories)";
}

bool any_plugin(const PluginCatalog& catalog) {
  return std::any_of(std::begin(all_kinds), std::end(all_kinds), [&](Kind kind) { return !catalog.ids(kind).empty(); });
}

std::string unknown_plugin(const std::string& given, const std::string& id, Kind kind, const PluginCatalog& catalog) {
  const std::string refusal = catalog.refusal(id);
  if (!refusal.empty()) return "plugin '" + id + "' cannot be used: " + refusal;

  const std::string law = id.substr(id.find('/') + 1);
  for (const Kind other : all_kinds) {
    const std::string elsewhere = plugins::name(other) + ("/" + law);
    if (other != kind && catalog.find(elsewhere))
      return "'" + elsewhere + "' is " + article(other) + ", here belongs " + article(kind) + "; " + there_are(kind, catalog);
  }
  std::string text = "there is no " + std::string(plugins::name(kind)) + " plugin '" + given + "'";
  if (!any_plugin(catalog)) return text + ": no plugin was found at all" + looked_in(catalog);
  if (const auto near = nearest(law, short_names(catalog.ids(kind))))
    text += ", did you mean '" + *near + "'? Of this kind";
  else
    text += ";";
  return text + " " + there_are(kind, catalog);
}

const Description* find_plugin(TableReader& table, Kind kind, std::string& id) {
  const auto given = table.text("plugin");
  if (!given) return nullptr;
  const PluginCatalog& catalog = table.context().catalog;
  id = given->find('/') == std::string::npos ? plugins::name(kind) + ("/" + *given) : *given;
  const Description* description = catalog.find(id);
  if (description && description->kind == kind) return description;
  if (description)
    table.error_at("plugin", "'" + id + "' is " + article(description->kind) + ", here belongs " + article(kind) + "; " +
                                 there_are(kind, catalog));
  else
    table.error_at("plugin", unknown_plugin(*given, id, kind, catalog));
  return nullptr;
}

Range validity(const plugins::Parameter& p) { return {p.minimum, p.maximum, p.minimum_open, p.maximum_open}; }

void warn_if_unphysical(TableReader& table, const plugins::Parameter& parameter, double value) {
  if (value >= parameter.physical_minimum && value <= parameter.physical_maximum) return;
  table.context().diagnostics.warning(
      table.where(parameter.key),
      "'" + parameter.key + "' is " + plugins::number_text(value) + ", outside what materials are known to have: " +
          plugins::bounds_text(parameter.physical_minimum, false, parameter.physical_maximum, false, parameter.unit));
}

std::optional<plugins::Value> read_value(TableReader& table, const plugins::Parameter& parameter) {
  const std::string& key = parameter.key;
  switch (parameter.type) {
    case CLEAVE_TYPE_NUMBER: {
      const auto value = table.number(key, parameter.unit, validity(parameter));
      if (!value) return std::nullopt;
      warn_if_unphysical(table, parameter, *value);
      return *value;
    }
    case CLEAVE_TYPE_INTEGER: {
      constexpr auto limits = std::numeric_limits<std::int64_t>{};
      const auto value = table.integer(key, limits.min(), limits.max());
      if (!value) return std::nullopt;
      if (!validity(parameter).holds(double(*value))) {
        table.error_at(key,
                       "'" + key + "' must be " + validity(parameter).text(parameter.unit) + ", is " + std::to_string(*value));
        return std::nullopt;
      }
      warn_if_unphysical(table, parameter, double(*value));
      return *value;
    }
    case CLEAVE_TYPE_BOOLEAN: {
      const auto value = table.boolean(key);
      return value ? std::optional<plugins::Value>(*value) : std::nullopt;
    }
    case CLEAVE_TYPE_TEXT: {
      if (parameter.choices.empty()) {
        const auto value = table.text(key);
        return value ? std::optional<plugins::Value>(*value) : std::nullopt;
      }
      const auto chosen = table.choice(key, parameter.choices);
      return chosen ? std::optional<plugins::Value>(parameter.choices[*chosen]) : std::nullopt;
    }
    case CLEAVE_TYPE_NUMBER_LIST: {
      const auto values = table.numbers(key, parameter.unit, parameter.min_count, parameter.max_count, validity(parameter));
      if (!values) return std::nullopt;
      for (const double value : *values) warn_if_unphysical(table, parameter, value);
      return *values;
    }
  }
  return std::nullopt;
}

std::string expectation(const plugins::Parameter& parameter) {
  std::string text = plugins::type_text(parameter.type);
  if (!parameter.unit.empty() && parameter.unit != "1") text += " (" + parameter.unit + ")";
  if (!parameter.choices.empty()) text = "one of " + list_text(parameter.choices, "\"");
  return text + (parameter.description.empty() ? "" : ": " + parameter.description);
}

std::string keys_text(const std::vector<std::string>& keys) {
  std::string text;
  for (std::size_t i = 0; i < keys.size(); ++i)
    text += (i == 0 ? "'" : i + 1 == keys.size() ? " and '" : ", '") + keys[i] + "'";
  return text;
}

std::string sets_text(const std::vector<std::vector<std::string>>& sets) {
  std::string text;
  for (const auto& set : sets) text += (text.empty() ? "" : "; ") + keys_text(set);
  return text;
}

bool contains(const std::vector<std::string>& keys, const std::string& key) {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

void check_alternatives(TableReader& table, const plugins::Alternatives& alternatives) {
  std::vector<std::string> given;
  for (const auto& set : alternatives.sets)
    for (const std::string& key : set)
      if (table.has(key) && !contains(given, key)) given.push_back(key);
  if (given.empty()) {
    if (!alternatives.optional)
      table.error(table.where(), table.what() + " needs one of these sets: " + sets_text(alternatives.sets));
    return;
  }
  std::vector<std::vector<std::string>> completions;
  for (const auto& set : alternatives.sets) {
    if (!std::all_of(given.begin(), given.end(), [&](const std::string& key) { return contains(set, key); })) continue;
    if (set.size() == given.size()) return;
    std::vector<std::string> missing;
    for (const std::string& key : set)
      if (!contains(given, key)) missing.push_back(key);
    completions.push_back(std::move(missing));
  }
  const Location where = table.where_key(given.front());
  if (completions.empty())
    table.error(where, keys_text(given) + " cannot be given together; give one of these sets: " + sets_text(alternatives.sets));
  else
    table.error(where, keys_text(given) + (given.size() == 1 ? " is" : " are") + " not enough; add " +
                           (completions.size() > 1 ? "one of: " : "") + sets_text(completions));
}

/// A capability that one law asks of the elastic law of its material.
struct Need {
  cleave_capability needs, has;
  const char* what;
};
constexpr Need needs_of_elasticity[] = {
    {CLEAVE_NEEDS_ISOCHORIC_RESPONSE, CLEAVE_HAS_ISOCHORIC_RESPONSE, "the isochoric response"},
    {CLEAVE_NEEDS_TENSILE_ENERGY, CLEAVE_HAS_ENERGY, "the tensile energy"},
    {CLEAVE_NEEDS_EFFECTIVE_STRESS, CLEAVE_HAS_EFFECTIVE_STRESS, "the effective stress"},
};

/// A law as the material uses it: with the capabilities its parameters bring.
Description used(const Description& law, const PluginUse& use) {
  Description with = law;
  with.capabilities = law.capabilities_with(use.parameters);
  return with;
}

void check_needs(const PluginUse& use, const Description& law, const Description& elasticity, ReadContext& context) {
  for (const Need& need : needs_of_elasticity) {
    if (!law.can(need.needs) || elasticity.can(need.has)) continue;
    std::vector<std::string> offering;
    for (const std::string& id : context.catalog.ids(Kind::elasticity))
      if (context.catalog.find(id)->can(need.has)) offering.push_back(id.substr(id.find('/') + 1));
    context.diagnostics.error(use.where,
                              "'" + law.id + "' needs " + need.what + " of the elastic law, which '" + elasticity.id +
                                  "' does not offer; " +
                                  (offering.empty() ? "no elastic law found does" : "these do: " + list_text(offering)));
  }
}

void check_fibers(const PluginUse& use, const Description& law, const Material& material, const Remedies& remedies,
                  Diagnostics& diagnostics) {
  const bool needs_second = law.can(CLEAVE_NEEDS_SECOND_FIBER);
  if (!material.fibers && (needs_second || law.can(CLEAVE_NEEDS_FIBER)))
    diagnostics.error(use.where, "'" + law.id + "' needs the direction of the fibers; " +
                                     (needs_second ? remedies.both_fibers : remedies.fiber));
  else if (needs_second && !material.fibers->second && material.fibers->layout == Fibers::Layout::uniform)
    diagnostics.error(use.where, "'" + law.id + "' needs the direction of a second family of fibers; " + remedies.second_fiber);
}

void check_precision(const PluginUse& use, const Description& law, Precision precision, const Remedies& remedies,
                     Diagnostics& diagnostics) {
  // Constraints and discretizations always work in double, whatever the precision of the scene.
  if (law.kind == Kind::constraint || law.kind == Kind::discretization) return;
  const bool single = precision == Precision::single_precision;
  if (law.can(single ? CLEAVE_SINGLE : CLEAVE_DOUBLE)) return;
  diagnostics.error(use.where, "'" + law.id + "' does not offer " + (single ? "single" : "double") + " precision; " +
                                   (single ? remedies.double_precision : remedies.single_precision));
}

}  // namespace

std::optional<PluginUse> read_law(TableReader table, Kind kind) {
  if (!table.require("plugin", "the name of " + article(kind) + "; " + there_are(kind, table.context().catalog)))
    return std::nullopt;
  PluginUse use;
  use.where = table.where("plugin");
  const Description* description = find_plugin(table, kind, use.id);
  if (!description) return std::nullopt;
  table.rename("'" + use.id + "'");
  for (const plugins::Parameter& parameter : description->parameters) {
    if (parameter.required && !parameter.in_set) table.require(parameter.key, expectation(parameter));
    if (auto value = read_value(table, parameter)) use.parameters.emplace(parameter.key, std::move(*value));
  }
  for (const plugins::Alternatives& alternatives : description->alternatives) check_alternatives(table, alternatives);
  table.finish();
  return use;
}

void check_combination(const Material& material, Precision precision, ReadContext& context, const Remedies& remedies) {
  const Description* elasticity = context.catalog.find(material.elasticity.id);
  bool fibers_read = false, all_known = elasticity != nullptr;
  const auto check = [&](const PluginUse& use) {
    const Description* found = context.catalog.find(use.id);
    if (!found) {
      all_known = false;
      return;
    }
    const Description law = used(*found, use);
    fibers_read = fibers_read || law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER);
    check_precision(use, law, precision, remedies, context.diagnostics);
    check_fibers(use, law, material, remedies, context.diagnostics);
    if (elasticity && law.kind != Kind::elasticity) check_needs(use, law, *elasticity, context);
  };
  if (elasticity) check(material.elasticity);
  for (const auto* use : {&material.plasticity, &material.damage, &material.constraint})
    if (*use) check(**use);
  if (material.fibers && all_known && !fibers_read)
    context.diagnostics.warning(material.where, "no law of material '" + material.name + "' reads its fibers");
}

}  // namespace cleave::config
