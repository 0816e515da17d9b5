#pragma once

#include "plugins/schema.hpp"

#include <optional>
#include <string>

namespace cleave::plugins {

/// Why a plugin may not be given this value: wrong type, outside the validity bounds, not a choice, wrong number of elements.
/// "must be greater than 0 Pa, is -3". Empty if the value is good.
std::optional<std::string> problem_with(const Parameter&, const Value&);

/// Shortest text that reads back as the same number: "0.3", "1e+06", "inf".
std::string number_text(double);

/// "0 < x <= 0.5" in words of the unit: "greater than 0 Pa", "in [0, 1)", "finite" if there are no bounds.
std::string bounds_text(double minimum, bool minimum_open, double maximum, bool maximum_open, const std::string& unit);

/// "a number", "an integer", "true or false", "a text", "a list of numbers".
const char* type_text(cleave_type);

/// "0.3", "true", "exact", "[-1, -1]".
std::string value_text(const Value&);

}  // namespace cleave::plugins
