#include "output/frame_table.hpp"

#include "common/error.hpp"
#include "output/atomic_file.hpp"
#include "output/number.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <map>
#include <optional>
#include <sstream>
#include <utility>

namespace cleave::output {
namespace {

using Row = std::vector<std::pair<const char*, std::string>>;

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"') result += '"';
    result += c;
  }
  return result + '"';
}

Row columns(const FrameRecord& record) {
  return {{"frame", std::to_string(record.frame)},
          {"time", number(record.time)},
          {"steps", std::to_string(record.steps)},
          {"time_step", number(record.time_step)},
          {"limited_by", quoted(record.limited_by)},
          {"kinetic_energy", number(record.kinetic_energy)},
          {"elastic_energy", number(record.elastic_energy)},
          {"gravity_energy", number(record.gravity_energy)},
          {"momentum_x", number(record.momentum.x())},
          {"momentum_y", number(record.momentum.y())},
          {"momentum_z", number(record.momentum.z())},
          {"angular_momentum_x", number(record.angular_momentum.x())},
          {"angular_momentum_y", number(record.angular_momentum.y())},
          {"angular_momentum_z", number(record.angular_momentum.z())},
          {"center_of_mass_x", number(record.center_of_mass.x())},
          {"center_of_mass_y", number(record.center_of_mass.y())},
          {"center_of_mass_z", number(record.center_of_mass.z())},
          {"mass", number(record.mass)},
          {"volume", number(record.volume)},
          {"minimum_J", number(record.minimum_J)},
          {"maximum_J", number(record.maximum_J)},
          {"maximum_speed", number(record.maximum_speed)},
          {"maximum_damage", number(record.maximum_damage)},
          {"damaged_fraction", number(record.damaged_fraction)},
          {"damage_iterations", number(record.damage_iterations)},
          {"damage_iterations_most", std::to_string(record.damage_iterations_most)},
          {"damage_active", number(record.damage_active)},
          {"newton_iterations", number(record.newton_iterations)},
          {"linear_iterations", number(record.linear_iterations)},
          {"constraint_iterations", number(record.constraint_iterations)},
          {"constraint_residual", number(record.constraint_residual)},
          {"stable_step", number(record.stable_step)},
          {"halved_steps", std::to_string(record.halved_steps)},
          {"under_sampled", number(record.under_sampled)},
          {"wall_seconds", number(record.wall_seconds)}};
}

std::string joined(std::string line, const std::vector<std::string>& cells) {
  for (const std::string& cell : cells) line += ',' + cell;
  return line;
}

/// The last cells of a line, as many as `names`, taken off it.
std::map<std::string, std::string> take_last(std::string& line, const std::vector<std::string>& names) {
  std::map<std::string, std::string> cells;
  for (auto name = names.rbegin(); name != names.rend(); ++name) {
    const std::size_t comma = line.rfind(',');
    if (comma == std::string::npos) break;
    cells[*name] = line.substr(comma + 1);
    line.erase(comma);
  }
  return cells;
}

/// A table whose columns are `common` and any of those that not every run has, with `extra` in their place. Cells of columns
/// that it does not have are nan. Empty if it is no such table.
std::optional<std::string> continued(const std::string& earlier, const std::string& common,
                                     const std::vector<std::string>& extra) {
  std::istringstream lines(earlier);
  std::string line, table;
  std::getline(lines, line);
  std::vector<std::string> had;
  for (const auto& names : std::vector<std::vector<std::string>>{{}, {"pieces"}, {"debris", "pieces"}})
    if (line == joined(common, names)) had = names;
  if (line != joined(common, had)) return std::nullopt;
  table = joined(common, extra) + '\n';
  while (std::getline(lines, line)) {
    auto cells = take_last(line, had);
    for (const std::string& name : extra) line += ',' + cells.try_emplace(name, "nan").first->second;
    table += line + '\n';
  }
  return table;
}

}  // namespace

std::vector<std::string> frame_columns() {
  std::vector<std::string> names;
  for (const auto& [name, value] : columns({})) names.emplace_back(name);
  return names;
}

FrameTable::FrameTable(std::filesystem::path path, const std::string& earlier, bool pieces, bool debris)
    : path_(std::move(path)), pieces_(pieces || debris), debris_(debris) {
  std::string common;
  for (const auto& [name, value] : columns({})) common += (common.empty() ? "" : ",") + std::string(name);
  std::vector<std::string> extra;
  if (debris_) extra.emplace_back("debris");
  if (pieces_) extra.emplace_back("pieces");
  const auto table = earlier.empty() ? joined(common, extra) + '\n' : continued(earlier, common, extra);
  if (!table) throw InputError("cannot continue " + path_.string() + ": it has other columns than this program writes");
  AtomicFile file(path_);
  file.stream() << *table;
  file.commit();
  descriptor_ = ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  if (descriptor_ < 0) throw_file_error("write", path_, errno);
}

FrameTable::~FrameTable() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void FrameTable::append(const FrameRecord& record) {
  std::string line;
  for (const auto& [name, value] : columns(record)) line += (line.empty() ? "" : ",") + value;
  if (debris_) line += ',' + number(record.debris);
  if (pieces_) line += ',' + std::to_string(record.pieces.value_or(0));
  line += '\n';
  struct stat before {};
  if (::fstat(descriptor_, &before) != 0) throw_file_error("write", path_, errno);
  for (std::size_t written = 0; written < line.size();) {
    const ssize_t count = ::write(descriptor_, line.data() + written, line.size() - written);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      const int reason = count < 0 ? errno : ENOSPC;
      const int taken_back = ::ftruncate(descriptor_, before.st_size);
      static_cast<void>(taken_back);
      throw_file_error("write", path_, reason);
    }
    written += static_cast<std::size_t>(count);
  }
}

}  // namespace cleave::output
