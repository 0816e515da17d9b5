#include "scene/tetrahedra_io.hpp"

#include "common/error.hpp"
#include "scene/tetrahedra_formats.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>

namespace cleave::scene {
namespace {

/// Length of the character of UTF-8 that begins at `at`, 0 if none does.
std::size_t character_length(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
  const unsigned first = byte(at);
  if (first < 0x80) return first == 0 ? 0 : 1;
  const std::size_t length = first >= 0xf5 || first < 0xc2 ? 0 : first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
  for (std::size_t i = 1; i < length; i++)
    if ((byte(at + i) & 0xc0) != 0x80) return 0;
  return length;
}

std::string_view checked_text(const std::filesystem::path& file, std::string_view text) {
  int line = 1;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t length = character_length(text, at);
    if (length == 0)
      throw InputError(fmt::format("{}:{}: not a text in UTF-8 (byte {} is 0x{:02x}); binary files of this type are not read",
                                   file.string(), line, at, unsigned(static_cast<unsigned char>(text[at]))));
    line += text[at] == '\n';
    at += length;
  }
  constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";
  return text.substr(text.starts_with(byte_order_mark) ? byte_order_mark.size() : 0);
}

std::string shown(std::string_view word) {
  std::size_t length = 0;
  while (length < word.size() && length < 40) length += character_length(word, length);
  return "'" + std::string(word.substr(0, length)) + "'";
}

TetrahedraFile read_tetgen(const std::filesystem::path& file) {
  const auto partner = [&](const char* extension) {
    auto path = file;
    return path.replace_extension(extension);
  };
  const auto node_file = partner(".node"), ele_file = partner(".ele");
  for (const auto& path : {node_file, ele_file})
    if (path != file && !std::filesystem::exists(path))
      throw InputError(file.string() + ": there is no " + path.filename().string() +
                       " beside it; TetGen's files come in pairs, .node for the vertices and .ele for the tetrahedra");
  return parse_tetgen(node_file, read_bytes(node_file), ele_file, read_bytes(ele_file));
}

}  // namespace

TetrahedralMesh read_tetrahedra(const std::filesystem::path& file, std::vector<std::string>& notes) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  TetrahedraFile read;
  if (extension == ".node" || extension == ".ele") {
    require_file(file);
    read = read_tetgen(file);
  } else if (extension == ".mesh") {
    read = parse_medit(file, read_bytes(file));
  } else if (extension == ".vtk") {
    read = parse_vtk(file, read_bytes(file));
  } else if (extension == ".vtu") {
    read = parse_vtu(file, read_bytes(file));
  } else {
    throw InputError(file.string() +
                     ": not a file of tetrahedra; its name must end in .node or .ele (TetGen), .mesh (Medit), "
                     ".vtk (legacy VTK) or .vtu (VTK's XML)");
  }
  for (const std::string& note : read.notes) notes.push_back(file.string() + ": " + note);
  for (std::string& note : make_valid(read.mesh, file.string(), read.first_number)) notes.push_back(std::move(note));
  return std::move(read.mesh);
}

CommentedText::CommentedText(const std::filesystem::path& file, std::string_view text)
    : cursor_(file, checked_text(file, text)) {}

std::string_view CommentedText::without_comment(std::string_view word) {
  const std::size_t comment = word.find('#');
  if (comment == std::string_view::npos) return word;
  commented_ = true;
  return word.substr(0, comment);
}

std::string_view CommentedText::word() { return commented_ ? std::string_view() : without_comment(cursor_.word()); }

std::string_view CommentedText::word_anywhere() {
  for (std::string_view found = word();; found = word()) {
    if (!found.empty() || cursor_.at_end()) return found;
    cursor_.next_line();
    commented_ = false;
  }
}

bool CommentedText::next_row() {
  for (;;) {
    if (cursor_.at_end()) return false;
    cursor_.next_line();
    commented_ = false;
    TextCursor ahead = cursor_;
    const std::string_view found = ahead.word();
    if (!found.empty() && found.front() != '#') return true;
  }
}

double CommentedText::finite(std::string_view word, const char* what) const {
  if (word.empty()) fail(fmt::format("expected {}, found the end of the {}", what, at_end() ? "file" : "line"));
  const auto value = parse_number(word);
  if (!value) fail(fmt::format("expected {}, found {}", what, shown(word)));
  if (!std::isfinite(*value)) fail(fmt::format("{} is not finite: {}", what, shown(word)));
  return *value;
}

double CommentedText::number(const char* what) { return finite(word(), what); }
double CommentedText::number_anywhere(const char* what) { return finite(word_anywhere(), what); }

std::int64_t CommentedText::whole(std::string_view word, const char* what, std::int64_t least, std::int64_t greatest) const {
  if (word.empty()) fail(fmt::format("expected {}, found the end of the {}", what, at_end() ? "file" : "line"));
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error == std::errc::invalid_argument || end != word.data() + word.size())
    fail(fmt::format("expected {}, a whole number, found {}", what, shown(word)));
  if (least == greatest && (error != std::errc() || value != least))
    fail(fmt::format("{} must be {}, is {}", what, least, shown(word)));
  if (error != std::errc() || value < least || value > greatest)
    fail(fmt::format("{} must be from {} to {}, is {}", what, least, greatest, shown(word)));
  return value;
}

std::int64_t CommentedText::integer(const char* what, std::int64_t least, std::int64_t greatest) {
  return whole(word(), what, least, greatest);
}
std::int64_t CommentedText::integer_anywhere(const char* what, std::int64_t least, std::int64_t greatest) {
  return whole(word_anywhere(), what, least, greatest);
}

}  // namespace cleave::scene
