#include "point/csv_table.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iostream>
#include <sstream>

namespace cleave::point {
namespace {

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string_view unquoted(std::string_view cell) {
  cell = trimmed(cell);
  if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') cell = trimmed(cell.substr(1, cell.size() - 2));
  return cell;
}

std::string at(const std::string& file, int line) { return file + ":" + std::to_string(line) + ": error: "; }

}  // namespace

CsvTable CsvTable::read(const std::filesystem::path& path) {
  std::ostringstream text;
  if (path == "-") {
    text << std::cin.rdbuf();
    return parse(text.str(), "<stdin>");
  }
  std::error_code status;
  if (std::filesystem::is_directory(path, status)) throw InputError(path.string() + ": error: is a directory");
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path.string() + ": error: cannot be read; is there such a file?");
  text << file.rdbuf();
  return parse(text.str(), path.string());
}

CsvTable CsvTable::parse(std::string text, std::string file) {
  CsvTable table;
  table.file_ = std::move(file);
  table.text_.assign(text.begin(), text.end());
  std::string_view rest(table.text_.data(), table.text_.size());
  if (rest.substr(0, 3) == "\xEF\xBB\xBF") rest.remove_prefix(3);

  bool has_header = false;
  for (int number = 1; !rest.empty(); ++number) {
    const auto end = rest.find('\n');
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    if (trimmed(line).empty() || line.front() == '#') continue;
    Row row = table.split(line, number);
    if (!has_header) {
      has_header = true;
      for (const std::string_view cell : row.cells) table.names_.emplace_back(unquoted(cell));
      table.header_ = std::move(row);
    } else if (row.cells.size() != table.names_.size()) {
      throw InputError(at(table.file_, number) + "has " + std::to_string(row.cells.size()) + " cells, the header has " +
                       std::to_string(table.names_.size()));
    } else {
      table.rows_.push_back(std::move(row));
    }
  }
  if (!has_header) throw InputError(table.file_ + ": error: has no header line that names the columns");
  return table;
}

CsvTable::Row CsvTable::split(std::string_view line, int number) const {
  Row row{number, {}};
  std::size_t start = 0;
  bool in_quotes = false;
  for (std::size_t i = 0; i <= line.size(); ++i) {
    if (i < line.size() && line[i] == '"') in_quotes = !in_quotes;
    if (i < line.size() && (in_quotes || line[i] != ',')) continue;
    row.cells.push_back(line.substr(start, i - start));
    start = i + 1;
  }
  if (in_quotes) throw InputError(at(file_, number) + "a quote is not closed; cells may not span lines");
  return row;
}

std::optional<std::size_t> CsvTable::column(std::string_view name) const {
  const auto first = std::find(names_.begin(), names_.end(), name);
  if (first == names_.end()) return std::nullopt;
  const auto second = std::find(first + 1, names_.end(), name);
  if (second != names_.end())
    throw InputError(
        error_at(header_, std::size_t(second - names_.begin()), "column " + std::string(name) + " is there twice"));
  return std::size_t(first - names_.begin());
}

double CsvTable::number(const Row& row, std::size_t column) const {
  const std::string_view cell = unquoted(row.cells[column]);
  const std::string_view digits = cell.substr(cell.size() > 1 && cell[0] == '+' && cell[1] != '-' ? 1 : 0);
  double value = 0;
  const auto [end, problem] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const std::string is = cell.empty() ? "is empty" : "is '" + std::string(cell.substr(0, 40)) + "'";
  if (problem == std::errc::result_out_of_range)
    throw InputError(error_at(row, column, names_[column] + " is beyond double precision, " + is));
  if (problem != std::errc() || end != digits.data() + digits.size())
    throw InputError(error_at(row, column, names_[column] + " must be a number, " + is));
  if (!std::isfinite(value)) throw InputError(error_at(row, column, names_[column] + " must be finite, " + is));
  return value;
}

std::string CsvTable::error_at(const Row& row, std::size_t column, const std::string& what) const {
  const auto offset = row.cells[column].data() - row.cells.front().data();
  return file_ + ":" + std::to_string(row.line) + ":" + std::to_string(offset + 1) + ": error: " + what;
}

}  // namespace cleave::point
