#include "output/particle_surface.hpp"

#include "output/particle_ellipsoids.hpp"
#include "output/particle_level_set.hpp"
#include "output/particle_neighbours.hpp"
#include "output/vdb_file.hpp"

#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/ValueTransformer.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace cleave::output {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;

constexpr double voxel_width = 0.5;   ///< in spacings
constexpr float band = 3;             ///< of the level set, in voxels
constexpr float beyond = 2;           ///< voxels that the union of ellipsoids is known outside of it
constexpr double farthest = 1 << 22;  ///< voxels from the origin, where single precision resolves half of one

const Attribute* find_damage(const ParticleFrame& frame) {
  const auto found =
      std::find_if(frame.attributes.begin(), frame.attributes.end(), [](const Attribute& a) { return a.name == "damage"; });
  return found != frame.attributes.end() && found->components == 1 ? &*found : nullptr;
}

/// An ellipsoid that reaches into a leaf.
struct Touch {
  openvdb::Coord origin;
  std::uint32_t ellipsoid;
  friend bool operator<(const Touch& a, const Touch& b) {
    return std::tie(a.origin, a.ellipsoid) < std::tie(b.origin, b.ellipsoid);
  }
};

/// Ellipsoids in voxels: distances to first order, k0 (k0 - 1)/k1 with k0 = |r^-1 x| and k1 = |r^-2 x|.
struct Shape {
  Eigen::Vector3f center;
  Eigen::Matrix3f to_sphere;  ///< r^-1 axes^T
  Eigen::Array3f inverse_radii;
  float least_radius;

  Shape(const Ellipsoid& e, float voxel)
      : center(e.center / voxel),
        to_sphere((e.radii / voxel).cwiseInverse().asDiagonal() * e.axes.transpose()),
        inverse_radii((e.radii / voxel).cwiseInverse()),
        least_radius(e.radii.minCoeff() / voxel) {}
  float distance(const Eigen::Vector3f& x) const {
    const Eigen::Vector3f u = to_sphere * (x - center);
    const float k0 = u.norm(), k1 = (inverse_radii * u.array()).matrix().norm();
    return k1 > 1e-6f ? k0 * (k0 - 1) / k1 : -least_radius;
  }
};

/// Half the edges of its bounding box.
Eigen::Array3f extent(const Ellipsoid& e) {
  return (e.axes.array().square().matrix() * e.radii.array().square().matrix()).array().sqrt();
}

void fill(openvdb::FloatTree& tree, const std::vector<Ellipsoid>& ellipsoids, float voxel) {
  constexpr int width = int(Leaf::DIM);
  const auto leaves_of = [&](const Ellipsoid& e) {
    const Eigen::Array3f half = extent(e) / voxel + beyond, middle = e.center.array() / voxel;
    const auto leaf = [](const Eigen::Array3f& x) -> Index3 { return (x / float(width)).floor().cast<int>(); };
    return std::pair(leaf(middle - half), leaf(middle + half));
  };
  std::vector<std::size_t> first(ellipsoids.size() + 1, 0);
  tbb::parallel_for(std::size_t(0), ellipsoids.size(), [&](std::size_t i) {
    const auto [low, high] = leaves_of(ellipsoids[i]);
    first[i + 1] = std::size_t((high - low + Index3::Ones()).prod());
  });
  for (std::size_t i = 0; i < ellipsoids.size(); i++) first[i + 1] += first[i];
  std::vector<Touch> touches(first.back());
  tbb::parallel_for(std::size_t(0), ellipsoids.size(), [&](std::size_t i) {
    const auto [low, high] = leaves_of(ellipsoids[i]);
    std::size_t n = first[i];
    for (int x = low.x(); x <= high.x(); x++)
      for (int y = low.y(); y <= high.y(); y++)
        for (int z = low.z(); z <= high.z(); z++)
          touches[n++] = {openvdb::Coord(x * width, y * width, z * width), std::uint32_t(i)};
  });
  tbb::parallel_sort(touches.begin(), touches.end());
  std::vector<std::size_t> starts;
  for (std::size_t n = 0; n < touches.size(); n++)
    if (n == 0 || touches[n].origin != touches[n - 1].origin) starts.push_back(n);
  starts.push_back(touches.size());

  std::vector<Leaf*> leaves(starts.size() - 1);
  const float background = tree.background();
  tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t l) {
    const openvdb::Coord origin = touches[starts[l]].origin;
    Leaf* const leaf = leaves[l] = new Leaf(origin, background / voxel, false);
    float* const values = leaf->buffer().data();
    for (std::size_t n = starts[l]; n < starts[l + 1]; n++) {
      const Ellipsoid& e = ellipsoids[touches[n].ellipsoid];
      const Shape shape(e, voxel);
      const Eigen::Array3f half = extent(e) / voxel + beyond;
      const auto inside = [&](const Eigen::Array3f& x, int a) {
        return std::clamp(int(std::lround(std::clamp(x[a], -1.f, float(width)))), 0, width - 1);
      };
      const Eigen::Array3f corner = Eigen::Array3f(float(origin.x()), float(origin.y()), float(origin.z())),
                           low = shape.center.array() - half - corner, high = shape.center.array() + half - corner;
      for (int x = inside(low, 0); x <= inside(high, 0); x++)
        for (int y = inside(low, 1); y <= inside(high, 1); y++)
          for (int z = inside(low, 2); z <= inside(high, 2); z++) {
            float& value = values[(x * width + y) * width + z];
            value = std::min(value, shape.distance(corner.matrix() + Eigen::Vector3f(float(x), float(y), float(z))));
          }
    }
    for (openvdb::Index n = 0; n < Leaf::SIZE; n++)
      if (values[n] < beyond) {
        values[n] *= voxel;
        leaf->setValueOn(n);
      } else {
        values[n] = background;
      }
  });
  for (Leaf* leaf : leaves) tree.addLeaf(leaf);
}

}  // namespace

double particle_spacing(const ParticleFrame& frame, std::size_t body) {
  std::vector<float> volumes;
  for (std::size_t i = frame.body_begin(body); i < frame.body_ends[body]; ++i)
    if (frame.volumes[i] > 0) volumes.push_back(frame.volumes[i]);
  if (volumes.empty()) return frame.cell_size / 2;
  const auto middle = volumes.begin() + static_cast<std::ptrdiff_t>(volumes.size() / 2);
  std::nth_element(volumes.begin(), middle, volumes.end());
  return frame.dimension == 2 ? std::sqrt(double(*middle)) : std::cbrt(double(*middle));
}

openvdb::FloatGrid::Ptr particle_level_set(const ParticleFrame& frame, std::size_t body, double coarseness) {
  const double spacing = particle_spacing(frame, body), voxel = voxel_width * coarseness * spacing;
  openvdb::FloatGrid::Ptr grid = openvdb::createLevelSet<openvdb::FloatGrid>(voxel, double(band));
  const std::vector<std::uint32_t> particles = particles_on_grid(frame, body, voxel, *grid);
  const openvdb::MetaMap description = *grid;
  if (!particles.empty()) {
    std::vector<Eigen::Vector3f> places;
    std::vector<float> damage;
    const Attribute* const d = find_damage(frame);
    for (const std::uint32_t i : particles) {
      const Vector3 x = position_of(frame, i);
      if (x.cwiseAbs().maxCoeff() > farthest * voxel) continue;
      places.push_back(x.cast<float>());
      if (d) damage.push_back(d->values[i]);
    }
    if (!places.empty()) fill(grid->tree(), particle_ellipsoids(places, damage, float(spacing)), float(voxel));
  }
  if (grid->activeVoxelCount() > 0) {
    grid->pruneGrid();
    // The union knows the nearest ellipsoid only; a level set needs the distance to the surface, in a narrow band.
    grid = openvdb::tools::sdfToSdf(*grid);
    const float width = grid->background();
    openvdb::tools::foreach (grid->beginValueOn(), [width](const openvdb::FloatGrid::ValueOnIter& value) {
      if (std::abs(*value) < width) return;
      value.setValue(std::copysign(width, *value));
      value.setValueOff();
    });
    openvdb::tools::pruneLevelSet(grid->tree());
    openvdb::tools::LevelSetFilter<openvdb::FloatGrid>(*grid).mean(1);
  }
  if (const auto left_out = description["particles_left_out"]) grid->insertMeta("particles_left_out", *left_out);
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  return grid;
}

SurfaceMesh surface_mesh(const ParticleFrame& frame, std::size_t body, double coarseness) {
  openvdb::initialize();
  const openvdb::FloatGrid::Ptr grid = particle_level_set(frame, body, coarseness);
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec3I> triangles;
  std::vector<openvdb::Vec4I> quads;
  openvdb::tools::volumeToMesh(*grid, points, triangles, quads);
  SurfaceMesh mesh;
  mesh.vertices.resize(points.size());
  mesh.normals.resize(points.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 1024), [&](const auto& range) {
    openvdb::FloatGrid::ConstAccessor accessor = grid->getConstAccessor();
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const openvdb::Vec3d place = grid->worldToIndex(openvdb::Vec3d(points[i]));
      Eigen::Vector3d slope;
      for (int a = 0; a < 3; a++) {
        openvdb::Vec3d step(0.0);
        step[a] = 1;
        slope[a] = double(openvdb::tools::BoxSampler::sample(accessor, place + step)) -
                   double(openvdb::tools::BoxSampler::sample(accessor, place - step));
      }
      mesh.vertices[i] = {points[i][0], points[i][1], points[i][2]};
      mesh.normals[i] = slope.stableNormalized().cast<float>();
    }
  });
  mesh.triangles.reserve(3 * triangles.size() + 6 * quads.size());
  for (const auto& t : triangles) mesh.triangles.insert(mesh.triangles.end(), {t[0], t[1], t[2]});
  for (const auto& q : quads) mesh.triangles.insert(mesh.triangles.end(), {q[0], q[1], q[2], q[0], q[2], q[3]});
  return mesh;
}

std::vector<float> interpolate(const ParticleFrame& frame, std::size_t body, std::span<const float> values, int components,
                               std::span<const Eigen::Vector3f> places) {
  const auto width = std::size_t(components), begin = frame.body_begin(body);
  const float reach = 1.5f * float(particle_spacing(frame, body));
  std::vector<Eigen::Vector3f> points;
  std::vector<std::size_t> particles;
  for (std::size_t i = begin; i < frame.body_ends[body]; i++)
    if (const Vector3 x = position_of(frame, i); x.allFinite()) {
      points.push_back(x.cast<float>());
      particles.push_back(i);
    }
  std::vector<float> results(width * places.size());
  if (points.empty()) return results;
  const ParticleNeighbours all(points, reach);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, places.size(), 256), [&](const auto& range) {
    for (std::size_t p = range.begin(); p < range.end(); p++) {
      float weights = 0;
      float* const result = results.data() + width * p;
      all.for_each(places[p], reach, [&](std::size_t n) {
        const float r = (points[n] - places[p]).norm() / reach, weight = (1 - r * r) * (1 - r * r);
        weights += weight;
        for (std::size_t c = 0; c < width; c++) result[c] += weight * values[width * particles[n] + c];
      });
      for (std::size_t c = 0; c < width && weights > 0; c++) result[c] /= weights;
    }
  });
  return results;
}

}  // namespace cleave::output
