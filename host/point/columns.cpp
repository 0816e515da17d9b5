#include "point/columns.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace cleave::point {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

void add(std::vector<std::string>& names, const std::vector<std::string>& more) {
  names.insert(names.end(), more.begin(), more.end());
}

}  // namespace

std::vector<std::string> matrix_columns(const std::string& letter) {
  std::vector<std::string> names;
  for (const char* index : {"00", "01", "02", "10", "11", "12", "20", "21", "22"}) names.push_back(letter + index);
  return names;
}

std::vector<std::string> variable_columns(const Laws& laws) {
  std::vector<std::string> taken = matrix_columns("F");
  taken.push_back("d");
  taken.push_back("dt");
  for (const auto* law : {&laws.plasticity, &laws.damage})
    if (*law)
      for (const auto& state : law->description().states) taken.push_back(state.name);
  const auto unique = [&](const std::string& name) { return std::count(taken.begin(), taken.end(), name) == 1; };

  std::vector<std::string> columns;
  for (const auto* law : {&laws.plasticity, &laws.damage}) {
    if (!*law) continue;
    for (const auto& state : law->description().states) {
      const std::string column = unique(state.name) ? state.name : plugins::name(law->description().kind) + ("_" + state.name);
      for (int i = 0; i < int(state.tensor); ++i)
        columns.push_back(state.tensor == CLEAVE_SCALAR ? column : column + std::to_string(i));
    }
  }
  return columns;
}

ResponseColumns::ResponseColumns(const Laws& laws, bool marches)
    : names_{"psi", "psi_plus", "J"},
      single_(laws.precision == config::Precision::single_precision),
      has_energy_(laws.elasticity.description().can(CLEAVE_HAS_ENERGY)),
      has_driving_force_(laws.damage && !laws.damage_is_local),
      has_new_damage_(laws.damage && (laws.damage_is_local || marches)) {
  add(names_, matrix_columns("P"));
  add(names_, matrix_columns("tau"));
  names_.push_back("yielded");
  add(names_, matrix_columns("Fe"));
  const auto variables = variable_columns(laws);
  variables_ = variables.size();
  for (const std::string& variable : variables) names_.push_back(variable + "_out");
  if (has_new_damage_) names_.push_back("d_out");
  names_.push_back("D");
  names_.push_back("status");
}

void ResponseColumns::append(std::string& line, double value) const {
  line += ',';
  if (std::isnan(value)) {
    line += "nan";
    return;
  }
  append_number(line, value, single_ ? config::Precision::single_precision : config::Precision::double_precision);
}

void ResponseColumns::append_optional(std::string& line, bool offered, bool usable, double value) const {
  if (offered)
    append(line, usable ? value : nan);
  else
    line += ',';
}

void ResponseColumns::append(std::string& line, const Response& r) const {
  const bool usable = r.usable();
  const auto number = [&](double value) { append(line, usable ? value : nan); };
  const auto matrix = [&](const Matrix3& a) {
    for (int i = 0; i < 9; ++i) number(a(i / 3, i % 3));
  };
  append_optional(line, has_energy_, usable, r.energy);
  append_optional(line, has_energy_, usable, r.tensile_energy);
  number(r.volume_ratio);
  matrix(r.first_piola);
  matrix(r.kirchhoff);
  number(r.yielded ? 1 : 0);
  matrix(r.deformation);
  for (std::size_t i = 0; i < variables_; ++i) number(usable ? r.variables[i] : nan);
  if (has_new_damage_) number(r.damage);
  append_optional(line, has_driving_force_, usable, r.driving_force);
  line += ',';
  line += name(r.status);
}

void append_number(std::string& text, double value, config::Precision precision) {
  char digits[40];
  const auto end = precision == config::Precision::single_precision
                       ? std::to_chars(digits, digits + sizeof digits, float(value), std::chars_format::general, 9).ptr
                       : std::to_chars(digits, digits + sizeof digits, value, std::chars_format::general, 17).ptr;
  text.append(digits, end);
}

const char* name(cleave_status status) {
  switch (status) {
    case CLEAVE_STATUS_OK:
      return "ok";
    case CLEAVE_STATUS_UNRELIABLE:
      return "unreliable";
    case CLEAVE_STATUS_RETRY:
      return "retry";
    default:
      return "fatal";
  }
}

}  // namespace cleave::point
