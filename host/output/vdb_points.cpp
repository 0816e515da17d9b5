#include "output/vdb.hpp"
#include "output/vdb_file.hpp"

namespace cleave::output {
namespace {

namespace points = openvdb::points;
using points::PointDataGrid;

/// What PointAttributeVector is to OpenVDB without a copy: value(n, m) looks number m of particle n up.
template <class Value, class Lookup>
struct Values {
  using PosType = Value;
  using value_type = Value;
  const std::vector<std::uint32_t>& particles;
  Lookup value;

  std::size_t size() const { return particles.size(); }
  void getPos(std::size_t n, Value& x) const { x = value(particles[n], 0); }
  void get(Value& x, std::size_t n, openvdb::Index m = 0) const { x = value(particles[n], m); }
};

/// The points of one grid, which particles they are and the order in which it keeps them.
struct Points {
  PointDataGrid& grid;
  const openvdb::tools::PointIndexGrid& order;
  const std::vector<std::uint32_t>& particles;

  template <class Value, class Lookup>
  void add(const std::string& name, const Lookup& value, openvdb::Index stride = 1) {
    points::appendAttribute(grid.tree(), name, points::TypedAttributeArray<Value>::attributeType(), stride);
    points::populateAttribute(grid.tree(), order.tree(), name, Values<Value, Lookup>{particles, value}, stride);
  }
};

void add_attribute(Points& target, const std::string& name, const Attribute& attribute) {
  const auto width = static_cast<std::size_t>(attribute.components);
  const float* const values = attribute.values.data();
  if (!attribute.unit.empty()) target.grid.insertMeta("unit_" + name, openvdb::StringMetadata(attribute.unit));
  if (width == 3)
    target.add<openvdb::Vec3f>(name, [=](std::size_t i, openvdb::Index) { return openvdb::Vec3f(values + 3 * i); });
  else
    target.add<float>(
        name, [=](std::size_t i, openvdb::Index component) { return values[i * width + component]; },
        static_cast<openvdb::Index>(width));
}

PointDataGrid::Ptr point_grid(const ParticleFrame& frame, std::size_t body, const std::vector<std::string>& names) {
  const double voxel_size = 2 * frame.cell_size;
  const auto transform = openvdb::math::Transform::createLinearTransform(voxel_size);
  const PointDataGrid::Ptr description = PointDataGrid::create();
  const std::vector<std::uint32_t> particles = particles_on_grid(frame, body, voxel_size, *description);

  const auto position = [&](std::size_t i, openvdb::Index) {
    const Vector3 x = position_of(frame, i);
    return openvdb::Vec3d(x.x(), x.y(), x.z());
  };
  const Values<openvdb::Vec3d, decltype(position)> positions{particles, position};
  const auto order = openvdb::tools::createPointIndexGrid<openvdb::tools::PointIndexGrid>(positions, *transform);
  const auto grid = points::createPointDataGrid<points::NullCodec, PointDataGrid>(*order, positions, *transform);
  grid->insertMeta(*description);
  describe(*grid, frame, frame.bodies[body]);

  Points target{*grid, *order, particles};
  target.add<std::int64_t>("id", [](std::size_t i, openvdb::Index) { return static_cast<std::int64_t>(i); });
  target.add<openvdb::Vec3f>("v", [&](std::size_t i, openvdb::Index) { return openvdb::Vec3f(frame.velocities[i].data()); });
  target.add<float>("pscale",
                    [&](std::size_t i, openvdb::Index) { return particle_radius(frame.volumes[i], frame.dimension); });
  if (!frame.colors.empty())
    target.add<openvdb::Vec3f>("Cd", [&](std::size_t i, openvdb::Index) {
      const Color& c = frame.colors[i];
      return openvdb::Vec3f(c[0], c[1], c[2]) / 255.f;
    });
  for (std::size_t a = 0; a < names.size(); ++a) add_attribute(target, names[a], frame.attributes[a]);
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
