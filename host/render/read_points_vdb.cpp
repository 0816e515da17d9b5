#include "common/error.hpp"
#include "render/run_frames.hpp"

#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointAttribute.h>
#include <openvdb/points/PointDataGrid.h>

namespace cleave::render {
namespace {

namespace points = openvdb::points;

/// Numbers of one kind of all points of a leaf, to the end of `values`; `convert` is given a value of type T.
template <class T, class Value, class Convert>
void append(const points::PointDataTree::LeafNodeType& leaf, std::size_t attribute, std::vector<Value>& values,
            const Convert& convert) {
  const points::AttributeHandle<T> handle(leaf.constAttributeArray(attribute));
  for (openvdb::Index n = 0; n < handle.size(); n++)
    for (openvdb::Index c = 0; c < handle.stride(); c++) convert(handle.get(n, c), values);
}

void read_grid(const points::PointDataGrid& grid, std::int32_t body, const Wanted& wanted, FileFrame& frame) {
  const auto vector = [](const openvdb::Vec3f& v, auto& values) { values.emplace_back(v[0], v[1], v[2]); };
  const auto same = [](auto v, auto& values) { values.push_back(v); };
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    const auto& set = leaf->attributeSet();
    for (const auto& entry : set.descriptor().map()) {
      const std::string& name = entry.first;
      const std::size_t at = entry.second;
      if (name == "P") {
        const points::AttributeHandle<openvdb::Vec3f> handle(leaf->constAttributeArray(at));
        for (auto n = leaf->beginIndexOn(); n; ++n) {
          const openvdb::Vec3d place = grid.indexToWorld(openvdb::Vec3d(handle.get(*n)) + n.getCoord().asVec3d());
          frame.positions.emplace_back(place[0], place[1], place[2]);
          frame.body.push_back(body);
        }
      } else if (name == "id") {
        append<std::int64_t>(*leaf, at, frame.id, same);
      } else if (name == "v") {
        append<openvdb::Vec3f>(*leaf, at, frame.velocities, vector);
      } else if (name == "pscale") {
        append<float>(*leaf, at, frame.radius, same);
      } else if (name != "Cd") {
        frame.names.insert(name);
        if (!wanted(name)) continue;
        auto found =
            std::find_if(frame.attributes.begin(), frame.attributes.end(), [&](const auto& a) { return a.name == name; });
        const auto& array = leaf->constAttributeArray(at);
        const bool is_vector = array.valueType() == "vec3s";
        if (found == frame.attributes.end()) {
          std::string unit;
          if (const auto meta = grid.getMetadata<openvdb::StringMetadata>("unit_" + name)) unit = meta->value();
          frame.attributes.push_back({name, is_vector ? 3 : int(array.stride()), unit, {}});
          found = std::prev(frame.attributes.end());
        }
        if (is_vector)
          append<openvdb::Vec3f>(*leaf, at, found->values, [](const openvdb::Vec3f& v, auto& values) {
            values.insert(values.end(), v.asPointer(), v.asPointer() + 3);
          });
        else
          append<float>(*leaf, at, found->values, same);
      }
    }
  }
}

}  // namespace

FileFrame read_points_vdb(const std::filesystem::path& path, const Wanted& wanted) {
  openvdb::initialize();
  FileFrame frame;
  try {
    openvdb::io::File file(path.string());
    file.open(/*delayLoad=*/false);
    const auto grids = file.getGrids();
    for (const auto& grid : *grids) {
      const auto cloud = openvdb::gridPtrCast<points::PointDataGrid>(grid);
      if (!cloud) continue;
      frame.time = grid->metaValue<double>("time");
      frame.cell_size = grid->metaValue<double>("cell_size");
      frame.dimension = grid->metaValue<std::int32_t>("dimension");
      read_grid(*cloud, std::int32_t(frame.bodies.size()), wanted, frame);
      frame.bodies.push_back(grid->getName());
    }
  } catch (const std::exception& error) {
    throw InputError("error: cannot read " + path.string() + ": " + error.what());
  }
  const std::size_t count = frame.positions.size();
  bool whole = !frame.bodies.empty();
  for (const output::Attribute& a : frame.attributes) whole = whole && a.values.size() == count * std::size_t(a.components);
  if (!whole) throw InputError("error: " + path.string() + " is not a frame that cleave run has written");
  return frame;
}

}  // namespace cleave::render
