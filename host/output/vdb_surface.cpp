#include "output/vdb.hpp"
#include "output/vdb_file.hpp"

#include <openvdb/tools/FastSweeping.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/ValueTransformer.h>

#include <algorithm>
#include <cmath>

namespace cleave::output {
namespace {

// Lengths in particle spacings. Balls this large leave no holes between the particles of a cubic lattice (which needs 0.87);
// moving their union back by the margin puts the surface half a spacing beyond the outermost particles, where the material
// ends, and keeps the smoothing in between from eating single particles.
constexpr double ball_radius = 1.0;
constexpr double margin = 0.38;
constexpr double voxel_width = 0.5;

double spacing(float volume, int dimension) { return volume > 0 ? dimension == 2 ? std::sqrt(volume) : std::cbrt(volume) : 0; }

/// As OpenVDB wants to see them.
struct Balls {
  using PosType = openvdb::Vec3R;
  const ParticleFrame& frame;
  std::vector<std::uint32_t> particles;

  std::size_t size() const { return particles.size(); }
  void getPos(std::size_t n, openvdb::Vec3R& center) const {
    const Vector3 position = position_of(frame, particles[n]);
    center = {position.x(), position.y(), position.z()};
  }
  void getPosRad(std::size_t n, openvdb::Vec3R& center, openvdb::Real& radius) const {
    getPos(n, center);
    radius = ball_radius * spacing(frame.volumes[particles[n]], frame.dimension);
  }
};

double typical_spacing(const ParticleFrame& frame, std::size_t body) {
  std::vector<float> volumes;
  for (std::size_t i = frame.body_begin(body); i < frame.body_ends[body]; ++i)
    if (frame.volumes[i] > 0) volumes.push_back(frame.volumes[i]);
  if (volumes.empty()) return frame.cell_size / 2;
  const auto middle = volumes.begin() + static_cast<std::ptrdiff_t>(volumes.size() / 2);
  std::nth_element(volumes.begin(), middle, volumes.end());
  return spacing(*middle, frame.dimension);
}

openvdb::FloatGrid::Ptr surface(const ParticleFrame& frame, std::size_t body) {
  const double particle_spacing = typical_spacing(frame, body), voxel_size = voxel_width * particle_spacing;
  openvdb::FloatGrid::Ptr grid = openvdb::createLevelSet<openvdb::FloatGrid>(voxel_size);
  const Balls balls{frame, particles_on_grid(frame, body, voxel_size, *grid)};
  const openvdb::MetaMap description = *grid;
  if (balls.size() > 0) {
    openvdb::tools::ParticlesToLevelSet<openvdb::FloatGrid> union_of_balls(*grid);
    union_of_balls.setRmin(0);
    union_of_balls.rasterizeSpheres(balls);
    union_of_balls.finalize();
    // Inside, the union only knows the nearest ball; a level set needs the distance to the surface, in a narrow band.
    grid = openvdb::tools::sdfToSdf(*grid);
    const float band = grid->background();
    openvdb::tools::foreach (grid->beginValueOn(), [band](const openvdb::FloatGrid::ValueOnIter& value) {
      if (std::abs(*value) < band) return;
      value.setValue(std::copysign(band, *value));
      value.setValueOff();
    });
    openvdb::tools::pruneLevelSet(grid->tree());
    openvdb::tools::LevelSetFilter<openvdb::FloatGrid> filter(*grid);
    filter.mean(1);
    filter.offset(static_cast<float>(margin * particle_spacing));
  }
  if (const auto left_out = description["particles_left_out"]) grid->insertMeta("particles_left_out", *left_out);
  describe(*grid, frame, frame.bodies[body]);
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  return grid;
}

}  // namespace

void write_surface_vdb(const std::filesystem::path& path, const ParticleFrame& frame) {
  openvdb::initialize();
  openvdb::GridCPtrVec grids;
  for (std::size_t body = 0; body < frame.bodies.size(); ++body) grids.push_back(surface(frame, body));
  save_grids(path, grids);
}

}  // namespace cleave::output
