#pragma once

#include "point/evaluator.hpp"
#include "point/laws.hpp"

#include <string>
#include <vector>

namespace cleave::point {

/// "F00" .. "F22", row-major; likewise for other letters.
std::vector<std::string> matrix_columns(const std::string& letter);

/// Columns of the state variables, in the order of State::variables: the name of the variable, with 0..n-1 behind it if it has
/// several components, and with the kind of its law before it ("damage_history") where the name alone is taken.
std::vector<std::string> variable_columns(const Laws&);

/// Writes responses as cells. A quantity that the laws do not offer has an empty cell; a point without a usable result has
/// "nan" in every cell that would be a number.
class ResponseColumns {
 public:
  /// `marches`: the damage after a time is a result too.
  explicit ResponseColumns(const Laws&, bool marches = false);

  const std::vector<std::string>& names() const { return names_; }
  /// ",cell,cell,...": a leading comma before each.
  void append(std::string& line, const Response&) const;
  /// Digits that read back as the same number of the precision the laws work in.
  void append(std::string& line, double value) const;

 private:
  void append_optional(std::string& line, bool offered, bool usable, double value) const;

  std::vector<std::string> names_;
  bool single_, has_energy_, has_driving_force_, has_new_damage_;
  std::size_t variables_;
};

/// A finite number, with digits that read back as the same number of this precision.
void append_number(std::string& text, double value, config::Precision);

const char* name(cleave_status);  ///< "ok", "unreliable", "retry", "fatal"

}  // namespace cleave::point
