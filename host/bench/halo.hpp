#pragma once

#include "config/scene.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace cleave::bench {

struct HaloOptions {
  std::vector<int> parts = {2, 4, 8, 16, 32, 64};
  int samples = 8;  ///< instants, evenly over the run
  int steps = 20;   ///< between a division and the look at what has left its part
};

/// What a division into this many parts would exchange.
struct HaloResult {
  int parts = 0;
  double particles = 0;        ///< of a part
  double nodes = 0;            ///< of the grid that its particles reach, mean
  double halo = 0;             ///< of these, those that other parts reach too: mean of the parts
  double largest_halo = 0;     ///< and of the part that has most
  double neighbours = 0;       ///< parts that it shares nodes with, most
  double halo_bytes = 0;       ///< that this part sends in a step
  double migrating = 0;        ///< part of all particles that changes its part in a step
  double migration_bytes = 0;  ///< that the particles of an average part which leave it in a step are
  double imbalance = 0;        ///< largest part over the mean, after `steps` steps
};

struct HaloResults {
  std::int64_t particles = 0, steps = 0;
  double bytes_per_particle = 0;
  std::vector<HaloResult> results;  ///< means over the samples; largest ones of halo, neighbours and imbalance
};

/// Runs a scene of the material point method and measures, at some instants, what its parts would have to exchange if the
/// blocks of its grid (4x4x4 nodes, 8x8 in 2D) were dealt out along the Morton curve, with as many particles to each part. A
/// node is shared where particles of several parts reach it with quadratic B-splines; each part that shares it sends mass,
/// momentum and stress impulses, one number and a vector, in the precision of the scene, and is sent as much. Throws
/// InputError.
HaloResults measure_halo(const config::Scene&, const HaloOptions&, plugins::Registry&);

std::string halo_text(const HaloResults&);
std::string halo_markdown(const HaloResults&);

}  // namespace cleave::bench
