#pragma once

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace cleave {

/// Rows of a table of reference values by column name. Lines that begin with # are comments; the name of a variant, in the
/// second column, may hold a comma.
inline std::vector<std::map<std::string, std::string>> read_reference_table(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::vector<std::string> header;
  std::vector<std::map<std::string, std::string>> rows;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::vector<std::string> cells;
    std::istringstream split(line);
    for (std::string cell; std::getline(split, cell, ',');) cells.push_back(cell);
    if (header.empty()) {
      header = cells;
      continue;
    }
    while (cells.size() > header.size()) {
      cells[1] += "," + cells[2];
      cells.erase(cells.begin() + 2);
    }
    auto& row = rows.emplace_back();
    for (std::size_t i = 0; i < header.size(); ++i) row[header[i]] = cells.at(i);
  }
  return rows;
}

}  // namespace cleave
