#include "common/error.hpp"
#include "scene/sampling.hpp"
#include "scene/text_input.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>

namespace cleave::scene {
namespace {

constexpr std::array<const char*, 3> position_names = {"x", "y", "z"}, velocity_names = {"vx", "vy", "vz"};

std::string_view trimmed(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

/// Lines that are neither blank nor comments, with their numbers.
class Lines {
 public:
  Lines(const std::filesystem::path& file, std::string_view text) : file_(file), rest_(text) {
    constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";
    if (rest_.starts_with(byte_order_mark)) rest_.remove_prefix(byte_order_mark.size());
  }
  bool next() {
    while (!rest_.empty()) {
      const std::size_t end = rest_.find('\n');
      line_ = trimmed(rest_.substr(0, end));
      rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
      ++number_;
      if (!line_.empty() && line_.front() != '#') return true;
    }
    return false;
  }
  std::string_view line() const { return line_; }
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(file_.string() + ":" + std::to_string(number_) + ": " + problem);
  }

 private:
  const std::filesystem::path& file_;
  std::string_view rest_, line_;
  int number_ = 0;
};

std::string_view take_field(std::string_view& line, bool& more) {
  const std::size_t comma = line.find(',');
  const std::string_view field = trimmed(line.substr(0, comma));
  more = comma != std::string_view::npos;
  line.remove_prefix(more ? comma + 1 : line.size());
  return field;
}

std::vector<std::string> read_header(const Lines& lines) {
  std::vector<std::string> names;
  std::string_view line = lines.line();
  for (bool more = true; more;) {
    std::string_view name = take_field(line, more);
    if (name.size() >= 2 && name.front() == '"' && name.back() == '"') name = trimmed(name.substr(1, name.size() - 2));
    if (name.empty()) lines.fail("column " + std::to_string(names.size() + 1) + " of the header has no name");
    if (parse_number(name))
      lines.fail("expected a header with the names of the columns, found the number " + std::string(name));
    if (std::find(names.begin(), names.end(), name) != names.end()) {
      lines.fail("the column '" + std::string(name) + "' appears twice");
    }
    names.emplace_back(name);
  }
  return names;
}

/// Where each quantity stands in a row; -1 if the file does not have it.
struct Columns {
  std::array<int, 3> position, velocity;
  std::array<std::array<int, 3>, 3> deformation;
  int volume;
  std::vector<std::pair<std::string, int>> states;
  bool has_velocity = false, has_deformation = false;
};

Columns find_columns(const std::vector<std::string>& names, int dimension, const Lines& lines) {
  std::vector<char> taken(names.size(), 0);
  const auto column = [&](const std::string& name) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) return -1;
    taken[static_cast<std::size_t>(found - names.begin())] = 1;
    return static_cast<int>(found - names.begin());
  };
  Columns columns;
  std::string missing;
  for (std::size_t i = 0; i < 3; ++i) {
    columns.position[i] = column(position_names[i]);
    columns.velocity[i] = column(velocity_names[i]);
    columns.has_velocity |= columns.velocity[i] >= 0;
    const bool needed = static_cast<int>(i) < dimension;
    if (needed && columns.position[i] < 0) missing += (missing.empty() ? "" : ", ") + std::string(position_names[i]);
  }
  if (!missing.empty())
    lines.fail("the header lacks the column " + missing + "; a particle file needs x,y" + (dimension == 3 ? ",z" : ""));
  columns.volume = column("volume");

  std::string missing_deformation;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      const std::string name = {'F', static_cast<char>('0' + i), static_cast<char>('0' + j)};
      columns.deformation[i][j] = column(name);
      columns.has_deformation |= columns.deformation[i][j] >= 0;
      const bool needed = static_cast<int>(std::max(i, j)) < dimension;
      if (needed && columns.deformation[i][j] < 0) missing_deformation += (missing_deformation.empty() ? "" : ", ") + name;
    }
  }
  if (columns.has_deformation && !missing_deformation.empty()) {
    lines.fail("the header lacks the column " + missing_deformation + "; a deformation gradient needs all its components");
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!taken[i]) columns.states.emplace_back(names[i], static_cast<int>(i));
  }
  return columns;
}

void read_row(const Lines& lines, const std::vector<std::string>& names, std::vector<double>& row) {
  std::string_view line = lines.line();
  bool more = true;
  std::size_t i = 0;
  for (; more; ++i) {
    const std::string_view field = take_field(line, more);
    if (i == names.size()) lines.fail("more values than the " + std::to_string(names.size()) + " columns of the header");
    const std::optional<double> value = parse_number(field);
    if (!value) lines.fail("column '" + names[i] + "': expected a number, found '" + std::string(field.substr(0, 40)) + "'");
    if (!std::isfinite(*value))
      lines.fail("column '" + names[i] + "': the value is not finite: " + std::string(field.substr(0, 40)));
    row[i] = *value;
  }
  if (i < names.size()) lines.fail("column '" + names[i] + "': the value is missing");
}

}  // namespace

ParticleSource read_particles(const std::filesystem::path& file, int dimension, double default_volume) {
  const std::string text = read_bytes(file);
  Lines lines(file, text);
  if (!lines.next()) throw InputError(file.string() + ": the particle file is empty");
  const std::vector<std::string> names = read_header(lines);
  const Columns columns = find_columns(names, dimension, lines);
  if (columns.volume < 0 && !(default_volume > 0 && std::isfinite(default_volume))) {
    lines.fail("the header lacks the column volume, and there is no volume to use instead");
  }

  ParticleSource particles;
  std::vector<std::vector<double>*> states;
  for (const auto& state : columns.states) states.push_back(&particles.states[state.first]);
  std::vector<double> row(names.size());
  const auto value = [&row](int column, double otherwise) {
    return column < 0 ? otherwise : row[static_cast<std::size_t>(column)];
  };
  const auto require_in_plane = [&](int column) {
    if (dimension == 2 && value(column, 0) != 0) {
      lines.fail("column '" + names[static_cast<std::size_t>(column)] + "': must be 0 in two dimensions");
    }
  };
  while (lines.next()) {
    read_row(lines, names, row);
    Vector3 position, velocity;
    for (std::size_t i = 0; i < 3; ++i) {
      position[static_cast<Eigen::Index>(i)] = value(columns.position[i], 0);
      velocity[static_cast<Eigen::Index>(i)] = value(columns.velocity[i], 0);
    }
    require_in_plane(columns.position[2]);
    require_in_plane(columns.velocity[2]);
    particles.positions.push_back(position);
    if (columns.has_velocity) particles.velocities.push_back(velocity);

    const double volume = value(columns.volume, default_volume);
    if (!(volume > 0)) lines.fail("column 'volume': must be positive");
    particles.volumes.push_back(volume);

    if (columns.has_deformation) {
      Matrix3 F;
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
          F(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = value(columns.deformation[i][j], i == j ? 1 : 0);
          if (i != j && std::max(i, j) == 2) require_in_plane(columns.deformation[i][j]);
        }
      }
      particles.deformation.push_back(F);
    }
    for (std::size_t s = 0; s < states.size(); ++s)
      states[s]->push_back(row[static_cast<std::size_t>(columns.states[s].second)]);
  }
  if (particles.positions.empty()) throw InputError(file.string() + ": the particle file has a header but no particles");
  return particles;
}

}  // namespace cleave::scene
