#pragma once

#include "config/scene.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace cleave::bench {

/// How steps are sampled, of whatever scene.
struct StepSampling {
  std::vector<int> threads;
  std::vector<config::Precision> precisions;
  int steps = 40;   ///< of a sample
  int repeats = 5;  ///< samples of which the median is taken
};

/// What blocks are measured: every material in every size.
struct BlockOptions {
  /// IDs of laws, or several joined by +: without an elastic one among them, the first that offers what they need. Empty: every
  /// elastic law alone, and every return mapping and damage law on such a partner; constraints are measured where they are
  /// named.
  std::vector<std::string> materials;
  std::vector<std::int64_t> particles;  ///< empty: a million, 40,960 of a constraint
  int dimension = 3;
  std::map<std::string, plugins::GivenParameters> parameters;  ///< by ID; what is not given is chosen from the schema
};

struct StepResult {
  std::string material;  ///< or the scene
  std::vector<std::pair<std::string, plugins::GivenParameters>> laws;
  config::Precision precision = config::Precision::single_precision;
  std::int64_t particles = 0;
  int threads = 1;
  int turn = 0;  ///< results of the same turn were sampled alternately
  /// Nanoseconds of wall time per particle and step: of the median sample and its stages, and of the fastest sample.
  double median = 0, fastest = 0;
  std::vector<std::pair<std::string, double>> stages;
  std::vector<std::pair<std::string, double>> bytes_per_particle;  ///< "total" last
  std::optional<double> yielding;                                  ///< fraction of the particles, in the step after the samples
  std::optional<double> constraint_iterations, constraint_residual;  ///< per step, mean; and largest
  std::optional<double> newton_iterations, linear_iterations;        ///< of implicit steps, mean

  double seconds_per_step() const { return 1e-9 * median * double(particles); }
  double particle_steps_per_second() const { return 1e9 / median; }
};

struct StepResults {
  std::string isa;  ///< of the kernels
  int dimension = 3;
  StepSampling sampling;
  std::vector<StepResult> results;
  std::vector<std::pair<std::string, std::string>> skipped;  ///< what could not be measured, and why
  std::optional<std::int64_t> peak_memory;                   ///< bytes, of the process; where one simulation was run
};

/// Whole steps of blocks of elastic material in gentle motion: free, spinning and flying a twentieth of a cell per step, so
/// that they vibrate and are sorted, stressed to about a thousandth of their stiffness. 8 particles per cell (2D: 4), cells of
/// 1/128 m. Return mappings once more with three tenths of the particles in a second block that flows plastically: it shears
/// by 0.003 in a step. Constraints in a block of 5:4:4 that hangs by its ends along x, cells of 1 cm, laws of 10 kPa, steps of
/// 0.2 ms. As many blocks as a third of the machine's memory holds are sampled alternately, so that what else the machine
/// does falls on all of them alike and ratios hold. Throws InputError for what does not exist or a named material that
/// cannot be made.
StepResults measure_steps(const BlockOptions&, const StepSampling&, plugins::Registry&);

/// The same of a scene as it is, from its start on; only the precision is the one of `StepSampling`. Throws InputError and
/// SimulationError.
StepResults measure_steps(const config::Scene&, const StepSampling&, plugins::Registry&);

}  // namespace cleave::bench
