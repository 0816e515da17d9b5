#include "config/table_reader.hpp"

#include "common/nearest.hpp"
#include "plugins/parameters.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>

namespace cleave::config {
namespace {

std::string with_unit(const std::string& expected, const std::string& unit) {
  return unit.empty() || unit == "1" ? expected : expected + " (" + unit + ")";
}

std::string quoted(std::string_view key) { return "'" + std::string(key) + "'"; }

}  // namespace

Location locate(const toml::source_region& region) {
  if (!region.path) return {};
  if (region.path->rfind(option_prefix, 0) == 0) return {*region.path, 0, 0};
  return {*region.path, int(region.begin.line), int(region.begin.column)};
}

std::string found(const toml::node& node) {
  if (const auto* text = node.as_string()) {
    std::string shown = text->get().substr(0, 40);
    if (shown.size() < text->get().size()) shown += "...";
    return "the text \"" + shown + "\"";
  }
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* number = node.as_floating_point()) {
    const std::string text = plugins::number_text(number->get());
    return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
  }
  if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
  if (const auto* list = node.as_array()) return list->empty() ? "an empty list" : "a list of " + std::to_string(list->size());
  if (node.is_table()) return "a table";
  return "a date or time";
}

std::string list_text(const std::vector<std::string>& words, const char* quote) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + std::string(quote) + word + quote;
  return text;
}

std::string suggestion(std::string_view word, const std::vector<std::string>& candidates, const std::string& otherwise) {
  const auto near = nearest(word, candidates);
  return near ? ", did you mean '" + *near + "'?" : otherwise;
}

bool Range::holds(double value) const {
  return std::isfinite(value) && (minimum_open ? value > minimum : value >= minimum) &&
         (maximum_open ? value < maximum : value <= maximum);
}

std::string Range::text(const std::string& unit) const {
  return plugins::bounds_text(minimum, minimum_open, maximum, maximum_open, unit);
}

TableReader::TableReader(const toml::table& table, std::string what, ReadContext& context)
    : table_(&table), what_(std::move(what)), context_(&context), where_(locate(table.source())) {}

Location TableReader::where(std::string_view key) const {
  const toml::node* node = table_->get(key);
  return node ? locate(node->source()) : where_;
}

Location TableReader::where_key(std::string_view key) const {
  const auto entry = table_->find(key);
  return entry == table_->end() ? where_ : locate(entry->first.source());
}

const toml::node* TableReader::find(std::string_view key) {
  known_.emplace(key);
  return table_->get(key);
}

bool TableReader::require(std::string_view key, const std::string& expected) {
  if (has(key)) return true;
  error(where_, what_ + " needs " + quoted(key) + ", " + expected);
  return false;
}

void TableReader::refuse(std::string_view key, const std::string& reason) {
  if (has(key)) error(where_key(key), quoted(key) + " " + reason);
}

void TableReader::wrong_type(const toml::node& node, std::string_view key, const std::string& expected) const {
  error(locate(node.source()), quoted(key) + " must be " + expected + ", is " + found(node));
}

std::optional<double> TableReader::number_of(const toml::node& node, std::string_view key, const std::string& unit,
                                             const Range& range) const {
  const auto value = node.is_number() ? node.value<double>() : std::nullopt;
  if (!value) {
    wrong_type(node, key, with_unit("a number", unit));
    return std::nullopt;
  }
  if (!range.holds(*value)) {
    wrong_type(node, key, range.text(unit));
    return std::nullopt;
  }
  return value;
}

std::optional<double> TableReader::number(std::string_view key, const std::string& unit, Range range) {
  const toml::node* node = find(key);
  return node ? number_of(*node, key, unit, range) : std::nullopt;
}

double TableReader::required_number(std::string_view key, const std::string& unit, Range range) {
  if (!require(key, with_unit("a number", unit))) return 0;
  return number(key, unit, range).value_or(0);
}

std::optional<std::int64_t> TableReader::integer(std::string_view key, std::int64_t minimum, std::int64_t maximum) {
  const toml::node* node = find(key);
  if (!node) return std::nullopt;
  const auto* integer = node->as_integer();
  if (!integer) {
    wrong_type(*node, key, "an integer");
    return std::nullopt;
  }
  if (integer->get() < minimum || integer->get() > maximum) {
    std::string expected = "at least " + std::to_string(minimum);
    if (maximum == minimum + 1)
      expected = std::to_string(minimum) + " or " + std::to_string(maximum);
    else if (maximum < std::numeric_limits<std::int64_t>::max())
      expected = "an integer from " + std::to_string(minimum) + " to " + std::to_string(maximum);
    wrong_type(*node, key, expected);
    return std::nullopt;
  }
  return integer->get();
}

std::optional<bool> TableReader::boolean(std::string_view key) {
  const toml::node* node = find(key);
  if (!node) return std::nullopt;
  const auto* flag = node->as_boolean();
  if (!flag) {
    wrong_type(*node, key, "true or false");
    return std::nullopt;
  }
  return flag->get();
}

std::optional<std::string> TableReader::text(std::string_view key) {
  const toml::node* node = find(key);
  if (!node) return std::nullopt;
  const auto* text = node->as_string();
  if (!text) {
    wrong_type(*node, key, "a text");
    return std::nullopt;
  }
  return text->get();
}

std::optional<std::size_t> TableReader::choice(std::string_view key, const std::vector<std::string>& words) {
  const toml::node* node = find(key);
  if (!node) return std::nullopt;
  const auto* text = node->as_string();
  const auto word = text ? std::find(words.begin(), words.end(), text->get()) : words.end();
  if (word != words.end()) return std::size_t(word - words.begin());
  error(locate(node->source()), quoted(key) + " must be one of " + list_text(words, "\"") + ", is " + found(*node) +
                                    (text ? suggestion(text->get(), words, "") : ""));
  return std::nullopt;
}

std::optional<std::vector<double>> TableReader::numbers(std::string_view key, const std::string& unit,
                                                        std::size_t minimum_count, std::size_t maximum_count, Range range) {
  const toml::node* node = find(key);
  if (!node) return std::nullopt;
  std::string count = std::to_string(minimum_count);
  if (maximum_count == minimum_count + 1) count += " or " + std::to_string(maximum_count);
  if (maximum_count > minimum_count + 1) count += " to " + std::to_string(maximum_count);
  const toml::array* list = node->as_array();
  if (!list || list->size() < minimum_count || list->size() > maximum_count) {
    wrong_type(*node, key, with_unit("a list of " + count + (maximum_count == 1 ? " number" : " numbers"), unit));
    return std::nullopt;
  }
  std::vector<double> values;
  for (const toml::node& element : *list) {
    const auto value = number_of(element, std::string(key) + "." + std::to_string(values.size()), unit, range);
    if (!value) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

std::optional<Vector3> TableReader::vector(std::string_view key, const VectorForm& form) {
  const bool flat = context_->dimension == 2;
  const auto values = numbers(key, form.unit, flat ? 2 : 3, 3, form.range);
  if (!values) return std::nullopt;
  if (flat && form.planar && values->size() == 3 && (*values)[2] != 0) {
    error(where(key), quoted(key) + " must stay in the plane of a scene of dimension 2: its third number must be 0, is " +
                          plugins::number_text((*values)[2]));
    return std::nullopt;
  }
  return Vector3((*values)[0], (*values)[1], values->size() == 3 ? (*values)[2] : form.missing_z);
}

std::optional<Vector3> TableReader::direction(std::string_view key, const VectorForm& form) {
  const auto vector = this->vector(key, form);
  if (!vector) return std::nullopt;
  // A vector of unit length is kept to the bit, so that a written scene reads back the same.
  if (std::abs(vector->squaredNorm() - 1) < 1e-14) return vector;
  const double length = vector->stableNorm();
  if (!(length > 0) || !std::isfinite(length)) {
    error(where(key), quoted(key) + " must be a direction: not all of its numbers may be 0");
    return std::nullopt;
  }
  return *vector / length;
}

std::optional<std::filesystem::path> TableReader::file(std::string_view key, const std::vector<std::string>& extensions) {
  const auto name = text(key);
  if (!name) return std::nullopt;
  const std::filesystem::path path = (context_->directory / *name).lexically_normal();
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (std::find(extensions.begin(), extensions.end(), extension) == extensions.end()) {
    error_at(key, quoted(key) + " must be a file of type " + list_text(extensions) + ", is \"" + *name + "\"");
    return std::nullopt;
  }
  std::error_code status;
  if (!std::filesystem::is_regular_file(path, status)) {
    error_at(key, "there is no file " + path.string());
    return std::nullopt;
  }
  return path;
}

std::optional<TableReader> TableReader::table(std::string_view key, const std::string& what) {
  const toml::node* node = find(key);
  if (!node) return std::nullopt;
  const toml::table* table = node->as_table();
  if (!table) {
    wrong_type(*node, key, "a table");
    return std::nullopt;
  }
  return TableReader(*table, what, *context_);
}

std::vector<TableReader> TableReader::tables(std::string_view key, const std::string& what) {
  std::vector<TableReader> readers;
  const toml::node* node = find(key);
  if (!node) return readers;
  const toml::array* list = node->as_array();
  if (!list) {
    wrong_type(*node, key, "a list of tables" + std::string(node->is_table() ? ", each as [[" + std::string(key) + "]]" : ""));
    return readers;
  }
  for (const toml::node& element : *list) {
    if (const toml::table* table = element.as_table())
      readers.emplace_back(*table, what, *context_);
    else
      wrong_type(element, key, "a list of tables");
  }
  return readers;
}

void TableReader::finish() const {
  const std::vector<std::string> known(known_.begin(), known_.end());
  for (const auto& [key, value] : *table_) {
    if (known_.count(key.str())) continue;
    error(locate(key.source()), "unknown key " + quoted(key.str()) + " in " + what_ +
                                    suggestion(key.str(), known, "; it may have: " + list_text(known)));
  }
}

}  // namespace cleave::config
