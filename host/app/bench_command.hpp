#pragma once

#include "plugins/registry.hpp"

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace cleave::app {

struct BenchOptions {
  std::size_t points = 256;
  int repeats = 25;
  std::vector<std::string> plugins;
  std::string elasticity;
  std::vector<std::string> sets;  ///< "elasticity/qr.fiber_scale=10"
  std::optional<std::filesystem::path> json, chart;
};

/// Declares the options of `cleave bench kernels`.
void add_bench_options(CLI::App&, BenchOptions&);

/// `cleave bench kernels`. Returns the exit status, 0. Throws InputError.
int bench_command(const BenchOptions&, plugins::Registry&);

}  // namespace cleave::app
