#include "output/vdb.hpp"
#include "output/vdb_file.hpp"

namespace cleave::output {
namespace {

namespace points = openvdb::points;
using points::PointDataGrid;

/// The points of one grid and the order in which it keeps them.
struct Points {
  PointDataGrid& grid;
  const openvdb::tools::PointIndexGrid& order;

  /// `values` holds `stride` values per point.
  template <class Value>
  void add(const std::string& name, const std::vector<Value>& values, openvdb::Index stride = 1) {
    points::appendAttribute(grid.tree(), name, points::TypedAttributeArray<Value>::attributeType(), stride);
    points::populateAttribute(grid.tree(), order.tree(), name, points::PointAttributeVector<Value>(values, stride), stride);
  }
};

void add_attribute(Points& target, const std::string& name, const Attribute& attribute,
                   const std::vector<std::size_t>& particles) {
  const auto width = static_cast<std::size_t>(attribute.components);
  if (!attribute.unit.empty()) target.grid.insertMeta("unit_" + name, openvdb::StringMetadata(attribute.unit));
  if (width == 3) {
    std::vector<openvdb::Vec3f> values;
    values.reserve(particles.size());
    for (const std::size_t i : particles) values.emplace_back(&attribute.values[3 * i]);
    target.add(name, values);
    return;
  }
  std::vector<float> values;
  values.reserve(particles.size() * width);
  for (const std::size_t i : particles)
    for (std::size_t c = 0; c < width; ++c) values.push_back(attribute.values[i * width + c]);
  target.add(name, values, static_cast<openvdb::Index>(width));
}

PointDataGrid::Ptr point_grid(const ParticleFrame& frame, std::size_t body, const std::vector<std::string>& names) {
  const double voxel_size = 2 * frame.cell_size;
  const auto transform = openvdb::math::Transform::createLinearTransform(voxel_size);
  const PointDataGrid::Ptr description = PointDataGrid::create();
  const std::vector<std::size_t> particles = particles_on_grid(frame, body, voxel_size, *description);

  std::vector<openvdb::Vec3d> positions;
  positions.reserve(particles.size());
  for (const std::size_t i : particles) {
    const Vector3 position = position_of(frame, i);
    positions.emplace_back(position.x(), position.y(), position.z());
  }
  const points::PointAttributeVector<openvdb::Vec3d> list(positions);
  const auto order = openvdb::tools::createPointIndexGrid<openvdb::tools::PointIndexGrid>(list, *transform);
  const auto grid = points::createPointDataGrid<points::NullCodec, PointDataGrid>(*order, list, *transform);
  grid->insertMeta(*description);
  describe(*grid, frame, frame.bodies[body]);

  Points target{*grid, *order};
  std::vector<std::int64_t> ids;
  std::vector<openvdb::Vec3f> velocities;
  std::vector<float> radii;
  for (const std::size_t i : particles) {
    ids.push_back(frame.ids[i]);
    velocities.emplace_back(frame.velocities[i].data());
    radii.push_back(particle_radius(frame.volumes[i], frame.dimension));
  }
  target.add("id", ids);
  target.add("v", velocities);
  target.add("pscale", radii);
  for (std::size_t a = 0; a < names.size(); ++a) add_attribute(target, names[a], frame.attributes[a], particles);
  return grid;
}

}  // namespace

void write_points_vdb(const std::filesystem::path& path, const ParticleFrame& frame) {
  openvdb::initialize();
  const std::vector<std::string> names = attribute_names(frame);
  openvdb::GridCPtrVec grids;
  for (std::size_t body = 0; body < frame.bodies.size(); ++body) grids.push_back(point_grid(frame, body, names));
  save_grids(path, grids);
}

}  // namespace cleave::output
