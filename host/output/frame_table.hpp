#pragma once

#include "output/frame.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::output {

/// Names of the columns that every frames.csv has.
std::vector<std::string> frame_columns();

/// frames.csv: a header, then one row per frame, each on the disk as soon as it is appended. A row that does not fit is taken
/// back whole, so that the table always parses.
class FrameTable {
 public:
  /// Replaces an older table by an empty one, or by `earlier`, whose columns have to be those of this program.
  /// `pieces`: with a column of that name; `debris`: with that column and the other.
  explicit FrameTable(std::filesystem::path, const std::string& earlier = "", bool pieces = false, bool debris = false);
  ~FrameTable();
  FrameTable(const FrameTable&) = delete;
  FrameTable& operator=(const FrameTable&) = delete;
  void append(const FrameRecord&);

 private:
  std::filesystem::path path_;
  bool pieces_, debris_;
  int descriptor_ = -1;
};

}  // namespace cleave::output
