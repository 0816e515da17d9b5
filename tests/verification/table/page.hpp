#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::test {

/// A line of the table in docs/verification.md.
struct Line {
  int row = 0;
  std::string problem = {}, quantity = {}, reference = {}, measured = {}, error = {}, tolerance = {}, order = {}, command = {};
};

std::filesystem::path verification_page();

/// The lines between the marks of the table. Throws std::runtime_error where a line is not one of it.
std::vector<Line> lines_of(const std::filesystem::path& page);
/// Puts them there in place of those that are there.
void write_lines(const std::filesystem::path& page, const std::vector<Line>&);

/// Figures that report() has left in a directory, in the order of the problems.
std::vector<Line> collect(const std::filesystem::path& directory);

}  // namespace cleave::test
