#pragma once

#include "output/frame.hpp"

#include <filesystem>

namespace cleave::output {

/// Binary little-endian PLY, one vertex per particle: x y z vx vy vz id body pscale and one float property per component of
/// each attribute (name, name_x, name_xy, ...). Body names, time and cell size stand in comments.
void write_ply(const std::filesystem::path&, const ParticleFrame&);

}  // namespace cleave::output
