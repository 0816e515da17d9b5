#pragma once

#include "config/table_reader.hpp"

namespace cleave::config {

/// Puts a value from the command line into the file's tables. Tables on the way that are not there are made; whether the key
/// belongs there is decided by reading the scene. Reports a path that leads nowhere.
void apply_override(toml::table& root, const Override&, Diagnostics&);

}  // namespace cleave::config
