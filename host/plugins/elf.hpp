#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace cleave::plugins {

/// Why a file is not a whole shared library for this processor, found without running or mapping it: the dynamic loader maps
/// a file by its headers, and touching pages that a truncated file does not have kills the process. Empty if it looks sound.
std::optional<std::string> problem_with_library_file(const std::filesystem::path&);

}  // namespace cleave::plugins
