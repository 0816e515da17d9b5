#pragma once

#include "plugins/registry.hpp"

#include <string>

namespace cleave::app {

struct PluginsOptions {
  bool json = false;
  bool markdown = false;  ///< a reference page
  bool explain = false;   ///< also the search path, every file found and why files were refused
  std::string id;         ///< describe this plugin; empty: list all
};

/// `cleave plugins`. Returns the exit status: 0, or 2 if the plugin asked for cannot be used.
int plugins_command(const PluginsOptions&);

/// What the command prints to stdout for a registry. Throws InputError for an unknown id.
std::string describe_plugins(const plugins::Registry&, const PluginsOptions&);

}  // namespace cleave::app
