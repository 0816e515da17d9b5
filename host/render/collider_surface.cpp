#include "render/painter.hpp"

#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace cleave::render {

Triangles collider_surface(const scene::SignedDistance& shape, const scene::RigidMotion::Pose& pose, const Box& within) {
  constexpr double most_cells = 64;
  Box box = within;
  const Box rest = shape.bounds();
  if (rest.isEmpty()) return {};
  if (rest.diagonal().allFinite()) {
    Box moved;
    for (int corner = 0; corner < 8; corner++) moved.extend(pose.to_world(rest.corner(Box::CornerType(corner))));
    box = box.intersection(moved);
  }
  if (box.isEmpty()) return {};
  // A layer around the box is outside: what reaches beyond the box is closed there.
  const Vector3 edges = box.diagonal().cwiseMax(1e-3 * within.diagonal().maxCoeff());
  const Vector3 cell = (edges / most_cells).cwiseMax((edges / 12).cwiseMin(Vector3::Constant(edges.maxCoeff() / most_cells)));
  const Index3 cells = (edges.array() / cell.array() + 0.5).cast<int>();
  const openvdb::CoordBBox lattice(openvdb::Coord(-2), openvdb::Coord(cells.x() + 2, cells.y() + 2, cells.z() + 2));
  openvdb::tools::Dense<float, openvdb::tools::LayoutZYX> values(lattice);
  tbb::parallel_for(lattice.min().x(), lattice.max().x() + 1, [&](int i) {
    for (int j = lattice.min().y(); j <= lattice.max().y(); j++)
      for (int k = lattice.min().z(); k <= lattice.max().z(); k++) {
        const Vector3 part = Vector3(i, j, k).cwiseProduct(cell), x = box.min() + part;
        const double outside = std::max((-part).maxCoeff(), (part - edges).maxCoeff());
        values.setValue(openvdb::Coord(i, j, k), float(std::max(outside, shape.distance(pose.to_scene(x)))));
      }
  });
  openvdb::initialize();
  const float far = float(2 * cell.maxCoeff());
  openvdb::FloatGrid grid(far);
  openvdb::tools::copyFromDense(values, grid, 0.f);
  grid.setGridClass(openvdb::GRID_LEVEL_SET);
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec3I> triangles;
  std::vector<openvdb::Vec4I> quads;
  openvdb::tools::volumeToMesh(grid, points, triangles, quads);
  Triangles mesh;
  for (const auto& p : points)
    mesh.vertices.push_back((box.min() + Vector3(double(p[0]), double(p[1]), double(p[2])).cwiseProduct(cell)).cast<float>());
  for (const auto& t : triangles) mesh.corners.insert(mesh.corners.end(), {t[0], t[1], t[2]});
  for (const auto& q : quads) mesh.corners.insert(mesh.corners.end(), {q[0], q[1], q[2], q[0], q[2], q[3]});
  return mesh;
}

}  // namespace cleave::render
