#pragma once

#include "output/frame.hpp"

#include <filesystem>

namespace cleave::output {

/// One point data grid per body, named after it, with two cells per voxel edge. Positions are 32-bit offsets within a voxel and
/// so more exact than 32-bit coordinates. Point attributes: id (int64), v (vec3s, m/s), pscale (radius, m) and every attribute
/// of the frame: 1 component as float, 3 as vec3s, any other number as a float array of that stride.
void write_points_vdb(const std::filesystem::path&, const ParticleFrame&);

/// One level set per body, named after it: a closed smooth surface around the particles, in voxels half as wide as the
/// particles' spacing.
void write_surface_vdb(const std::filesystem::path&, const ParticleFrame&);

}  // namespace cleave::output
