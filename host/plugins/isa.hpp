#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::plugins {

/// Names of the subdirectories that may hold a faster build of a plugin library for this processor, best first:
/// {"x86-64-v4", "x86-64-v3"}. CLEAVE_ISA=x86-64-v2|x86-64-v3|x86-64-v4 forces one level (v2: the library itself). Throws
/// InputError if CLEAVE_ISA names a level that does not exist or that this processor lacks.
std::vector<std::string> preferred_isa_directories();

/// The build of this library for the level that CLEAVE_ISA names; the library itself if none is named or there is no such
/// build. Throws InputError as above.
std::filesystem::path forced_variant(const std::filesystem::path& library);

/// What the option --isa does: CLEAVE_ISA is this level from here on. Throws InputError as above. [main-thread], before plugins
/// and kernels are loaded.
void force_isa(const std::string& level);

}  // namespace cleave::plugins
