#include "plugins/parameters.hpp"

#include <charconv>
#include <cmath>

namespace cleave::plugins {
namespace {

std::string with_unit(double value, const std::string& unit) {
  return number_text(value) + (unit.empty() || unit == "1" ? "" : " " + unit);
}

std::optional<std::string> out_of_bounds(const Parameter& parameter, double value) {
  const bool below = parameter.minimum_open ? value <= parameter.minimum : value < parameter.minimum;
  const bool above = parameter.maximum_open ? value >= parameter.maximum : value > parameter.maximum;
  if (std::isfinite(value) && !below && !above) return std::nullopt;
  return "must be " +
         bounds_text(parameter.minimum, parameter.minimum_open, parameter.maximum, parameter.maximum_open, parameter.unit) +
         ", is " + number_text(value);
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const auto& word : words) text += (text.empty() ? "\"" : ", \"") + word + "\"";
  return text;
}

}  // namespace

std::string number_text(double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  return std::string(buffer, end);
}

std::string bounds_text(double minimum, bool minimum_open, double maximum, bool maximum_open, const std::string& unit) {
  const bool bounded_below = std::isfinite(minimum), bounded_above = std::isfinite(maximum);
  if (bounded_below && bounded_above)
    return std::string("in ") + (minimum_open ? "(" : "[") + number_text(minimum) + ", " + number_text(maximum) +
           (maximum_open ? ")" : "]") + (unit.empty() || unit == "1" ? "" : " " + unit);
  if (bounded_below) return (minimum_open ? "greater than " : "at least ") + with_unit(minimum, unit);
  if (bounded_above) return (maximum_open ? "less than " : "at most ") + with_unit(maximum, unit);
  return "finite";
}

const char* type_text(cleave_type type) {
  switch (type) {
    case CLEAVE_TYPE_NUMBER:
      return "a number";
    case CLEAVE_TYPE_INTEGER:
      return "an integer";
    case CLEAVE_TYPE_BOOLEAN:
      return "true or false";
    case CLEAVE_TYPE_TEXT:
      return "a text";
    case CLEAVE_TYPE_NUMBER_LIST:
      return "a list of numbers";
  }
  return "";
}

std::string value_text(const Value& value) {
  struct Visitor {
    std::string operator()(double number) const { return number_text(number); }
    std::string operator()(std::int64_t integer) const { return std::to_string(integer); }
    std::string operator()(bool flag) const { return flag ? "true" : "false"; }
    std::string operator()(const std::string& text) const { return text; }
    std::string operator()(const std::vector<double>& list) const {
      std::string text = "[";
      for (double element : list) text += (text.size() > 1 ? ", " : "") + number_text(element);
      return text + "]";
    }
  };
  return std::visit(Visitor{}, value);
}

std::optional<std::string> problem_with(const Parameter& parameter, const Value& value) {
  const std::string wrong_type = std::string("must be ") + type_text(parameter.type);
  switch (parameter.type) {
    case CLEAVE_TYPE_NUMBER: {
      if (const auto* number = std::get_if<double>(&value)) return out_of_bounds(parameter, *number);
      if (const auto* integer = std::get_if<std::int64_t>(&value)) return out_of_bounds(parameter, double(*integer));
      return wrong_type;
    }
    case CLEAVE_TYPE_INTEGER: {
      if (const auto* integer = std::get_if<std::int64_t>(&value)) return out_of_bounds(parameter, double(*integer));
      return wrong_type;
    }
    case CLEAVE_TYPE_BOOLEAN:
      return std::holds_alternative<bool>(value) ? std::nullopt : std::optional(wrong_type);
    case CLEAVE_TYPE_TEXT: {
      const auto* text = std::get_if<std::string>(&value);
      if (!text) return wrong_type;
      if (parameter.choices.empty()) return std::nullopt;
      for (const auto& choice : parameter.choices)
        if (choice == *text) return std::nullopt;
      return "must be one of " + joined(parameter.choices) + ", is \"" + *text + "\"";
    }
    case CLEAVE_TYPE_NUMBER_LIST: {
      const auto* list = std::get_if<std::vector<double>>(&value);
      if (!list) return wrong_type;
      if (list->size() < parameter.min_count || list->size() > parameter.max_count) {
        std::string expected = std::to_string(parameter.min_count);
        if (parameter.max_count != parameter.min_count) expected += " to " + std::to_string(parameter.max_count);
        return "must have " + expected + " elements, has " + std::to_string(list->size());
      }
      for (double element : *list)
        if (auto problem = out_of_bounds(parameter, element)) return "every element " + *problem;
      return std::nullopt;
    }
  }
  return wrong_type;
}

}  // namespace cleave::plugins
