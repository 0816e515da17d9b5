#pragma once

#include "plugins/trust.hpp"

#include <CLI/CLI.hpp>

#include <string>
#include <vector>

namespace cleave::app {

/// What the user says of the plugins that commands load. Takes effect before any command runs.
inline void add_trust_options(CLI::App& command) {
  command
      .add_option_function<std::vector<std::string>>(
          "--allow-plugins-from",
          [](const std::vector<std::string>& directories) {
            for (auto directory = directories.rbegin(); directory != directories.rend(); ++directory)
              plugins::allow_plugins_from(*directory);
          },
          "Look for plugins in this directory, too, before all others (repeatable)")
      ->allow_extra_args(false);
  command.add_flag_callback("--isolate", plugins::isolate_plugins,
                            "Open every plugin in a child process first, and refuse it if it crashes or hangs there");
}

}  // namespace cleave::app
