#pragma once

#include "plugins/registry.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::app {

/// `cleave validate`. Checks all that running the scene would check before the first step, and sums the scene up.
/// Warnings and errors go to stderr. Returns the exit status: 0 if the scene can be run, 2 if not.
int validate_command(const std::filesystem::path& scene, const std::vector<std::string>& sets, plugins::Registry);

}  // namespace cleave::app
