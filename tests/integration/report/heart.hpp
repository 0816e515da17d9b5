#pragma once

#include "program.hpp"

/// A heart that is pulled in two, some thousand particles in a second.
namespace cleave::test {

inline std::string heart(const std::string& more = "") {
  return "run '" CLEAVE_SOURCE_DIR
         "/configs/scenes/broken_heart.toml' --quiet --threads 2 --set simulation.cell_size=6e-4 --set "
         "'output.formats=[\"ply\"]' " +
         more;
}

}  // namespace cleave::test
