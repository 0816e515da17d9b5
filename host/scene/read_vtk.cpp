#include "common/error.hpp"
#include "scene/vtk_cells.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cstring>
#include <limits>
#include <map>

namespace cleave::scene {
namespace {

constexpr std::int64_t most = std::numeric_limits<std::uint32_t>::max() - 1;

struct Type {
  std::size_t size;
  bool floating, is_signed;
};

const std::map<std::string_view, Type>& types() {
  static const std::map<std::string_view, Type> table = {
      {"char", {1, false, true}},
      {"unsigned_char", {1, false, false}},
      {"short", {2, false, true}},
      {"unsigned_short", {2, false, false}},
      {"int", {4, false, true}},
      {"unsigned_int", {4, false, false}},
      {"vtkidtype", {8, false, true}},
      {"long", {8, false, true}},
      {"unsigned_long", {8, false, false}},
      {"vtktypeint64", {8, false, true}},
      {"vtktypeint32", {4, false, true}},
      {"float", {4, true, true}},
      {"double", {8, true, true}},
  };
  return table;
}

constexpr Type integer32{4, false, true};

/// A legacy file: lines of keywords, and arrays of numbers as text or as big-endian bytes.
class Input {
 public:
  Input(const std::filesystem::path& file, std::string_view bytes) : file_(&file), bytes_(bytes) {}

  bool at_end() const { return position_ >= bytes_.size(); }
  void set_binary(bool binary) { binary_ = binary; }

  std::string_view line() {
    begin_ = position_;
    const std::size_t end = std::min(bytes_.find('\n', position_), bytes_.size());
    std::string_view text = bytes_.substr(position_, end - position_);
    position_ = std::min(end + 1, bytes_.size());
    if (text.ends_with('\r')) text.remove_suffix(1);
    return text;
  }

  /// Words in lower case of the next line that has any; empty at the end of the file.
  std::vector<std::string> words() {
    std::vector<std::string> found;
    while (found.empty() && !at_end()) {
      const std::string_view text = line();
      for (std::size_t at = 0; at < text.size();) {
        const auto blank = [](char c) { return c == ' ' || c == '\t'; };
        const auto begin = std::find_if_not(text.begin() + std::ptrdiff_t(at), text.end(), blank);
        const auto end = std::find_if(begin, text.end(), blank);
        if (begin != end) found.emplace_back(begin, end);
        at = std::size_t(end - text.begin());
      }
    }
    for (std::string& word : found)
      for (char& c : word) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return found;
  }

  /// `count` numbers of the type, `what` in messages. `use(number)` of each; integers beyond 2^53 are not told apart.
  template <class Use>
  void numbers(std::int64_t count, const Type& type, const char* what, const Use& use) {
    if (binary_) return binary_numbers(count, type, what, use);
    for (std::int64_t i = 0; i < count; i++) {
      constexpr std::string_view blanks = " \t\r\n\v\f";
      begin_ = std::min(bytes_.find_first_not_of(blanks, position_), bytes_.size());
      position_ = std::min(bytes_.find_first_of(blanks, begin_), bytes_.size());
      const std::string_view word = bytes_.substr(begin_, position_ - begin_);
      if (word.empty()) fail(fmt::format("expected {}, found the end of the file after {} of {} numbers", what, i, count));
      const auto value = parse_number(word);
      if (!value) fail(fmt::format("expected {}, found something that is not a number", what));
      if (!std::isfinite(*value) || (!type.floating && *value != std::floor(*value)))
        fail(fmt::format("{} must be a {} number, is {:g}", what, type.floating ? "finite" : "whole", *value));
      use(*value);
    }
  }

  [[noreturn]] void fail(const std::string& problem) const {
    const auto lines = std::count(bytes_.begin(), bytes_.begin() + std::ptrdiff_t(std::min(begin_, bytes_.size())), '\n');
    throw InputError(binary_ ? fmt::format("{}: byte {}: {}", file_->string(), begin_, problem)
                             : fmt::format("{}:{}: {}", file_->string(), lines + 1, problem));
  }

 private:
  template <class Use>
  void binary_numbers(std::int64_t count, const Type& type, const char* what, const Use& use) {
    begin_ = position_;
    if (std::uint64_t(count) > (bytes_.size() - position_) / type.size)
      fail(fmt::format("the file ends within {} numbers, each {}", count, what));
    for (std::int64_t i = 0; i < count; i++) {
      begin_ = position_;
      const double value = big_endian(bytes_.substr(position_, type.size), type);
      position_ += type.size;
      if (!std::isfinite(value)) fail(fmt::format("{} must be finite", what));
      use(value);
    }
  }

  static double big_endian(std::string_view bytes, const Type& type) {
    std::uint64_t word = 0;
    for (const char c : bytes) word = word << 8 | static_cast<unsigned char>(c);
    if (type.floating) return type.size == 8 ? std::bit_cast<double>(word) : double(std::bit_cast<float>(std::uint32_t(word)));
    if (!type.is_signed) return double(word);
    const int unused = 64 - 8 * int(type.size);
    return double(std::int64_t(word << unused) >> unused);
  }

  const std::filesystem::path* file_;
  std::string_view bytes_;
  std::size_t position_ = 0, begin_ = 0;  ///< begin_: of what was read last
  bool binary_ = false;
};

class Reader {
 public:
  Reader(const std::filesystem::path& file, std::string_view bytes) : input_(file, bytes) {}

  TetrahedraFile read() {
    read_header();
    while (!(has_points_ && has_cells_ && has_types_)) {
      const auto words = input_.words();
      if (words.empty()) missing();
      const std::string& keyword = words[0];
      if (keyword == "points") {
        read_points(words);
      } else if (keyword == "cells") {
        read_cells(words);
      } else if (keyword == "cell_types") {
        read_types(words);
      } else if (keyword == "field") {
        skip_field(words);
      } else if (keyword == "metadata") {
        while (!input_.at_end() && !input_.line().empty()) continue;
      } else {
        input_.fail("expected POINTS, CELLS or CELL_TYPES, found another line");
      }
    }
    take_tetrahedra(cells_, result_, [&](const std::string& problem) { input_.fail(problem); });
    return std::move(result_);
  }

 private:
  void read_header() {
    if (!input_.line().starts_with("# vtk DataFile Version"))
      input_.fail("a legacy VTK file must begin with '# vtk DataFile Version'");
    input_.line();
    const auto format = input_.words();
    if (format != std::vector<std::string>{"ascii"} && format != std::vector<std::string>{"binary"})
      input_.fail("expected ASCII or BINARY in the third line");
    const bool binary = format[0] == "binary";
    if (input_.words() != std::vector<std::string>{"dataset", "unstructured_grid"})
      input_.fail("expected DATASET UNSTRUCTURED_GRID; other data sets hold no tetrahedra");
    input_.set_binary(binary);
  }

  std::int64_t count(const std::vector<std::string>& words, std::size_t place, std::int64_t least) const {
    std::int64_t value = 0;
    if (place >= words.size()) input_.fail(fmt::format("this line needs {} numbers", place));
    const std::string& word = words[place];
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size() || value < least || value > 16 * most)
      input_.fail(fmt::format("number {} of this line must be a count from {} to {}", place, least, 16 * most));
    return value;
  }

  Type type(const std::vector<std::string>& words, std::size_t place) const {
    const auto found = place < words.size() ? types().find(words[place]) : types().end();
    if (found == types().end())
      input_.fail(fmt::format("word {} of this line must be a type of numbers such as float or int", place + 1));
    return found->second;
  }

  void read_points(const std::vector<std::string>& words) {
    if (has_points_) input_.fail("there are POINTS already");
    has_points_ = true;
    const auto points = count(words, 1, 1);
    if (points > most) input_.fail(fmt::format("more than {} points", most));
    auto& vertices = result_.mesh.vertices;
    int component = 3;
    input_.numbers(3 * points, type(words, 2), "a coordinate", [&](double value) {
      if (component == 3) {
        vertices.emplace_back();
        component = 0;
      }
      vertices.back()[component++] = value;
    });
  }

  /// Up to version 4: for each cell the number of its corners and those. From 5 on: offsets, then all corners.
  void read_cells(const std::vector<std::string>& words) {
    if (has_cells_) input_.fail("there are CELLS already");
    has_cells_ = true;
    const auto first = count(words, 1, 0), second = count(words, 2, 0);
    const Input start = input_;
    const auto next = input_.at_end() ? std::vector<std::string>() : input_.words();
    if (!next.empty() && next[0] == "offsets") {
      input_.numbers(first, type(next, 1), "an offset", [&](double offset) { cells_.offsets.push_back(offset); });
      const auto line = input_.words();
      if (line.empty() || line[0] != "connectivity") input_.fail("expected CONNECTIVITY after OFFSETS");
      input_.numbers(second, type(line, 1), "a corner", [&](double corner) { cells_.corners.push_back(corner); });
      return;
    }
    input_ = start;
    std::int64_t left = 0;
    cells_.offsets.push_back(0);
    input_.numbers(second, integer32, "a corner or the number of corners of a cell", [&](double value) {
      if (left > 0) {
        cells_.corners.push_back(value);
        left--;
      } else {
        if (!(value >= 0 && value <= double(second))) input_.fail(fmt::format("a cell cannot have {:g} corners", value));
        left = std::int64_t(value);
        cells_.offsets.push_back(cells_.offsets.back() + value);
      }
    });
    if (left > 0 || std::int64_t(cells_.offsets.size()) != first + 1)
      input_.fail(fmt::format("CELLS says {} cells, its {} numbers hold {}", first, second, cells_.offsets.size() - 1));
  }

  void read_types(const std::vector<std::string>& words) {
    if (has_types_) input_.fail("there are CELL_TYPES already");
    has_types_ = true;
    input_.numbers(count(words, 1, 0), integer32, "the type of a cell", [&](double value) { cells_.types.push_back(value); });
  }

  /// FIELD name n, then n times: name components tuples type, and the numbers.
  void skip_field(const std::vector<std::string>& words) {
    const auto arrays = count(words, 2, 0);
    for (std::int64_t i = 0; i < arrays; i++) {
      const auto array = input_.words();
      if (array.empty()) missing();
      const auto components = count(array, 1, 1), tuples = count(array, 2, 0);
      if (components > 1024) input_.fail("an array of a field has more than 1024 components");
      input_.numbers(components * tuples, type(array, 3), "a value of a field", [](double) {});
    }
  }

  [[noreturn]] void missing() const {
    input_.fail(fmt::format("the file ends without {}", !has_points_ ? "POINTS" : !has_cells_ ? "CELLS" : "CELL_TYPES"));
  }

  Input input_;
  TetrahedraFile result_;
  bool has_points_ = false, has_cells_ = false, has_types_ = false;
  VtkCells cells_;
};

}  // namespace

void take_tetrahedra(const VtkCells& cells, TetrahedraFile& result, const std::function<void(const std::string&)>& fail) {
  constexpr int tetrahedron = 10, first_volume = 11;  // of VTK's cell types: below are points, lines and faces
  const auto& [offsets, all_corners, types] = cells;
  if (types.size() + 1 != offsets.size() && !(types.empty() && offsets.empty()))
    fail(fmt::format("there are {} types for {} cells", types.size(), offsets.empty() ? 0 : offsets.size() - 1));
  std::size_t others = 0;
  for (std::size_t cell = 0; cell < types.size(); cell++) {
    const double begin = offsets[cell], end = offsets[cell + 1];
    if (types[cell] != tetrahedron) {
      if (types[cell] >= first_volume)
        fail(fmt::format("cell {} is of type {:g}; volumes must be tetrahedra of four corners, type 10", cell, types[cell]));
      others++;
      continue;
    }
    if (!(begin >= 0 && end == begin + 4 && end <= double(all_corners.size())))
      fail(fmt::format("cell {} is a tetrahedron without four corners", cell));
    auto& corners = result.mesh.tetrahedra.emplace_back();
    for (std::size_t i = 0; i < 4; i++) {
      const double corner = all_corners[std::size_t(begin) + i];
      if (!(corner >= 0 && corner < double(result.mesh.vertices.size())))
        fail(fmt::format("cell {} has corner {:g}; corners must be from 0 to {}", cell, corner,
                         std::int64_t(result.mesh.vertices.size()) - 1));
      corners[i] = std::uint32_t(corner);
    }
  }
  if (others > 0) result.notes.push_back(fmt::format("{} cells that are points, lines or faces are left out", others));
}

TetrahedraFile parse_vtk(const std::filesystem::path& file, std::string_view bytes) { return Reader(file, bytes).read(); }

}  // namespace cleave::scene
