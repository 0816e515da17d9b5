#pragma once

#include "output/frame.hpp"

#include <openvdb/Types.h>
#include <openvdb/openvdb.h>

namespace cleave::output {

/// Signed distance to the surface of a body's particles, the union of their ellipsoids, in a band of three voxels on either
/// side. Voxels are half a particle spacing wide, times `coarseness`. The same bits on any number of threads.
openvdb::FloatGrid::Ptr particle_level_set(const ParticleFrame&, std::size_t body, double coarseness);

}  // namespace cleave::output
