#include "scene/vector_grid.hpp"

#include "common/error.hpp"

#include <openvdb/openvdb.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <mutex>

namespace cleave::scene {
namespace {

openvdb::GridBase::Ptr read_grid(const std::filesystem::path& path, const std::string& name) {
  static std::once_flag initialized;
  std::call_once(initialized, [] { openvdb::initialize(); });
  openvdb::GridBase::Ptr chosen;
  std::string others;
  try {
    openvdb::io::File file(path.string());
    constexpr bool delay_loading = false;
    file.open(delay_loading);
    for (auto unique_name = file.beginName(); unique_name != file.endName() && !chosen; ++unique_name) {
      const auto grid = file.readGridMetadata(*unique_name);
      const bool vectors = grid->isType<openvdb::Vec3SGrid>() || grid->isType<openvdb::Vec3DGrid>();
      if (vectors && (name.empty() || grid->getName() == name)) chosen = file.readGrid(*unique_name);
      others += fmt::format("{}'{}' ({})", others.empty() ? "it has " : ", ", grid->getName(), grid->valueType());
    }
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: not a readable OpenVDB file ({})", path.string(), error.what()));
  }
  if (chosen) return chosen;
  throw InputError(fmt::format("{}: {}; {}", path.string(),
                               name.empty() ? "no grid of vectors in the file" : "no grid of vectors named '" + name + "'",
                               others.empty() ? "it is empty" : others));
}

Vector3 from(const openvdb::Vec3d& v) { return {v[0], v[1], v[2]}; }

template <class Grid>
std::vector<Vector3> interpolate(const Grid& grid, const std::vector<Vector3>& positions, int dimension) {
  const auto voxels = grid.getConstAccessor();
  std::vector<Vector3> field;
  field.reserve(positions.size());
  for (const Vector3& x : positions) {
    const openvdb::Vec3d index = grid.worldToIndex(openvdb::Vec3d(x[0], x[1], dimension == 2 ? 0.0 : x[2]));
    const openvdb::Coord corner = openvdb::Coord::floor(index);
    Vector3 values[8], sum = Vector3::Zero(), nearest = Vector3::Zero();
    double weights[8], most = 0;
    for (int c = 0; c < 8; ++c) {
      const openvdb::Coord at = corner.offsetBy(c & 1, c >> 1 & 1, c >> 2 & 1);
      values[c] = from(openvdb::Vec3d(voxels.getValue(at)));
      if (dimension == 2) values[c].z() = 0;
      weights[c] = 1;
      for (int axis = 0; axis < 3; ++axis) weights[c] *= 1 - std::abs(index[axis] - at[axis]);
      if (weights[c] > most && values[c].squaredNorm() > 0) {
        most = weights[c];
        nearest = values[c];
      }
    }
    for (int c = 0; c < 8; ++c) sum += (values[c].dot(nearest) < 0 ? -weights[c] : weights[c]) * values[c];
    const double length = sum.stableNorm();
    field.push_back(length > 0 && std::isfinite(length) ? Vector3(sum / length) : Vector3(Vector3::Zero()));
  }
  return field;
}

}  // namespace

std::vector<Vector3> grid_directions(const std::filesystem::path& path, const std::string& name,
                                     const std::vector<Vector3>& positions, int dimension) {
  const auto grid = read_grid(path, name);
  const auto field = grid->isType<openvdb::Vec3SGrid>()
                         ? interpolate(*openvdb::gridPtrCast<openvdb::Vec3SGrid>(grid), positions, dimension)
                         : interpolate(*openvdb::gridPtrCast<openvdb::Vec3DGrid>(grid), positions, dimension);
  std::size_t without = 0, first = 0;
  for (std::size_t i = field.size(); i-- > 0;)
    if (field[i].isZero(0)) {
      ++without;
      first = i;
    }
  if (without > 0) {
    const Vector3& x = positions[first];
    throw InputError(
        fmt::format("{}: the grid '{}' has no direction at {} of {} particles, such as the one at ({:.4g}, {:.4g}, {:.4g}) m; "
                    "it must hold vectors that are not 0 wherever the body is",
                    path.string(), grid->getName(), without, field.size(), x[0], x[1], x[2]));
  }
  return field;
}

}  // namespace cleave::scene
