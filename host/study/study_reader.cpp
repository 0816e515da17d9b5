#include "common/error.hpp"
#include "common/nesting.hpp"
#include "config/table_reader.hpp"
#include "output/number.hpp"
#include "study/expression.hpp"
#include "study/run_results.hpp"
#include "study/study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <set>
#include <sstream>

namespace cleave::study {
namespace {

using config::Override;
using config::Range;
using config::ReadContext;
using config::TableReader;

constexpr std::uintmax_t largest_file = 64u << 20;

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (c == '\n')
      out += "\\n";
    else
      out += c;
  }
  return out + '"';
}

/// The word of a command line that is no TOML: a text.
toml::table text_value(const std::string& text, const std::string& option) try {
  return toml::parse("value = " + quoted(text), option);
} catch (const toml::parse_error& problem) {
  throw InputError(option + ": error: the value is no text that a scene may hold: " + std::string(problem.description()));
}

/// A value on one line, as --set takes it.
std::string value_text(const toml::node& node) {
  if (const auto* text = node.as_string()) return quoted(text->get());
  if (const auto* number = node.as_floating_point()) {
    const std::string digits = output::number(number->get());
    return digits.find_first_of(".ein") == std::string::npos ? digits + ".0" : digits;
  }
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
  std::string text;
  if (const auto* list = node.as_array()) {
    for (const toml::node& element : *list) text += (text.empty() ? "" : ", ") + value_text(element);
    return "[" + text + "]";
  }
  if (const auto* table = node.as_table()) {
    for (const auto& [key, value] : *table)
      text += (text.empty() ? "" : ", ") + quoted(std::string(key.str())) + " = " + value_text(value);
    return "{" + text + "}";
  }
  return quoted("a date or time");  // no value of a scene
}

/// A value as a reader of a chart wants to see it.
std::string plain_text(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
  return value_text(node);
}

/// Every value of [set] with the path it has in the scene: "simulation.cell_size". Tables that stand on one line are values.
void flatten(const toml::table& table, const std::string& path, std::vector<Override>& settings) {
  for (const auto& [key, value] : table) {
    const std::string here = path.empty() ? std::string(key.str()) : path + "." + std::string(key.str());
    const toml::table* inner = value.as_table();
    if (inner && !inner->is_inline())
      flatten(*inner, here, settings);
    else
      settings.push_back({here, value_text(value)});
  }
}

std::vector<Override> read_settings(TableReader& table, std::string_view key) {
  std::vector<Override> settings;
  const toml::node* node = table.find(key);
  if (!node) return settings;
  if (const toml::table* values = node->as_table())
    flatten(*values, "", settings);
  else
    table.error_at(key, "'" + std::string(key) + "' must be a table of values of the scene, is " + config::found(*node));
  return settings;
}

std::optional<Formula> formula_of(TableReader& table, std::string_view key, const toml::node& node) {
  const config::Location where = config::locate(node.source());
  if (const auto* text = node.as_string()) return Formula{text->get(), where};
  if (node.is_number()) return Formula{value_text(node), where};
  table.error(where, "'" + std::string(key) + "' must be an expression in quotes, is " + config::found(node));
  return std::nullopt;
}

std::optional<Formula> read_formula(TableReader& table, std::string_view key) {
  const toml::node* node = table.find(key);
  return node ? formula_of(table, key, *node) : std::nullopt;
}

/// One expression, or a list of them for the components of a vector.
std::vector<Formula> read_formulas(TableReader& table, std::string_view key) {
  std::vector<Formula> formulas;
  const toml::node* node = table.find(key);
  if (!node) return formulas;
  const auto add = [&](const toml::node& element) {
    if (auto formula = formula_of(table, key, element)) formulas.push_back(std::move(*formula));
  };
  if (const toml::array* list = node->as_array()) {
    if (list->empty()) table.error_at(key, "'" + std::string(key) + "' is an empty list");
    for (const toml::node& element : *list) add(element);
  } else {
    add(*node);
  }
  return formulas;
}

std::vector<std::string> read_texts(TableReader& table, std::string_view key) {
  std::vector<std::string> texts;
  const toml::node* node = table.find(key);
  if (!node) return texts;
  const auto add = [&](const toml::node& element) {
    if (const auto* text = element.as_string())
      texts.push_back(text->get());
    else
      table.error(config::locate(element.source()),
                  "'" + std::string(key) + "' must be a text or a list of texts, has " + config::found(element));
  };
  if (const toml::array* list = node->as_array())
    for (const toml::node& element : *list) add(element);
  else
    add(*node);
  return texts;
}

// ---------------------------------------------------------------- axes

/// Plugins by name; where several entries name the same one, with the parameters in which they differ.
std::vector<std::string> labels_of(const std::vector<const toml::node*>& values) {
  const auto plugin = [](const toml::node& node) -> std::string {
    const toml::table* table = node.as_table();
    const toml::node* name = table ? table->get("plugin") : nullptr;
    return name && name->is_string() ? name->as_string()->get() : std::string();
  };
  std::vector<std::string> labels;
  for (const toml::node* value : values) {
    const std::string name = plugin(*value);
    if (name.empty()) {
      labels.push_back(plain_text(*value));
      continue;
    }
    std::string label = name;
    for (const auto& [key, parameter] : *value->as_table()) {
      const bool differs = std::any_of(values.begin(), values.end(),
                                       [&, k = std::string(key.str()), p = value_text(parameter)](const toml::node* other) {
                                         if (plugin(*other) != name) return false;
                                         const toml::node* theirs = other->as_table()->get(k);
                                         return !theirs || value_text(*theirs) != p;
                                       });
      if (differs) label += ", " + std::string(key.str()) + " " + plain_text(parameter);
    }
    labels.push_back(label);
  }
  return labels;
}

/// Numbers at equal distances or ratios, to four digits.
std::vector<toml::value<double>> read_range(TableReader table) {
  const double from = table.required_number("from", ""), to = table.required_number("to", "");
  std::int64_t count = 0;
  if (table.require("count", "how many values")) count = table.integer("count", 2, 1000).value_or(0);
  const bool logarithmic = table.choice("scale", {"linear", "logarithmic"}).value_or(0) == 1;
  table.finish();
  std::vector<toml::value<double>> values;
  if (logarithmic && (from <= 0 || to <= 0)) {
    table.error(table.where(), "a logarithmic range goes between numbers above 0");
    return values;
  }
  for (std::int64_t i = 0; i < count; ++i) {
    const double s = double(i) / double(count - 1);
    std::ostringstream four_digits;
    four_digits.precision(4);
    four_digits << (logarithmic ? from * std::pow(to / from, s) : from + s * (to - from));
    values.emplace_back(std::strtod(four_digits.str().c_str(), nullptr));
  }
  return values;
}

/// What one entry of `values` changes, for the paths of the axis.
void add_value(TableReader& table, Axis& axis, const toml::node& node) {
  AxisValue value;
  const toml::node* first = &node;
  if (axis.paths.size() > 1) {
    const toml::array* list = node.as_array();
    if (!list || list->size() != axis.paths.size()) {
      table.error(config::locate(node.source()), "each of 'values' must be a list of " + std::to_string(axis.paths.size()) +
                                                     ", one for each path, is " + config::found(node));
      return;
    }
    for (std::size_t i = 0; i < axis.paths.size(); ++i) value.overrides.push_back({axis.paths[i], value_text((*list)[i])});
    first = &(*list)[0];
  } else {
    value.overrides.push_back({axis.paths[0], value_text(node)});
  }
  if (first->is_number()) value.number = first->value<double>();
  axis.values.push_back(std::move(value));
}

Axis read_axis(TableReader table, const std::vector<std::pair<std::string, std::string>>& added) {
  Axis axis;
  axis.where = table.where();
  if (table.require("name", "a text")) axis.name = table.text("name").value_or("");
  table.rename("axis '" + axis.name + "'");
  axis.unit = table.text("unit").value_or("");
  if (const auto path = table.text("path")) axis.paths = {*path};
  if (table.has("paths")) {
    if (!axis.paths.empty()) table.refuse("paths", "and 'path' exclude each other");
    axis.paths = read_texts(table, "paths");
  }
  if (axis.paths.empty()) {
    if (!table.has("path"))
      table.error(table.where(), table.what() + " needs 'path', what it changes in the scene, as simulation.cell_size");
    axis.paths = {"?"};
  }
  for (const std::string& path : axis.paths)
    if (path.empty() || path.front() == '.' || path.back() == '.' || path.find("..") != std::string::npos)
      table.error_at(table.has("path") ? "path" : "paths", "'" + path + "' is no path; one is simulation.cell_size");

  std::vector<const toml::node*> nodes;
  std::vector<toml::value<double>> range;
  std::vector<toml::table> parsed;
  if (const toml::node* node = table.find("values")) {
    table.refuse("range", "and 'values' exclude each other");
    if (const toml::array* list = node->as_array())
      for (const toml::node& element : *list) nodes.push_back(&element);
    else
      table.error_at("values", "'values' must be a list, is " + config::found(*node));
    if (nodes.empty()) table.error_at("values", "'values' is empty");
  } else if (auto given = table.table("range", "range of " + table.what())) {
    if (axis.paths.size() > 1) table.refuse("range", "goes with one 'path'; with 'paths' give 'values'");
    range = read_range(*given);
    for (const auto& number : range) nodes.push_back(&number);
  } else if (!table.has("range")) {
    table.error(table.where(), table.what() + " needs 'values', a list, or 'range'");
  }
  for (const auto& [name, text] : added) {
    if (name != axis.name) continue;
    const std::string option = "--value " + name;
    try {
      parsed.push_back(toml::parse("value = " + text, option));
    } catch (const toml::parse_error&) {
      parsed.push_back(text_value(text, option));
    }
  }
  for (const toml::table& added_value : parsed) nodes.push_back(added_value.get("value"));

  for (const toml::node* node : nodes) add_value(table, axis, *node);
  std::vector<std::string> labels = read_texts(table, "labels");
  if (!labels.empty() && labels.size() + parsed.size() != nodes.size())
    table.error_at("labels", "there are " + std::to_string(nodes.size() - parsed.size()) + " values and " +
                                 std::to_string(labels.size()) + " labels");
  std::vector<const toml::node*> firsts;
  for (const toml::node* node : nodes)
    firsts.push_back(axis.paths.size() > 1 && node->is_array() && !node->as_array()->empty() ? &(*node->as_array())[0] : node);
  const std::vector<std::string> own = labels_of(firsts);
  std::set<std::string> taken;
  for (std::size_t i = 0; i < axis.values.size() && axis.values.size() == nodes.size(); ++i) {
    axis.values[i].label = i < labels.size() ? labels[i] : own[i];
    if (!taken.insert(axis.values[i].label).second)
      table.error(config::locate(nodes[i]->source()),
                  table.what() + " has two values called '" + axis.values[i].label + "'; tell them apart with 'labels'");
  }
  table.finish();
  return axis;
}

// ---------------------------------------------------------------- measures

void read_reference(TableReader table, ErrorMeasure& error, const Study& study) {
  error.has_reference = true;
  if (auto at = table.table("at", "[error.reference.at]")) {
    for (const Axis& axis : study.axes) {
      const toml::node* node = at->find(axis.name);
      if (!node) continue;
      const std::string wanted = plain_text(*node);
      std::vector<std::string> labels;
      std::optional<std::string> found;
      for (const AxisValue& value : axis.values) {
        labels.push_back(value.label);
        if (value.label == wanted || (value.number && node->is_number() && *value.number == node->value<double>()))
          found = value.label;
      }
      if (found)
        error.reference_at[axis.name] = *found;
      else
        at->error_at(axis.name, "axis '" + axis.name + "' has no value '" + wanted + "'" +
                                    config::suggestion(wanted, labels, "; there are: " + config::list_text(labels)));
    }
    at->finish();
  }
  error.reference_set = read_settings(table, "set");
  if (error.reference_at.empty() && error.reference_set.empty())
    table.error(table.where(),
                "[error.reference] needs 'at', values of axes, or 'set', values of the scene: { at = { cells = 0.01 } }");
  table.finish();
}

ErrorMeasure read_error(TableReader table, const Study& study) {
  ErrorMeasure error;
  error.title = table.text("title").value_or("error");
  error.unit = table.text("unit").value_or("");
  error.particles = table.boolean("particles").value_or(false);
  if (table.require("value", "an expression of what is compared, such as \"momentum_x / mass\""))
    error.value = read_formulas(table, "value");
  error.expected = read_formulas(table, "formula");
  if (auto reference = table.table("reference", "[error.reference]")) read_reference(*reference, error, study);
  error.file = table.file("file", {".csv"});
  error.file_at = table.text("file_at").value_or("time");
  error.file_columns = read_texts(table, "file_columns");
  const int ways = int(!error.expected.empty()) + int(error.has_reference) + int(error.file.has_value());
  if (ways != 1 && !(ways == 0 && (table.has("formula") || table.has("file"))))
    table.error(table.where(), table.what() + " needs one of 'formula', 'reference' and 'file', has " + std::to_string(ways));
  const auto count = [&](std::string_view key, std::size_t has) {
    if (has != error.value.size())
      table.error_at(key, "'value' has " + std::to_string(error.value.size()) + " component" +
                              (error.value.size() == 1 ? "" : "s") + ", '" + std::string(key) + "' has " + std::to_string(has));
  };
  if (!error.expected.empty()) count("formula", error.expected.size());
  if (error.file) {
    if (table.require("file_columns", "the columns to compare with")) count("file_columns", error.file_columns.size());
  } else {
    table.refuse("file_at", "goes with 'file'");
    table.refuse("file_columns", "goes with 'file'");
  }
  error.norm = Norm(table.choice("norm", {"L2", "maximum", "final"}).value_or(0));
  error.relative = table.boolean("relative").value_or(true);
  error.scale = read_formula(table, "scale");
  if (error.scale && !error.relative) table.refuse("scale", "is what a relative error is relative to");
  if (error.relative && !error.unit.empty()) table.refuse("unit", "goes with relative = false");
  if (auto profile = table.table("profile", "[error.profile]")) {
    error.profile.emplace();
    if (profile->require("along", "an expression of a particle's coordinates, such as \"X\""))
      error.profile->along = read_formula(*profile, "along").value_or(Formula{});
    error.profile->from = profile->required_number("from", "");
    error.profile->to = profile->required_number("to", "");
    if (profile->require("bins", "how many")) error.profile->bins = int(profile->integer("bins", 1, 100000).value_or(1));
    if (!(error.profile->from < error.profile->to)) profile->error(profile->where(), "'from' must be less than 'to'");
    profile->finish();
  }
  if (error.profile && !error.particles) table.refuse("profile", "goes with particles = true");
  if (error.particles && error.norm == Norm::last)
    table.error_at("norm", "particles are compared in the last frame anyway; 'norm' is \"L2\" or \"maximum\"");
  if (error.file && error.particles && !error.profile)
    table.error_at("file", "particles are compared with a file along a profile: give 'profile'");
  table.finish();
  return error;
}

StabilityMeasure read_stability(TableReader table) {
  StabilityMeasure map;
  map.energy = read_formulas(table, "energy");
  if (map.energy.size() > 1) table.error_at("energy", "'energy' must be one expression");
  map.tolerance = table.number("tolerance", "1", Range::positive()).value_or(map.tolerance);
  for (TableReader& criterion : table.tables("degraded", "[[stability.degraded]]")) {
    Criterion read;
    if (criterion.require("when", "an expression of columns of frames.csv"))
      read.when = read_formula(criterion, "when").value_or(Formula{});
    if (criterion.require("reason", "a text")) read.reason = criterion.text("reason").value_or("");
    criterion.finish();
    map.degraded.push_back(std::move(read));
  }
  if (auto bound = table.table("bound", "[stability.bound]")) {
    if (bound->require("value", "an expression of axes and constants; with 'set', of columns of frames.csv"))
      map.bound = read_formula(*bound, "value");
    map.bound_title = bound->text("title").value_or(map.bound_title);
    map.bound_of_runs = bound->has("set");
    map.bound_set = read_settings(*bound, "set");
    bound->finish();
  }
  if (map.energy.empty() && map.degraded.empty())
    table.error(table.where(), "[stability] needs 'energy' or 'degraded', which tell a stable run from a degraded one");
  table.finish();
  return map;
}

// ---------------------------------------------------------------- the whole

/// Brings constants into an order in which each is made of those before it.
void read_constants(TableReader& root, Study& study) {
  auto table = root.table("constants", "[constants]");
  if (!table) return;
  std::map<std::string, std::pair<Formula, std::vector<std::string>>> waiting;
  const auto* node = root.find("constants")->as_table();
  for (const auto& [key, value] : *node) {
    const std::string name(key.str());
    if (identifier(name) != name)
      table->error(config::locate(key.source()), "'" + name + "' is no name for a number; '" + identifier(name) + "' is");
    if (auto formula = read_formula(*table, name)) {
      try {
        waiting[name] = {*formula, Expression::names_in(*formula)};
      } catch (const InputError&) {
        waiting[name] = {*formula, {}};
      }
    }
  }
  while (!waiting.empty()) {
    const auto ready = std::find_if(waiting.begin(), waiting.end(), [&](const auto& entry) {
      return std::none_of(entry.second.second.begin(), entry.second.second.end(),
                          [&](const std::string& used) { return waiting.count(used) > 0; });
    });
    if (ready == waiting.end()) {
      const auto& [name, entry] = *waiting.begin();
      table->error(entry.first.where, "'" + name + "' is made of itself");
      return;
    }
    study.constants.emplace_back(ready->first, ready->second.first);
    waiting.erase(ready);
  }
}

std::vector<std::string> with(std::vector<std::string> names, const std::vector<std::string>& more) {
  names.insert(names.end(), more.begin(), more.end());
  return names;
}

/// Expressions that do not wait for a run: their syntax, and names that nothing can give.
void check_expressions(const Study& study, config::Diagnostics& diagnostics) {
  const std::vector<std::string> names = study.names(), rows = with(names, frame_columns());
  const auto check = [&](const std::function<void()>& work, const config::Location& where) {
    try {
      work();
    } catch (const InputError& problem) {
      std::string what = problem.what();
      const std::string place = config::error_at(where);
      if (what.starts_with(place)) what.erase(0, place.size());
      diagnostics.error(where, what);
    }
  };
  const auto check_all = [&](const std::vector<Formula>& formulas, const std::vector<std::string>& known) {
    for (const Formula& formula : formulas) check([&] { Expression(formula, known); }, formula.where);
  };
  for (std::size_t i = 0; i < study.constants.size(); ++i) {
    auto known = names;
    known.resize(names.size() - study.constants.size() + i);
    check_all({study.constants[i].second}, known);
  }
  if (study.error) {
    const ErrorMeasure& error = *study.error;
    if (!error.particles) {
      check_all(error.value, rows);
      check_all(error.expected, with(names, {"t"}));
    } else {  // fields of particles are those of the materials
      for (const auto* formulas : {&error.value, &error.expected})
        for (const Formula& formula : *formulas) check([&] { Expression::names_in(formula); }, formula.where);
    }
    if (error.scale) check_all({*error.scale}, names);
  }
  if (study.map) {
    check_all(study.map->energy, rows);
    for (const Criterion& criterion : study.map->degraded) check_all({criterion.when}, rows);
    if (study.map->bound) check_all({*study.map->bound}, study.map->bound_of_runs ? rows : names);
  }
}

void read_axes(TableReader& root, Study& study, const std::vector<std::string>& added) {
  std::vector<std::pair<std::string, std::string>> values;
  for (const std::string& text : added) {
    const auto equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
      throw InputError("--value " + text + ": error: expected axis=value, for example law='{ plugin = \"my-law\" }'");
    values.emplace_back(text.substr(0, equals), text.substr(equals + 1));
  }
  std::vector<std::string> names;
  if (root.require("axis", "at least one [[axis]]"))
    for (TableReader& table : root.tables("axis", "[[axis]]")) {
      study.axes.push_back(read_axis(std::move(table), values));
      const std::string& name = study.axes.back().name;
      if (std::find(names.begin(), names.end(), name) != names.end())
        root.error(study.axes.back().where, "there already is an axis '" + name + "'");
      names.push_back(name);
    }
  for (const auto& [name, text] : values)
    if (std::find(names.begin(), names.end(), name) == names.end())
      throw InputError("--value " + name + "=" + text + ": error: the study has no axis '" + name + "'" +
                       config::suggestion(name, names, "; there are: " + config::list_text(names)));
  for (std::size_t i = 0; i < study.axes.size() && !study.along; ++i)
    if (study.axes[i].numeric() && study.axes[i].values.size() > 1) study.along = i;
  if (const auto along = root.text("along")) {
    const auto found = std::find(names.begin(), names.end(), *along);
    if (found == names.end())
      root.error_at("along", "there is no axis '" + *along + "'" +
                                 config::suggestion(*along, names, "; there are: " + config::list_text(names)));
    else if (study.along = std::size_t(found - names.begin()); !study.axes[*study.along].numeric())
      root.error_at("along", "lines of the chart follow numbers, axis '" + *along + "' has others");
  }
}

Study read_study(TableReader root, const std::vector<std::string>& added) {
  Study study;
  study.title = root.text("title").value_or("");
  study.description = root.text("description").value_or("");
  study.stability = root.choice("kind", {"accuracy", "stability"}).value_or(0) == 1;
  if (root.require("scene", "a scene file")) study.scene = root.file("scene", {".toml"}).value_or("");
  study.set = read_settings(root, "set");
  study.threads = int(root.integer("threads", 1, 1024).value_or(1));
  study.repetitions = int(root.integer("repetitions", 1, 1000).value_or(1));
  study.time_limit = root.number("time_limit", "s", Range::positive()).value_or(study.time_limit);
  study.instructions = root.boolean("instructions").value_or(false);
  study.cost = Cost(root.choice("cost", {"wall", "particle-steps", "memory", "instructions"}).value_or(0));
  if (study.cost == Cost::instructions && !study.instructions)
    root.error_at("cost", "\"instructions\" are counted with instructions = true");
  read_axes(root, study, added);
  read_constants(root, study);
  if (study.stability) {
    root.refuse("error", "goes with kind = \"accuracy\"");
    root.refuse("along", "goes with kind = \"accuracy\"");
    root.refuse("cost", "goes with kind = \"accuracy\"");
    if (!study.axes.empty() && study.axes.size() != 2)
      root.error(root.where("axis"), "a stability map has two axes, this one has " + std::to_string(study.axes.size()));
    if (root.require("stability", "how runs are judged"))
      if (auto table = root.table("stability", "[stability]")) study.map = read_stability(std::move(*table));
    if (study.map && study.map->bound && study.axes.size() == 2 && !study.axes[1].numeric())
      root.error(study.axes[1].where, "a bound is one of the second axis, which has to have numbers");
  } else {
    root.refuse("stability", "goes with kind = \"stability\"");
    if (root.require("error", "what is compared with what"))
      if (auto table = root.table("error", "[error]")) study.error = read_error(std::move(*table), study);
  }
  root.finish();
  return study;
}

}  // namespace

bool Axis::numeric() const {
  return !values.empty() && std::all_of(values.begin(), values.end(), [](const AxisValue& v) { return v.number.has_value(); });
}

bool Axis::logarithmic() const {
  if (!numeric()) return false;
  double least = *values[0].number, most = least;
  for (const AxisValue& value : values) {
    least = std::min(least, *value.number);
    most = std::max(most, *value.number);
  }
  return least > 0 && most > 3 * least;
}

std::string identifier(const std::string& name) {
  std::string text;
  for (const char c : name) {
    const bool digit = c >= '0' && c <= '9';
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || (digit && !text.empty());
    text += plain ? c : '_';
  }
  return text;
}

std::vector<std::string> Study::names() const {
  std::vector<std::string> names;
  for (const Axis& axis : axes)
    if (axis.numeric()) names.push_back(identifier(axis.name));
  for (const auto& [name, formula] : constants) names.push_back(name);
  return names;
}

Study load_study(const std::filesystem::path& file, const std::vector<std::string>& added,
                 const config::PluginCatalog& catalog) {
  const std::string name = file.string();
  std::error_code status;
  if (!std::filesystem::is_regular_file(file, status)) throw InputError(name + ": error: there is no such study file");
  if (std::filesystem::file_size(file, status) > largest_file)
    throw InputError(name + ": error: the file is larger than 64 MiB, which no study needs");
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw InputError(name + ": error: the file cannot be read");
  toml::table root;
  if (const int line = line_nested_too_deep(text.view()))
    throw InputError(fmt::format("{}:{}: error: values are nested deeper than {} tables", name, line, deepest_toml));
  try {
    root = toml::parse(text.view(), name);
  } catch (const toml::parse_error& problem) {
    throw InputError(config::error_at(config::locate(problem.source())) + "not TOML: " + std::string(problem.description()));
  }
  config::Diagnostics diagnostics;
  const auto absolute = std::filesystem::absolute(file).lexically_normal();
  ReadContext context{diagnostics, catalog, name, absolute.parent_path()};
  Study study = read_study(TableReader(root, "the study", context), added);
  diagnostics.throw_errors();
  check_expressions(study, diagnostics);
  diagnostics.throw_errors();
  study.file = absolute;
  if (study.title.empty()) study.title = file.stem().string();
  return study;
}

}  // namespace cleave::study
