#include "study/run_results.hpp"

#include "common/error.hpp"
#include "config/table_reader.hpp"
#include "output/frame_table.hpp"
#include "point/csv_table.hpp"
#include "study/expression.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>

namespace cleave::study {
namespace {

/// NaN for what is no number.
double number_in(std::string_view cell) {
  double value = std::numeric_limits<double>::quiet_NaN();
  const auto [end, problem] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  return problem == std::errc() && end == cell.data() + cell.size() ? value : std::numeric_limits<double>::quiet_NaN();
}

std::vector<unsigned char> decoded(std::string_view base64, const std::filesystem::path& file) {
  std::vector<unsigned char> bytes;
  bytes.reserve(base64.size() / 4 * 3);
  unsigned bits = 0;
  int have = 0;
  for (const char c : base64) {
    if (c == '=' || c == '\n') continue;
    const int digit = c >= 'A' && c <= 'Z'   ? c - 'A'
                      : c >= 'a' && c <= 'z' ? c - 'a' + 26
                      : c >= '0' && c <= '9' ? c - '0' + 52
                      : c == '+'             ? 62
                      : c == '/'             ? 63
                                             : -1;
    if (digit < 0) throw InputError(file.string() + ": error: is no frame of cleave run");
    bits = bits << 6 | unsigned(digit);
    have += 6;
    if (have < 8) continue;
    have -= 8;
    bytes.push_back(static_cast<unsigned char>(bits >> have & 0xff));
  }
  return bytes;
}

std::string attribute(std::string_view tag, std::string_view name) {
  const auto at = tag.find(std::string(name) + "=\"");
  if (at == std::string_view::npos) return {};
  const auto begin = at + name.size() + 2;
  return std::string(tag.substr(begin, tag.find('"', begin) - begin));
}

template <class T>
void copy_values(const std::vector<unsigned char>& bytes, std::vector<double>& values) {
  constexpr std::size_t header = sizeof(std::uint64_t);
  for (std::size_t i = header; i + sizeof(T) <= bytes.size(); i += sizeof(T)) {
    T value;
    std::memcpy(&value, bytes.data() + i, sizeof value);
    values.push_back(double(value));
  }
}

}  // namespace

const std::vector<std::string>& frame_columns() {
  static const std::vector<std::string> names = [] {
    auto columns = output::frame_columns();
    std::erase(columns, "limited_by");
    columns.insert(columns.end(), {"pieces", "debris"});
    columns.push_back("t");
    return columns;
  }();
  return names;
}

void FrameTable::require(const Formula& formula) const {
  for (const std::string& name : Expression::names_in(formula))
    if (std::find(absent.begin(), absent.end(), name) != absent.end())
      throw InputError(config::error_at(formula.where) + "frames.csv of this run has no column '" + name +
                       "': no body has a law of damage, and output.attributes does not ask for \"piece\"");
}

std::vector<double> FrameTable::column(const std::string& name) const {
  const auto& names = frame_columns();
  const auto index = std::size_t(std::find(names.begin(), names.end(), name) - names.begin());
  std::vector<double> values;
  for (const auto& row : rows) values.push_back(row.at(index));
  return values;
}

FrameTable read_frames(const std::filesystem::path& file) {
  const point::CsvTable table = point::CsvTable::read(file);
  FrameTable frames;
  for (const std::string& name : frame_columns())
    if (!table.column(name == "t" ? "time" : name)) frames.absent.push_back(name);
  for (const auto& row : table.rows()) {
    frames.rows.emplace_back();
    for (const std::string& name : frame_columns()) {
      const auto column = table.column(name == "t" ? "time" : name);
      frames.rows.back().push_back(column ? number_in(row.cells[*column]) : std::numeric_limits<double>::quiet_NaN());
    }
  }
  return frames;
}

Particles read_vtp(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream buffer;
  buffer << file.rdbuf();
  const std::string text = buffer.str();
  if (text.find("<VTKFile type=\"PolyData\"") == std::string::npos)
    throw InputError(path.string() + ": error: is no frame of cleave run");
  Particles particles;
  const std::size_t first = text.find("<PointData>"), last = text.find("<Verts>");
  for (std::size_t at = text.find("<DataArray", first); at < last; at = text.find("<DataArray", at + 1)) {
    const std::size_t tag_end = text.find('>', at), end = text.find("</DataArray>", tag_end);
    if (end == std::string::npos) throw InputError(path.string() + ": error: ends too early");
    const std::string_view tag(text.data() + at, tag_end - at);
    const std::string name = attribute(tag, "Name"), type = attribute(tag, "type");
    const auto bytes = decoded(std::string_view(text.data() + tag_end + 1, end - tag_end - 1), path);
    std::vector<double> values;
    if (type == "Float64") copy_values<double>(bytes, values);
    if (type == "Float32") copy_values<float>(bytes, values);
    if (type == "Int64") copy_values<std::int64_t>(bytes, values);
    if (type == "Int32") copy_values<std::int32_t>(bytes, values);
    const std::string given = attribute(tag, "NumberOfComponents");
    const std::size_t width = given.empty() ? 1 : std::stoul(given);
    for (std::size_t c = 0; c < width; ++c) {
      const std::string component = attribute(tag, "ComponentName" + std::to_string(c));
      particles.names.push_back(name == "Points"     ? std::string(1, "xyz"[c])
                                : name == "velocity" ? std::string("v") + "xyz"[c]
                                : width == 1         ? name
                                                     : name + "_" + component);
      particles.values.emplace_back();
      for (std::size_t i = c; i < values.size(); i += width) particles.values.back().push_back(values[i]);
    }
  }
  for (const auto& values : particles.values)
    if (values.size() != particles.count()) throw InputError(path.string() + ": error: is no frame of cleave run");
  return particles;
}

Particles read_last_particles(const std::filesystem::path& run) {
  const auto directory = run / "vtp";
  std::vector<std::filesystem::path> frames;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(directory, error))
    if (entry.path().extension() == ".vtp") frames.push_back(entry.path());
  if (frames.empty()) throw InputError(directory.string() + ": error: holds no frames");
  const auto number = [](const std::filesystem::path& p) {
    const std::string stem = p.stem().string();
    return std::atol(stem.substr(stem.find('_') + 1).c_str());
  };
  std::sort(frames.begin(), frames.end(), [&](const auto& a, const auto& b) { return number(a) < number(b); });
  Particles last = read_vtp(frames.back());
  const Particles start = read_vtp(frames.front());
  if (start.count() != last.count()) throw InputError(directory.string() + ": error: the number of particles changes");
  for (const char* name : {"x", "y", "z"}) {
    const auto at = std::size_t(std::find(start.names.begin(), start.names.end(), name) - start.names.begin());
    last.names.push_back(std::string(1, char(name[0] - 'x' + 'X')));
    last.values.push_back(start.values.at(at));
  }
  return last;
}

std::size_t Table::column(const std::string& name, const std::filesystem::path& file) const {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw InputError(file.string() + ": error: there is no column '" + name + "'" +
                     config::suggestion(name, names, "; there are: " + config::list_text(names)));
  return std::size_t(found - names.begin());
}

Table read_table(const std::filesystem::path& file) {
  const point::CsvTable csv = point::CsvTable::read(file);
  Table table{csv.names(), {}};
  for (const auto& row : csv.rows()) {
    table.rows.emplace_back();
    for (std::size_t i = 0; i < table.names.size(); ++i) table.rows.back().push_back(csv.number(row, i));
  }
  return table;
}

}  // namespace cleave::study
