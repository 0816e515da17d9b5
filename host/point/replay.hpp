#pragma once

#include "plugins/registry.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::point {

/// What a law makes of the points it failed on in a run.
struct Replay {
  std::string table;                  ///< CSV: a line per point with what goes in, what comes out, and the status
  std::vector<std::string> warnings;  ///< versions that differ
  std::string summary;                ///< what was called, whether it fails, and whether it does what it did in the run
  bool fails = false;
};

/// Calls the law of a failed batch again: with the parameters, in the precision and through the entry point of the run.
/// Throws InputError.
Replay replay(const std::filesystem::path& file, plugins::Registry&);

}  // namespace cleave::point
