#include "config/diagnostics.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <tuple>

namespace cleave::config {

std::string to_string(const Location& where) {
  if (where.line == 0) return where.file;
  return where.file + ":" + std::to_string(where.line) + ":" + std::to_string(where.column);
}

std::vector<std::string> Diagnostics::lines(std::vector<Entry> entries, const char* severity) {
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.where.line, a.where.column) < std::tie(b.where.line, b.where.column);
  });
  std::vector<std::string> lines;
  for (const Entry& entry : entries) lines.push_back(to_string(entry.where) + ": " + severity + ": " + entry.what);
  return lines;
}

void Diagnostics::throw_errors() const {
  if (errors_.empty()) return;
  std::string text;
  for (const std::string& line : lines(errors_, "error")) text += (text.empty() ? "" : "\n") + line;
  throw InputError(text);
}

std::vector<std::string> Diagnostics::warnings() const { return lines(warnings_, "warning"); }

}  // namespace cleave::config
