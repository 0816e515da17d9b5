#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cleave::point {

/// Comma-separated text with a header. Lines that start with '#' and empty lines are passed over. A cell may be quoted, but
/// not span lines. Cells keep their bytes, so that columns nobody reads can be handed on unchanged.
class CsvTable {
 public:
  struct Row {
    int line;                             ///< 1-based
    std::vector<std::string_view> cells;  ///< as many as the header has, as they stand in the file
  };

  /// "-" is the standard input. Throws InputError with the file and line of what is wrong.
  static CsvTable read(const std::filesystem::path&);
  /// Of `text`; `file` names it in messages.
  static CsvTable parse(std::string text, std::string file);

  CsvTable(CsvTable&&) = default;
  CsvTable& operator=(CsvTable&&) = default;

  const std::string& file() const { return file_; }
  const Row& header() const { return header_; }
  /// Names of the columns, without surrounding blanks and quotes.
  const std::vector<std::string>& names() const { return names_; }
  const std::vector<Row>& rows() const { return rows_; }
  /// Throws InputError if two columns have this name.
  std::optional<std::size_t> column(std::string_view name) const;

  /// The finite number in a cell. Throws InputError with file:line:column and the name of the column.
  double number(const Row&, std::size_t column) const;
  /// "file:line:column: error: what".
  std::string error_at(const Row&, std::size_t column, const std::string& what) const;

 private:
  CsvTable() = default;
  Row split(std::string_view line, int number) const;

  std::string file_;
  std::vector<char> text_;  ///< unlike a string's, its bytes stay where they are when it moves
  Row header_{};
  std::vector<std::string> names_;
  std::vector<Row> rows_;
};

}  // namespace cleave::point
