#pragma once

#include "plugins/registry.hpp"

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cleave::bench {

struct KernelOptions {
  std::size_t points = 256;          ///< per call
  int repeats = 25;                  ///< samples of which the median is taken
  std::vector<std::string> plugins;  ///< IDs to measure, in this order; empty: all elasticity, plasticity, damage laws
  std::string elasticity;            ///< ID of the law that the others are paired with; empty: chosen from the registry
  std::map<std::string, plugins::GivenParameters> parameters;  ///< by ID; what is not given is chosen from the schema
};

/// Nanoseconds per point.
struct Timing {
  double median = 0, fastest = 0;
};

struct Kernel {
  std::string id, condition;  ///< "30 % yielding"
  std::string elasticity;     ///< the law it is paired with; empty for elastic laws
  std::string isa;            ///< instruction set of the library that was loaded
  plugins::GivenParameters parameters;
  std::optional<double> yielding;         ///< fraction of the points, of return mappings
  std::optional<Timing> single, doubled;  ///< of the precisions the law offers
};

struct Skipped {
  std::string id, reason;
};

struct KernelResults {
  std::vector<Kernel> kernels;
  std::vector<Skipped> skipped;  ///< laws, or cases of laws, that could not be measured
};

/// Measures the laws of the registry through their batch entry points, on one thread: stress of elastic laws at strains of a
/// tenth, P and dP where they give them, with and without fibres where those are optional; return mappings where none, 30 % and
/// all of the points yield; driving force (or local damage) near rest and loaded. Samples of all kernels alternate, so that
/// what else the machine does falls on all of them alike and ratios hold. Throws InputError for an ID or parameter that does
/// not exist.
KernelResults measure_kernels(const KernelOptions&, plugins::Registry&);

}  // namespace cleave::bench
