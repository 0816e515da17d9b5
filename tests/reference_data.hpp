#pragma once

#include <cstdlib>
#include <filesystem>

namespace cleave {

/// Where published reference values and meshes are, if they are on this machine: CLEAVE_DATA_DIR, else beside the sources.
/// Tests that need them skip, saying so, where they are not.
inline std::filesystem::path reference_data() {
  const char* given = std::getenv("CLEAVE_DATA_DIR");
  return given ? std::filesystem::path(given) : std::filesystem::path(CLEAVE_SOURCE_DIR) / "../shared/data";
}

}  // namespace cleave
