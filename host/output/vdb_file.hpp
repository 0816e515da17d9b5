#pragma once

// The precompiled header of the sources that use OpenVDB; nothing else includes it.

#include "common/error.hpp"
#include "output/atomic_file.hpp"
#include "output/names.hpp"

#include <openvdb/openvdb.h>
#include <openvdb/points/PointAttribute.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/tools/FastSweeping.h>
#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/ParticlesToLevelSet.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace cleave::output {

/// OpenVDB's own file class opens files by name and does not look whether writing them succeeded.
class VdbArchive : public openvdb::io::Archive {
 public:
  VdbArchive() {
    namespace io = openvdb::io;
    setCompression((hasBloscCompression() ? io::COMPRESS_BLOSC : io::COMPRESS_ZIP) | io::COMPRESS_ACTIVE_MASK);
  }
  void save(std::ostream& out, const openvdb::GridCPtrVec& grids) const { Archive::write(out, grids, /*seekable=*/true); }
};

inline void save_grids(const std::filesystem::path& path, const openvdb::GridCPtrVec& grids) {
  AtomicFile file(path);
  VdbArchive().save(file.stream(), grids);
  file.commit();
}

/// What every grid says about itself.
inline void describe(openvdb::GridBase& grid, const ParticleFrame& frame, const std::string& body) {
  grid.setName(body);
  grid.setCreator("Cleave " CLEAVE_VERSION);
  grid.insertMeta("time", openvdb::DoubleMetadata(frame.time));
  grid.insertMeta("frame", openvdb::Int32Metadata(frame.index));
  grid.insertMeta("cell_size", openvdb::DoubleMetadata(frame.cell_size));
  grid.insertMeta("dimension", openvdb::Int32Metadata(frame.dimension));
  grid.insertMeta("scene_units", openvdb::StringMetadata("m, kg, s"));
}

/// Particles of a body that have a place on a grid of this voxel size. Positions that are not finite, or so far away that
/// voxels cannot be counted in 32 bits, would corrupt it; such particles only occur in a simulation that has failed, and the
/// grid tells their number as "particles_left_out".
inline std::vector<std::uint32_t> particles_on_grid(const ParticleFrame& frame, std::size_t body, double voxel_size,
                                                    openvdb::GridBase& grid) {
  constexpr double farthest = 1 << 30;
  std::vector<std::uint32_t> particles;
  particles.reserve(frame.body_ends[body] - frame.body_begin(body));
  std::int64_t left_out = 0;
  for (std::size_t i = frame.body_begin(body); i < frame.body_ends[body]; ++i)
    if ((position_of(frame, i).array().abs() <= farthest * voxel_size).all())
      particles.push_back(static_cast<std::uint32_t>(i));
    else
      ++left_out;
  if (left_out > 0) grid.insertMeta("particles_left_out", openvdb::Int64Metadata(left_out));
  return particles;
}

}  // namespace cleave::output
