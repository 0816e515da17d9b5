#pragma once

#include "point/laws.hpp"

#include <filesystem>
#include <optional>
#include <string>

namespace CLI {
class App;
}

namespace cleave::app {

struct PointOptions {
  point::LawChoice laws;
  // What to do, one of:
  std::optional<std::filesystem::path> input;   ///< CSV of material points
  std::optional<std::string> path;              ///< name of a load path
  bool json = false;                            ///< points as JSON from the standard input
  std::optional<std::filesystem::path> replay;  ///< the batch that a law failed on in a run; brings its own laws

  std::optional<double> amplitude;  ///< engineering strain (shear: gamma) at its end
  std::optional<int> steps;
  std::optional<double> confinement;   ///< Pa, of a triaxial path
  std::filesystem::path output = "-";  ///< "-": standard output
};

/// Declares the options of `cleave point`.
void add_point_options(CLI::App&, PointOptions&);

/// `cleave point`. Returns the exit status: 0 done (points without a usable result are marked as such and counted on the
/// standard error), 3 a load path ended early or a replayed law fails again. Throws InputError, or SimulationError if a plugin
/// gives up.
int point_command(const PointOptions&, plugins::Registry&);

}  // namespace cleave::app
