#pragma once

#include "plugins/schema.hpp"

#include <filesystem>
#include <optional>

namespace cleave::plugins {

/// "name.cleave.toml" beside "name.so".
std::filesystem::path manifest_path(const std::filesystem::path& library);

/// What the manifest beside a library says, if there is one that belongs to this file: it is well-formed and records the
/// library's size. Anything else is no manifest, and the library has to be asked itself. Throws Refusal if the manifest is
/// fresh and describes a plugin this host cannot use (say, of another ABI).
std::optional<Description> read_manifest(const std::filesystem::path& library);

}  // namespace cleave::plugins
