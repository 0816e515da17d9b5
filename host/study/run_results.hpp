#pragma once

#include "study/study.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::study {

/// Names that expressions over frames may use: the columns of frames.csv that hold numbers, also those that only some scenes
/// have, and t for the time.
const std::vector<std::string>& frame_columns();

/// frames.csv of a run. What is not finite stays so.
struct FrameTable {
  std::vector<std::vector<double>> rows;  ///< in the order of frame_columns()
  std::vector<std::string> absent;        ///< those that this run has not written

  /// Throws InputError where a formula needs a column that is absent.
  void require(const Formula&) const;
  std::vector<double> column(const std::string& name) const;
};
FrameTable read_frames(const std::filesystem::path&);

/// Particles of one frame, by id.
struct Particles {
  std::vector<std::string> names;           ///< x y z vx vy vz, then the fields that frames hold
  std::vector<std::vector<double>> values;  ///< of each name, for every particle
  std::size_t count() const { return values.empty() ? 0 : values[0].size(); }
};
/// A .vtp file as `cleave run` writes it. Throws InputError if it is something else.
Particles read_vtp(const std::filesystem::path&);

/// Fields of the last frame of a run, and X Y Z: where each particle was at the start.
Particles read_last_particles(const std::filesystem::path& run);

/// A CSV file of numbers.
struct Table {
  std::vector<std::string> names;
  std::vector<std::vector<double>> rows;
  /// Throws InputError naming the nearest column.
  std::size_t column(const std::string& name, const std::filesystem::path&) const;
};
Table read_table(const std::filesystem::path&);

}  // namespace cleave::study
