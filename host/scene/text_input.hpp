#pragma once

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace cleave::scene {

/// Throws InputError naming the file if it does not exist or is a directory.
void require_file(const std::filesystem::path& file);

/// The whole file. Throws InputError naming it if it is missing or unreadable.
std::string read_bytes(const std::filesystem::path& file);

/// A number that takes up all of `word`, in any notation C accepts; infinities and NaN are parsed, overflow gives infinity.
inline std::optional<double> parse_number(std::string_view word) {
  if (word.size() > 1 && word.front() == '+' && word[1] != '-') word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (end != word.data() + word.size() || error == std::errc::invalid_argument) return std::nullopt;
  if (error == std::errc::result_out_of_range) return std::strtod(std::string(word).c_str(), nullptr);
  return value;
}

/// Reads words from a text, knowing the line it is on. Blanks, carriage returns and continued lines ("\" at the end) are
/// skipped.
class TextCursor {
 public:
  TextCursor(const std::filesystem::path& file, std::string_view text) : file_(file), text_(text) {}

  bool at_end() const { return position_ >= text_.size(); }
  int line() const { return line_; }
  std::size_t position() const { return position_; }

  /// The next word of this line; empty at its end.
  std::string_view word();
  /// The next word of the text, on whatever line; empty at its end.
  std::string_view word_anywhere();
  void next_line();

  double number(const char* what);           ///< the next word of this line, finite
  double number_anywhere(const char* what);  ///< the next word of the text, finite

  [[noreturn]] void fail(const std::string& problem) const { fail_at(line_, problem); }
  [[noreturn]] void fail_at(int line, const std::string& problem) const;

 private:
  void skip_blanks();
  double finite_number(std::string_view word, const char* what) const;

  const std::filesystem::path& file_;
  std::string_view text_;
  std::size_t position_ = 0;
  int line_ = 1;
};

}  // namespace cleave::scene
