#include <cleave/testkit/parameters.hpp>

#include <cleave/testkit/check.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

namespace cleave::testkit {
namespace {

std::string number(double value) {
  char buffer[40];
  return std::string(buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr);
}

std::vector<std::string> words(const char* text) {
  std::istringstream in(text ? text : "");
  std::vector<std::string> all;
  for (std::string word; in >> word;) all.push_back(word);
  return all;
}

double read_number(const std::string& key, const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) throw Failed{key + " must be a number, is \"" + text + "\""};
  return value;
}

Value read_value(const cleave_parameter_schema& schema, const std::string& text) {
  switch (schema.type) {
    case CLEAVE_TYPE_INTEGER:
      return std::int64_t(std::llround(read_number(schema.key, text)));
    case CLEAVE_TYPE_BOOLEAN:
      if (text != "true" && text != "false") throw Failed{std::string(schema.key) + " must be true or false, is " + text};
      return text == "true";
    case CLEAVE_TYPE_TEXT:
      return text;
    case CLEAVE_TYPE_NUMBER_LIST: {
      std::string spaced = text;
      std::replace_if(
          spaced.begin(), spaced.end(), [](char c) { return c == '[' || c == ']' || c == ','; }, ' ');
      std::vector<double> list;
      for (const auto& word : words(spaced.c_str())) list.push_back(read_number(schema.key, word));
      return list;
    }
    default:
      return read_number(schema.key, text);
  }
}

/// Empty, false, 0 where the schema states no default.
Value default_value(const cleave_parameter_schema& schema) {
  const bool has = !schema.required && !schema.in_set;
  switch (schema.type) {
    case CLEAVE_TYPE_INTEGER:
      return std::int64_t(has ? schema.default_number : 0);
    case CLEAVE_TYPE_BOOLEAN:
      return has && schema.default_number != 0;
    case CLEAVE_TYPE_TEXT:
      return std::string(has && schema.default_text ? schema.default_text : "");
    case CLEAVE_TYPE_NUMBER_LIST:
      return has && schema.default_list ? std::vector<double>(schema.default_list, schema.default_list + schema.default_count)
                                        : std::vector<double>();
    default:
      return has ? schema.default_number : 0.0;
  }
}

cleave_parameter pack(const cleave_parameter_schema& schema, const Value& value, bool given) {
  cleave_parameter packed{};
  packed.struct_size = sizeof packed;
  packed.type = schema.type;
  packed.key = schema.key;
  packed.given = given;
  packed.text = "";
  if (const auto* x = std::get_if<double>(&value)) packed.number = *x;
  if (const auto* integer = std::get_if<std::int64_t>(&value)) {
    packed.integer = *integer;
    packed.number = double(*integer);
  }
  if (const auto* flag = std::get_if<bool>(&value)) packed.number = *flag;
  if (const auto* text = std::get_if<std::string>(&value)) packed.text = text->c_str();
  if (const auto* list = std::get_if<std::vector<double>>(&value)) {
    packed.list = list->data();
    packed.count = std::uint32_t(list->size());
  }
  return packed;
}

}  // namespace

std::string text(const Settings& settings) {
  struct Visitor {
    std::string operator()(double value) const { return number(value); }
    std::string operator()(std::int64_t value) const { return std::to_string(value); }
    std::string operator()(bool value) const { return value ? "true" : "false"; }
    std::string operator()(const std::string& value) const { return value; }
    std::string operator()(const std::vector<double>& list) const {
      std::string all = "[";
      for (double element : list) all += (all.size() > 1 ? ", " : "") + number(element);
      return all + "]";
    }
  };
  std::string all;
  for (const auto& [key, value] : settings) all += (all.empty() ? "" : " ") + key + "=" + std::visit(Visitor{}, value);
  return all.empty() ? "all defaults" : all;
}

const cleave_parameter_schema* find(const cleave_schema& schema, const std::string& key) {
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i)
    if (key == schema.parameters[i]->key) return schema.parameters[i];
  return nullptr;
}

Settings read_settings(const cleave_schema& schema, const std::map<std::string, std::string>& texts) {
  Settings settings;
  for (const auto& [key, text] : texts) {
    const auto* parameter = find(schema, key);
    if (!parameter) throw Failed{"--set: this plugin has no parameter \"" + key + "\""};
    settings[key] = read_value(*parameter, text);
  }
  return settings;
}

std::vector<std::vector<std::string>> required_keys(const cleave_schema& schema) {
  std::vector<std::vector<std::string>> all(1);
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i)
    if (schema.parameters[i]->required) all[0].push_back(schema.parameters[i]->key);
  for (std::uint32_t i = 0; i < schema.alternatives_count; ++i) {
    const cleave_alternatives& alternatives = *schema.alternatives[i];
    std::vector<std::vector<std::string>> sets;
    if (alternatives.optional) sets.push_back({});
    for (std::uint32_t k = 0; k < alternatives.set_count; ++k) sets.push_back(words(alternatives.sets[k]));
    std::vector<std::vector<std::string>> extended;
    for (const auto& set : sets)
      for (auto keys : all) {
        keys.insert(keys.end(), set.begin(), set.end());
        extended.push_back(keys);
      }
    all = extended;
  }
  return all;
}

std::vector<std::pair<std::string, Value>> switches(const cleave_schema& schema) {
  std::vector<std::pair<std::string, Value>> all;
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
    const cleave_parameter_schema& p = *schema.parameters[i];
    if (p.required || p.in_set) continue;
    const Value preset = default_value(p);
    if (p.type == CLEAVE_TYPE_TEXT)
      for (std::uint32_t k = 0; k < p.choice_count; ++k)
        if (const std::string choice = p.choices[k]; Value(choice) != preset) all.emplace_back(p.key, choice);
    if (p.type == CLEAVE_TYPE_BOOLEAN) all.emplace_back(p.key, !std::get<bool>(preset));
    if (p.needs[0] | p.needs[1]) {
      Value on = typical_value(p, 0.5, 0);
      if (auto* list = std::get_if<std::vector<double>>(&on)) {
        const double element = list->empty() ? 1 : list->front();
        list->assign(std::min(p.max_count, p.needs[1] ? 2u : 1u), element);
      }
      if (on != preset) all.emplace_back(p.key, on);
    }
  }
  return all;
}

Range range_of(const cleave_parameter_schema& schema, double stress) {
  const std::string unit = schema.unit ? schema.unit : "";
  double low = schema.physical_minimum, high = schema.physical_maximum;
  if (stress > 0 && (unit == "Pa" || unit == "J/m^3")) {
    const double centre = unit == "Pa" ? stress : 0.01 * stress;
    low = std::max(low, 0.01 * centre);
    high = std::min(high, 100 * centre);
  }
  if (!std::isfinite(low)) low = std::isfinite(high) ? high - 100 : -10;
  // A positive quantity without known upper end: from a thousandth to a thousand units.
  if (!std::isfinite(high)) high = low == 0 && schema.minimum_open ? 1e3 : low + 100;
  if (low == 0 && schema.minimum == 0 && schema.minimum_open) low = std::min(1e-3, 1e-3 * high);
  const double nudge = 1e-6 * (high - low);
  if (schema.minimum_open && low <= schema.minimum) low = schema.minimum + nudge;
  if (schema.maximum_open && high >= schema.maximum) high = schema.maximum - nudge;
  return {low, std::max(low, high)};
}

Value typical_value(const cleave_parameter_schema& schema, double place, double stress) {
  const auto [low, high] = range_of(schema, stress);
  const double value = low > 0 && high > 100 * low ? low * std::pow(high / low, place) : low + place * (high - low);
  const double inside = std::clamp(value, low, high);
  switch (schema.type) {
    case CLEAVE_TYPE_INTEGER:
      return std::int64_t(std::llround(inside));
    case CLEAVE_TYPE_BOOLEAN:
      return place < 0.5;
    case CLEAVE_TYPE_TEXT:
      return std::string(schema.choice_count
                             ? schema.choices[std::min(schema.choice_count - 1, std::uint32_t(place * schema.choice_count))]
                             : "");
    case CLEAVE_TYPE_NUMBER_LIST: {
      const std::uint32_t longest = std::min(schema.max_count, 9u);
      const auto count = std::max(schema.min_count, std::uint32_t(std::llround(place * longest)));
      return std::vector<double>(count, inside);
    }
    default:
      return inside;
  }
}

PackedParameters::PackedParameters(const cleave_schema& schema, const Settings& given) : given_(given) {
  std::vector<bool> is_given;
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
    is_given.push_back(given_.contains(schema.parameters[i]->key));
    given_.try_emplace(schema.parameters[i]->key, default_value(*schema.parameters[i]));
  }
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i)
    values_.push_back(pack(*schema.parameters[i], given_.at(schema.parameters[i]->key), is_given[i]));
  refresh();
}

void PackedParameters::refresh() { parameters_ = {sizeof parameters_, std::uint32_t(values_.size()), values_.data()}; }

std::uint64_t capabilities_with(const cleave_schema& schema, const Settings& given) {
  std::uint64_t all = schema.capabilities;
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
    const auto& parameter = *schema.parameters[i];
    const auto it = given.find(parameter.key);
    if (parameter.in_set && it == given.end()) continue;
    const Value value = it == given.end() ? default_value(parameter) : it->second;
    const auto* x = std::get_if<double>(&value);
    const auto* list = std::get_if<std::vector<double>>(&value);
    for (std::size_t k = 0; k < 2; ++k)
      if (x ? k == 0 && *x != 0 : list && k < list->size() && (*list)[k] != 0) all |= parameter.needs[k];
  }
  return all;
}

}  // namespace cleave::testkit
