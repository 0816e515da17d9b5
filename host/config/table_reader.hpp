#pragma once

#include "config/catalog.hpp"
#include "config/diagnostics.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <toml++/toml.h>

namespace cleave::config {

/// What every part of the reader shares.
struct ReadContext {
  Diagnostics& diagnostics;
  const PluginCatalog& catalog;
  std::string file;                 ///< as the user named it
  std::filesystem::path directory;  ///< of the scene file, absolute
  int dimension = 3;
  double cell_size = 0;  ///< m, 0: the scene gives none
};

/// Values from the command line are located by their option: "--set simulation.cell_size".
inline constexpr std::string_view option_prefix = "--";
inline constexpr std::string_view override_prefix = "--set ";

/// Where a node stands in the file, or the option that gave it.
Location locate(const toml::source_region&);
/// "the text "stiff"", "3.5", "a list of 2", "a table".
std::string found(const toml::node&);
/// "1, 2, 3", with quotes around each if asked.
std::string list_text(const std::vector<std::string>& words, const char* quote = "");
/// ", did you mean 'x'?", or the text `otherwise` if nothing is near.
std::string suggestion(std::string_view word, const std::vector<std::string>& candidates, const std::string& otherwise);

/// Values a number may take.
struct Range {
  double minimum = -std::numeric_limits<double>::infinity(), maximum = std::numeric_limits<double>::infinity();
  bool minimum_open = false, maximum_open = false;

  static Range positive() { return {.minimum = 0, .minimum_open = true}; }
  static Range not_negative() { return {.minimum = 0}; }
  static Range between(double minimum, double maximum) { return {.minimum = minimum, .maximum = maximum}; }
  bool holds(double) const;
  std::string text(const std::string& unit) const;
};

/// How a list of coordinates is read. A scene of dimension 2 may leave the last one out.
struct VectorForm {
  std::string unit;
  Range range = {};
  double missing_z = 0;
  bool planar = false;  ///< in 2D a z that is given must be 0
};

/// One table of the file, read key by key. Every key asked for is a known one; finish() reports the others. A value that is
/// missing or cannot be used gives an empty optional (or the default), and the reason goes to the diagnostics.
class TableReader {
 public:
  /// `what` names the table in messages: "material 'clay'".
  TableReader(const toml::table&, std::string what, ReadContext&);

  ReadContext& context() const { return *context_; }
  const std::string& what() const { return what_; }
  void rename(std::string what) { what_ = std::move(what); }
  Location where() const { return where_; }
  Location where(std::string_view key) const;      ///< of the value, or of the table if the key is absent
  Location where_key(std::string_view key) const;  ///< of the key itself, or of the table
  void error(const Location& where, const std::string& what) const { context_->diagnostics.error(where, what); }
  void error_at(std::string_view key, const std::string& what) const { error(where(key), what); }

  const toml::node* find(std::string_view key);
  bool has(std::string_view key) { return find(key) != nullptr; }
  /// Reports a missing key; `expected` says what belongs there: "a number (kg/m^3)".
  bool require(std::string_view key, const std::string& expected);
  /// Reports a key that makes no sense here.
  void refuse(std::string_view key, const std::string& reason);

  std::optional<double> number(std::string_view key, const std::string& unit, Range = {});
  std::optional<std::int64_t> integer(std::string_view key, std::int64_t minimum, std::int64_t maximum);
  std::optional<bool> boolean(std::string_view key);
  std::optional<std::string> text(std::string_view key);
  /// Index of the chosen word.
  std::optional<std::size_t> choice(std::string_view key, const std::vector<std::string>& words);
  std::optional<Vector3> vector(std::string_view key, const VectorForm&);
  std::optional<Vector3> direction(std::string_view key, const VectorForm& = {});  ///< normalised, never zero
  std::optional<std::vector<double>> numbers(std::string_view key, const std::string& unit, std::size_t minimum_count,
                                             std::size_t maximum_count, Range = {});
  /// An existing file of one of the types, as an absolute path.
  std::optional<std::filesystem::path> file(std::string_view key, const std::vector<std::string>& extensions);
  std::optional<TableReader> table(std::string_view key, const std::string& what);
  /// Readers of an array of tables; `what` names one of them.
  std::vector<TableReader> tables(std::string_view key, const std::string& what);

  double required_number(std::string_view key, const std::string& unit, Range = {});

  /// Reports the keys nobody asked for.
  void finish() const;

 private:
  std::optional<double> number_of(const toml::node&, std::string_view key, const std::string& unit, const Range&) const;
  void wrong_type(const toml::node&, std::string_view key, const std::string& expected) const;

  const toml::table* table_;
  std::string what_;
  ReadContext* context_;
  Location where_;
  std::set<std::string, std::less<>> known_;
};

}  // namespace cleave::config
