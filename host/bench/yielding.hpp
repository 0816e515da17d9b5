#pragma once

#include "mpm/simulation.hpp"
#include "plugins/registry.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace cleave::bench {

/// Writes a particle file: a square block, two particles per cell edge, that shears at the rate dv_x/dy, 1/s.
struct ShearingBlock {
  int dimension = 3;
  std::int64_t particles = 0;
  double cell_size = 0, rate = 0;
  Vector3 center = Vector3::Zero(), velocity = Vector3::Zero();

  void write(const std::filesystem::path&) const;
};

/// The fraction of the particles that a return mapping moved in the step between two states, as the law itself says: asked
/// again, in the precision of the particles, with the elastic trial strain, which follows from the strain before and the
/// velocity gradient after the step. Looks at some ten thousand particles, evenly chosen; the state variables of the law begin
/// at `first_state`. Empty for a law that reads fibres.
std::optional<double> yielding_fraction(const plugins::Instance&, std::size_t first_state, bool single,
                                        const std::vector<mpm::ParticleState>& before,
                                        const std::vector<mpm::ParticleState>& after, double time_step);

}  // namespace cleave::bench
