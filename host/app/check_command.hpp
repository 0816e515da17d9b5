#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace cleave::app {

struct CheckOptions {
  std::vector<std::string> plugins;  ///< library files, or IDs of plugins the program finds
  bool all = false;                  ///< every plugin the program finds
  bool list = false;
  bool json = false;
  std::vector<std::string> only;
  std::vector<std::string> sets;
  std::filesystem::path junit;
  std::uint64_t seed = 1;
  std::optional<std::uint64_t> reproduce;
  double time_limit = 60;
};

void add_check_options(CLI::App&, CheckOptions&);

/// `cleave check`: runs the conformance checks. Returns the exit status: 0, or 1 if a check failed. Throws InputError.
int check_command(const CheckOptions&);

}  // namespace cleave::app
