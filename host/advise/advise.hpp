#pragma once

#include "advise/costs.hpp"
#include "config/scene.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace cleave::advise {

/// Something that a scene would be better for.
struct Advice {
  std::string what;                 ///< "take automatic steps"
  std::string reason;               ///< with the numbers it is drawn from
  std::string effect;               ///< what changes: cost, memory, accuracy
  std::optional<double> speedup;    ///< predicted; below 1 where accuracy costs
  std::vector<std::string> set;     ///< path=value, as --set takes it
  std::vector<std::string> remove;  ///< what has to leave the scene file, as paths
};

/// What running the scene as it is takes, from the state at its start.
struct Forecast {
  std::int64_t particles = 0, frames = 0;
  double time_step = 0;  ///< s
  std::string bound;     ///< what limits it
  double steps = 0;
  double memory = 0;                     ///< bytes
  std::optional<double> thread_seconds;  ///< of one thread of the machine that costs were recorded on; empty: not recorded
};

struct Advised {
  std::optional<Forecast> forecast;  ///< empty where the scene does not fit the machine
  std::vector<Advice> advice;
};

struct Machine {
  double memory = 0;  ///< bytes
};
Machine this_machine();

/// What to change in a scene, from bounds and recorded costs, without running it. Each edit leaves a scene that can be read.
/// Throws InputError as running it would.
Advised advise(const config::Scene&, const std::vector<config::Override>& given, plugins::Registry&, const Costs&,
               const Machine&);

}  // namespace cleave::advise
