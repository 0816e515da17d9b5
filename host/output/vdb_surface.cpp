#include "output/particle_level_set.hpp"
#include "output/particle_surface.hpp"
#include "output/vdb.hpp"
#include "output/vdb_file.hpp"

#include <algorithm>

namespace cleave::output {
namespace {

/// A quantity of the particles in the voxels of the level set's band.
openvdb::FloatGrid::Ptr in_band(const ParticleFrame& frame, std::size_t body, const openvdb::FloatGrid& surface,
                                const std::vector<float>& values) {
  const auto grid = openvdb::FloatGrid::create(0);
  grid->setTransform(surface.transform().copy());
  grid->setTree(std::make_shared<openvdb::FloatTree>(surface.tree(), 0.f, openvdb::TopologyCopy()));
  std::vector<Eigen::Vector3f> places;
  for (auto voxel = grid->cbeginValueOn(); voxel; ++voxel) {
    const openvdb::Vec3d place = grid->indexToWorld(voxel.getCoord());
    places.emplace_back(float(place[0]), float(place[1]), float(place[2]));
  }
  const std::vector<float> at = interpolate(frame, body, values, 1, places);
  std::size_t n = 0;
  for (auto voxel = grid->beginValueOn(); voxel; ++voxel) voxel.setValue(at[n++]);
  return grid;
}

}  // namespace

void write_surface_vdb(const std::filesystem::path& path, const ParticleFrame& frame) {
  openvdb::initialize();
  const auto damage =
      std::find_if(frame.attributes.begin(), frame.attributes.end(), [](const Attribute& a) { return a.name == "damage"; });
  openvdb::GridCPtrVec grids, fields;
  for (std::size_t body = 0; body < frame.bodies.size(); ++body) {
    const openvdb::FloatGrid::Ptr surface = particle_level_set(frame, body, 1);
    describe(*surface, frame, frame.bodies[body]);
    grids.push_back(surface);
    if (damage == frame.attributes.end()) continue;
    const openvdb::FloatGrid::Ptr field = in_band(frame, body, *surface, damage->values);
    describe(*field, frame, frame.bodies[body] + " damage");
    fields.push_back(field);
  }
  grids.insert(grids.end(), fields.begin(), fields.end());
  save_grids(path, grids);
}

}  // namespace cleave::output
