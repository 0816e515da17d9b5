#pragma once

#include "checkpoint/run_directory.hpp"

#include <map>
#include <string>
#include <vector>

namespace cleave::checkpoint {

/// The CRC-32 of every file that a scene, with all defaults written out, names, by the key that names it. Files that belong to
/// a named one (the .ele of a .node) count with it. Throws InputError if one cannot be read.
std::map<std::string, std::uint32_t> files_of(const std::string& scene);

/// How `now` differs from the run that was saved.
struct Changes {
  /// Of what is simulated, as "material.jelly.density: 1000.0 -> 900.0". Such a state cannot be gone on from.
  std::vector<std::string> physics;
  /// Of what computes it: the bits would be others.
  std::vector<std::string> program;
  /// What may make the bits others.
  std::vector<std::string> notes;
};

/// Compares scenes and the files they name, but for simulation.end_time and [output].
std::vector<std::string> changed_physics(const Run& saved, const Run& now);
Changes changes(const Run& saved, const Run& now);

}  // namespace cleave::checkpoint
