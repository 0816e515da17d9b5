#include "page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* begin = "<!-- written by ./dev verify -->";
constexpr const char* end = "<!-- end of what ./dev verify writes -->";
constexpr const char* head =
    "| | problem | quantity | reference | measured | error | tolerance | order | test |\n"
    "|--:|---|---|--:|--:|--:|--:|--:|---|\n";

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Where the table begins and ends.
std::pair<std::size_t, std::size_t> place_of_table(const std::string& text, const fs::path& page) {
  const std::size_t first = text.find(begin), last = text.find(end);
  if (first == std::string::npos || last == std::string::npos || last < first)
    throw std::runtime_error(page.string() + " has no \"" + begin + "\" ... \"" + end + "\"");
  return {first + std::string(begin).size() + 1, last};
}

}  // namespace

fs::path verification_page() { return fs::path(CLEAVE_SOURCE_DIR) / "docs/verification.md"; }

std::vector<Line> lines_of(const fs::path& page) {
  const std::string text = text_of(page);
  const auto [first, last] = place_of_table(text, page);
  std::istringstream table(text.substr(first, last - first));
  std::vector<Line> lines;
  for (std::string line; std::getline(table, line);) {
    if (!line.starts_with("| ") || line.starts_with("| |")) continue;
    std::vector<std::string> cells;
    std::size_t at = 1;
    for (std::size_t bar; (bar = line.find('|', at)) != std::string::npos; at = bar + 1) {
      std::string cell = line.substr(at, bar - at);
      cell.erase(0, cell.find_first_not_of(' '));
      cell.erase(cell.find_last_not_of(' ') + 1);
      cells.push_back(cell);
    }
    if (cells.size() != 9) throw std::runtime_error(page.string() + ": not a line of the table: " + line);
    std::string command = cells[8];
    std::erase(command, '`');
    lines.push_back({std::stoi(cells[0]), cells[1], cells[2], cells[3], cells[4], cells[5], cells[6], cells[7], command});
  }
  return lines;
}

void write_lines(const fs::path& page, const std::vector<Line>& lines) {
  std::string text = text_of(page);
  const auto [first, last] = place_of_table(text, page);
  std::string table = std::string("\n") + head;
  for (const Line& l : lines)
    table += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} | `{}` |\n", l.row, l.problem, l.quantity, l.reference,
                         l.measured, l.error, l.tolerance, l.order, l.command);
  text.replace(first, last - first, table + "\n");
  std::ofstream out(page);
  out << text;
  if (!out.flush()) throw std::runtime_error("cannot write " + page.string());
}

std::vector<Line> collect(const fs::path& directory) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(directory))
    if (entry.path().extension() == ".jsonl") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Line> lines;
  for (const auto& file : files) {
    std::ifstream in(file);
    for (std::string text; std::getline(in, text);) {
      const auto json = nlohmann::json::parse(text);
      Line l{.row = json.at("row"), .problem = json.at("problem"), .quantity = json.at("quantity")};
      l.reference = json.at("reference");
      l.measured = json.at("measured");
      l.error = json.at("error");
      l.tolerance = json.at("tolerance");
      l.order = json.at("order");
      l.command = json.at("command");
      for (const std::string* cell : {&l.problem, &l.quantity})
        if (cell->find('|') != std::string::npos) throw std::runtime_error("a bar in \"" + *cell + "\" would end its cell");
      for (const Line& other : lines)
        if (other.row == l.row && other.problem == l.problem && other.quantity == l.quantity)
          throw std::runtime_error("two figures are called \"" + l.problem + "\", \"" + l.quantity + "\"");
      lines.push_back(l);
    }
  }
  std::stable_sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) { return a.row < b.row; });
  return lines;
}

}  // namespace cleave::test
