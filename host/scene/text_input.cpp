#include "scene/text_input.hpp"

#include "common/error.hpp"

#include <fstream>

namespace cleave::scene {

void require_file(const std::filesystem::path& file) {
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) throw InputError(file.string() + ": no such file");
  if (std::filesystem::is_directory(status)) throw InputError(file.string() + ": is a directory, not a file");
}

std::string read_bytes(const std::filesystem::path& file) {
  require_file(file);
  std::ifstream stream(file, std::ios::binary | std::ios::ate);
  if (!stream) throw InputError(file.string() + ": cannot be opened for reading");
  std::string bytes(static_cast<std::size_t>(std::max<std::streamoff>(0, stream.tellg())), '\0');
  stream.seekg(0);
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!stream) throw InputError(file.string() + ": cannot be read");
  return bytes;
}

void TextCursor::skip_blanks() {
  while (position_ < text_.size()) {
    const char c = text_[position_];
    if (c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f') {
      ++position_;
      continue;
    }
    const std::size_t line_break = text_.compare(position_, 2, "\\\n") == 0     ? 2
                                   : text_.compare(position_, 3, "\\\r\n") == 0 ? 3
                                                                                : 0;
    if (line_break == 0) return;
    position_ += line_break;
    ++line_;
  }
}

std::string_view TextCursor::word() {
  skip_blanks();
  const std::size_t begin = position_;
  while (position_ < text_.size()) {
    const char c = text_[position_];
    if (c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\v' || c == '\f') break;
    ++position_;
  }
  return text_.substr(begin, position_ - begin);
}

std::string_view TextCursor::word_anywhere() {
  for (std::string_view found = word();; found = word()) {
    if (!found.empty() || at_end()) return found;
    next_line();
  }
}

void TextCursor::next_line() {
  const std::size_t line_break = text_.find('\n', position_);
  position_ = line_break == std::string_view::npos ? text_.size() : line_break + 1;
  ++line_;
}

double TextCursor::finite_number(std::string_view word, const char* what) const {
  if (word.empty()) fail(std::string("expected ") + what + ", found the end of the " + (at_end() ? "file" : "line"));
  const std::optional<double> value = parse_number(word);
  if (!value) fail(std::string("expected ") + what + ", found '" + std::string(word.substr(0, 40)) + "'");
  if (!std::isfinite(*value)) fail(std::string(what) + " is not finite: '" + std::string(word.substr(0, 40)) + "'");
  return *value;
}

double TextCursor::number(const char* what) { return finite_number(word(), what); }
double TextCursor::number_anywhere(const char* what) { return finite_number(word_anywhere(), what); }

void TextCursor::fail_at(int line, const std::string& problem) const {
  throw InputError(file_.string() + ":" + std::to_string(line) + ": " + problem);
}

}  // namespace cleave::scene
