#include "scene/level_set.hpp"

#include "common/error.hpp"
#include "scene/mesh_closing.hpp"
#include "scene/text_input.hpp"

#include <openvdb/openvdb.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <spdlog/spdlog.h>
#include <tbb/parallel_reduce.h>

#include <cmath>
#include <limits>
#include <mutex>

namespace cleave::scene {
namespace {

using openvdb::FloatGrid;
using openvdb::FloatTree;

/// Half width of the narrow band, in voxels. Distances are right as long as no corner of the enclosing voxel is clamped.
constexpr float half_width = 4;

class LevelSet final : public SignedDistance {
 public:
  LevelSet(FloatGrid::Ptr grid, const Box& bounds) : grid_(std::move(grid)), bounds_(bounds) {
    const openvdb::Mat4R affine = grid_->transform().baseMap()->getAffineMap()->getMat4();  // acts on row vectors
    Matrix3 index_to_world;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) index_to_world(i, j) = affine(j, i);
      origin_[i] = affine(3, i);
    }
    world_to_index_ = index_to_world.inverse();
    voxel_size_ = grid_->voxelSize()[0];
    background_ = grid_->background();
    const openvdb::CoordBBox active = grid_->evalActiveVoxelBoundingBox();
    for (int i = 0; i < 3; ++i) {
      least_index_[i] = active.min()[i] - 1;
      greatest_index_[i] = active.max()[i] + 1;
    }
  }

  double distance(const Vector3& x) const override {
    const Vector3 index = world_to_index_ * (x - origin_);
    const bool among_voxels = (index.array() >= least_index_.array()).all() && (index.array() <= greatest_index_.array()).all();
    // Written so that NaN counts as outside. The box is a bound as well and, far away, the better one.
    if (!among_voxels) return std::max(background_, bounds_.exteriorDistance(x));
    const openvdb::Coord corner(static_cast<int>(std::floor(index[0])), static_cast<int>(std::floor(index[1])),
                                static_cast<int>(std::floor(index[2])));
    const double u = index[0] - corner[0], v = index[1] - corner[1], w = index[2] - corner[2];
    // An accessor of its own for each call keeps threads apart; it still finds seven of the eight corners in its cache.
    openvdb::tree::ValueAccessor<const FloatTree, false> voxels(grid_->tree());
    const auto along_z = [&](int i, int j) {
      const double low = voxels.getValue(corner.offsetBy(i, j, 0)), high = voxels.getValue(corner.offsetBy(i, j, 1));
      return low + w * (high - low);
    };
    const auto along_y = [&](int i) {
      const double low = along_z(i, 0), high = along_z(i, 1);
      return low + v * (high - low);
    };
    const double low = along_y(0), high = along_y(1);
    return low + u * (high - low);
  }

  Vector3 normal(const Vector3& x) const override {
    Vector3 gradient;
    for (int i = 0; i < 3; ++i) {
      const Vector3 offset = 0.5 * voxel_size_ * Vector3::Unit(i);
      gradient[i] = distance(x + offset) - distance(x - offset);
    }
    const double length = gradient.norm();
    return length > 1e-6 * voxel_size_ ? Vector3(gradient / length) : Vector3(Vector3::Zero());
  }

  Box bounds() const override { return bounds_; }
  double band() const override { return std::max(0.0, background_ - std::sqrt(3.0) * voxel_size_); }

 private:
  FloatGrid::Ptr grid_;
  Box bounds_;
  Matrix3 world_to_index_;
  Vector3 origin_, least_index_, greatest_index_;
  double voxel_size_ = 0, background_ = 0;
};

/// Where the surface crosses the lines between voxels, which are the extreme points of a trilinear level set: the bounding box
/// in index space. Empty if no voxel is inside.
Box surface_box(const FloatGrid& grid) {
  std::vector<const FloatTree::LeafNodeType*> leaves;
  grid.tree().getNodes(leaves);
  const auto visit = [&](const tbb::blocked_range<std::size_t>& range, Box box) {
    openvdb::tree::ValueAccessor<const FloatTree, false> voxels(grid.tree());
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      for (auto voxel = leaves[n]->cbeginValueOn(); voxel; ++voxel) {
        const double inside = *voxel;
        if (!(inside < 0)) continue;
        const openvdb::Coord at = voxel.getCoord();
        const Vector3 center(at[0], at[1], at[2]);
        box.extend(center);
        for (int axis = 0; axis < 3; ++axis) {
          for (const int step : {-1, 1}) {
            openvdb::Coord neighbour = at;
            neighbour[axis] += step;
            const double outside = voxels.getValue(neighbour);
            if (outside >= 0) box.extend(center + step * inside / (inside - outside) * Vector3::Unit(axis));
          }
        }
      }
    }
    return box;
  };
  return tbb::parallel_reduce(tbb::blocked_range<std::size_t>(0, leaves.size(), 64), Box(), visit,
                              [](Box a, const Box& b) { return b.isEmpty() ? a : a.extend(b); });
}

/// Hands triangles to the converter in index space, in double precision.
struct TrianglesInIndexSpace {
  const TriangleMesh& mesh;
  double voxel_size;
  std::size_t polygonCount() const { return mesh.triangles.size(); }
  std::size_t pointCount() const { return mesh.vertices.size(); }
  std::size_t vertexCount(std::size_t) const { return 3; }
  void getIndexSpacePoint(std::size_t triangle, std::size_t corner, openvdb::Vec3d& position) const {
    const Vector3& v = mesh.vertices[static_cast<std::size_t>(mesh.triangles[triangle][corner])];
    position = openvdb::Vec3d(v[0], v[1], v[2]) / voxel_size;
  }
};

FloatGrid::Ptr to_volume(const TriangleMesh& mesh, double voxel_size) {
  const auto transform = openvdb::math::Transform::createLinearTransform(voxel_size);
  return openvdb::tools::meshToVolume<FloatGrid>(TrianglesInIndexSpace{mesh, voxel_size}, *transform, half_width, half_width);
}

void check_size(const TriangleMesh& mesh, const Box& box, double voxel_size, const std::string& name) {
  if (!(voxel_size > 0) || !std::isfinite(voxel_size)) throw InputError(name + ": the voxel size must be positive");
  constexpr double most_voxels = 4e8, widest_index = 1e9;
  double area = 0;
  for (const auto& t : mesh.triangles) {
    const Vector3& a = mesh.vertices[static_cast<std::size_t>(t[0])];
    area +=
        (mesh.vertices[static_cast<std::size_t>(t[1])] - a).cross(mesh.vertices[static_cast<std::size_t>(t[2])] - a).norm() / 2;
  }
  const double voxels = 2 * half_width * area / (voxel_size * voxel_size);
  const double widest = std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff()) / voxel_size;
  if (voxels <= most_voxels && widest <= widest_index) return;
  throw InputError(
      fmt::format("{}: the mesh is {:.4g} m long, which at voxels of {:.4g} m takes about {:.2g} million voxels; "
                  "give it a size in metres or use larger cells",
                  name, box.sizes().maxCoeff(), voxel_size, voxels / 1e6));
}

/// Rounding alone can put a voxel on a sheet of no thickness inside; those do not count.
bool encloses_anything(const FloatGrid& grid, double voxel_size) {
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    for (auto voxel = leaf->cbeginValueOn(); voxel; ++voxel) {
      if (*voxel < -1e-3 * voxel_size) return true;
    }
  }
  return false;
}

std::string describe_grids(const openvdb::GridPtrVec& grids) {
  if (grids.empty()) return "it has no grids";
  std::string text = "it has";
  for (const auto& grid : grids) {
    text += fmt::format("{} '{}' ({}, {})", grid == grids.front() ? "" : ",", grid->getName(), grid->valueType(),
                        openvdb::GridBase::gridClassToString(grid->getGridClass()));
  }
  return text;
}

bool is_level_set(const openvdb::GridBase& grid) {
  return grid.isType<FloatGrid>() && grid.getGridClass() == openvdb::GRID_LEVEL_SET;
}

}  // namespace

std::unique_ptr<SignedDistance> level_set_of_mesh(const TriangleMesh& mesh, double voxel_size, const std::string& name) {
  Box box;
  for (const auto& triangle : mesh.triangles) {
    for (const int corner : triangle) box.extend(mesh.vertices[static_cast<std::size_t>(corner)]);
  }
  check_size(mesh, box, voxel_size, name);
  const ClosedSurfaces surfaces = close_mesh(mesh, name);
  if (surfaces.closed_holes > 0) {
    spdlog::info("{}: closed {} hole{} ({} open edges)", name, surfaces.closed_holes, surfaces.closed_holes == 1 ? "" : "s",
                 surfaces.open_edges);
  }
  FloatGrid::Ptr grid = to_volume(surfaces.solids, voxel_size);
  if (!surfaces.cavities.triangles.empty()) openvdb::tools::csgDifference(*grid, *to_volume(surfaces.cavities, voxel_size));
  if (!encloses_anything(*grid, voxel_size)) {
    throw InputError(
        fmt::format("{}: the mesh encloses no volume that voxels of {:.4g} m resolve (it is {:.4g} m long); use "
                    "smaller cells or give it its size in metres",
                    name, voxel_size, box.sizes().maxCoeff()));
  }
  return std::make_unique<LevelSet>(std::move(grid), box);
}

std::unique_ptr<SignedDistance> read_level_set(const std::filesystem::path& path, const std::string& name) {
  static std::once_flag initialized;
  std::call_once(initialized, [] { openvdb::initialize(); });
  require_file(path);
  const std::string where = path.string() + ": ";

  openvdb::GridBase::Ptr chosen;
  openvdb::GridPtrVec grids;
  try {
    openvdb::io::File file(path.string());
    constexpr bool delay_loading = false;
    file.open(delay_loading);
    for (auto unique_name = file.beginName(); unique_name != file.endName(); ++unique_name) {
      grids.push_back(file.readGridMetadata(*unique_name));
      const bool wanted = name.empty() ? is_level_set(*grids.back()) : grids.back()->getName() == name;
      if (wanted && !chosen) {
        chosen = grids.back();
        if (is_level_set(*chosen)) chosen = file.readGrid(*unique_name);
      }
    }
  } catch (const std::exception& error) {
    throw InputError(where + "not a readable OpenVDB file (" + error.what() + ")");
  }
  if (!chosen) {
    const std::string missing = name.empty() ? "no level set of single precision in the file" : "no grid named '" + name + "'";
    throw InputError(where + missing + "; " + describe_grids(grids));
  }
  if (!is_level_set(*chosen)) {
    throw InputError(where + "the grid '" + name + "' is not a level set of single precision; " + describe_grids(grids));
  }
  const FloatGrid::Ptr grid = openvdb::gridPtrCast<FloatGrid>(chosen);
  if (!grid->transform().isLinear() || !grid->hasUniformVoxels()) {
    throw InputError(where + "the voxels of the grid '" + grid->getName() + "' are not cubes, so that it holds no distances");
  }
  if (!(grid->background() > 0)) {
    throw InputError(where + "the grid '" + grid->getName() + "' has no positive background distance");
  }
  openvdb::tools::signedFloodFill(grid->tree());
  const Box index_box = surface_box(*grid);
  if (index_box.isEmpty()) throw InputError(where + "the level set '" + grid->getName() + "' has no inside");
  Box box;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3 index = index_box.corner(static_cast<Box::CornerType>(corner));
    const openvdb::Vec3d world = grid->indexToWorld(openvdb::Vec3d(index[0], index[1], index[2]));
    box.extend(Vector3(world[0], world[1], world[2]));
  }
  return std::make_unique<LevelSet>(grid, box);
}

}  // namespace cleave::scene
