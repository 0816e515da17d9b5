#pragma once

#include "plugins/registry.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace cleave::app {

struct AdviseOptions {
  std::filesystem::path scene;
  std::vector<std::string> sets;
  std::vector<std::filesystem::path> costs;  ///< of `cleave bench steps --json`, before those that come with the program
  bool json = false;
};

void add_advise_options(CLI::App&, AdviseOptions&);

/// `cleave advise`. Returns the exit status: 0, whatever there is to advise. Throws InputError.
int advise_command(const AdviseOptions&, plugins::Registry);

}  // namespace cleave::app
