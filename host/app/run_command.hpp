#pragma once

#include "plugins/registry.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::app {

struct RunOptions {
  std::filesystem::path scene;     ///< with `resume` also a run directory, whose scene is taken; empty: that of `out`
  std::filesystem::path out;       ///< empty: out/<scene name>
  int threads = 0;                 ///< 0: all
  std::optional<int> frames;       ///< stop after this many frames
  std::optional<long long> steps;  ///< stop after this many steps
  std::vector<std::string> sets;   ///< "path=value"
  bool quiet = false;
  int preview = 0;             ///< pictures of every so manieth frame while it runs; 0: none
  bool resume = false;         ///< go on from the newest checkpoint in `out`; from the beginning if there is none
  bool resume_anyway = false;  ///< also where the program, a plugin or the instruction set is another one
};

/// `cleave run`. Returns the exit status: 0 done, 3 the simulation failed (state written), 130 interrupted. Throws InputError.
int run_command(const RunOptions&, plugins::Registry&);

}  // namespace cleave::app
