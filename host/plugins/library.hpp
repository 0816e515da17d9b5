#pragma once

#include "plugins/description.hpp"
#include "plugins/registry.hpp"

#include <filesystem>
#include <memory>

namespace cleave::plugins {

/// Opens a library, agrees on the ABI before anything else, and checks its tables. Throws Refusal; a refused library is
/// unloaded again.
std::shared_ptr<const Plugin> open_library(const std::filesystem::path&);

}  // namespace cleave::plugins
