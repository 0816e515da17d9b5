#pragma once

#include "plugins/registry.hpp"

#include <cstddef>
#include <cstdint>
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

struct BenchStepsOptions {
  std::filesystem::path scene;          ///< empty: blocks
  std::vector<std::int64_t> particles;  ///< empty: a million
  std::vector<std::string> materials;   ///< empty: all
  std::optional<int> dimension;         ///< empty: 3
  std::vector<int> threads;             ///< empty: one and all
  std::vector<std::string> precisions;  ///< empty: single, or the scene's
  int steps = 40, repeats = 5;
  std::vector<std::string> sets;  ///< of parameters; with a scene "path=value"
  bool markdown = false;
  std::optional<std::filesystem::path> json, chart;
};

struct BenchHaloOptions {
  std::filesystem::path scene;
  std::vector<int> parts;  ///< empty: 2 to 64
  int samples = 8, steps = 20;
  std::vector<std::string> sets;
  bool markdown = false;
};

/// Declares the options of `cleave bench kernels`, `cleave bench steps` and `cleave bench halo`.
void add_bench_options(CLI::App&, BenchOptions&);
void add_bench_steps_options(CLI::App&, BenchStepsOptions&);
void add_bench_halo_options(CLI::App&, BenchHaloOptions&);

/// `cleave bench kernels`. Returns the exit status, 0. Throws InputError.
int bench_command(const BenchOptions&, plugins::Registry&);

/// `cleave bench steps`. Returns the exit status, 0. Throws InputError and SimulationError.
int bench_steps_command(const BenchStepsOptions&, plugins::Registry&);

/// `cleave bench halo`. Returns the exit status, 0. Throws InputError and SimulationError.
int bench_halo_command(const BenchHaloOptions&, plugins::Registry&);

}  // namespace cleave::app
