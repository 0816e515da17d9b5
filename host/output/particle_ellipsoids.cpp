#include "output/particle_ellipsoids.hpp"

#include "output/particle_neighbours.hpp"

#include <tbb/parallel_for.h>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>

namespace cleave::output {
namespace {

// Lengths in spacings.
constexpr float reach = 2.2f;           ///< of neighbours
constexpr float inside_radius = 0.95f;  ///< leaves no holes between particles of a cubic lattice, which needs 0.87
constexpr float axis_length = 1.2f;     ///< of an axis along which neighbours lie as in an endless lattice
/// Of the volume of a particle, (3/(4 pi))^(1/3): broken ones, spread over a crack that has opened, do not fill it.
constexpr float broken_radius = 0.62f;
/// Of particles without neighbours. Smoothing over a voxel of half a spacing leaves about their volume of it.
constexpr float lone_radius = 0.78f;
constexpr float to_mean = 0.5f;  ///< part of the way to the mean of the neighbours
/// Standard deviation of places along an axis of an endless body, with the weights 1 - (r/R)^3: sqrt(3/20) R.
constexpr float endless_deviation = 0.387f * reach;
constexpr float least_ratio = 0.45f, largest_ratio = 1.2f;
constexpr int fewest_neighbours = 5;

struct Neighbour {
  Eigen::Vector3f place;
  float weight;
};

Ellipsoid ball(const Eigen::Vector3f& center, float radius) {
  return {center, Eigen::Vector3f::Constant(radius), Eigen::Matrix3f::Identity()};
}

Ellipsoid of_neighbours(const Eigen::Vector3f& place, const std::vector<Neighbour>& neighbours, float spacing) {
  float weights = 1;
  Eigen::Vector3f offset = Eigen::Vector3f::Zero();
  for (const Neighbour& n : neighbours) {
    weights += n.weight;
    offset += n.weight * (n.place - place);
  }
  offset /= weights;
  Eigen::Matrix3f spread = offset * offset.transpose();
  for (const Neighbour& n : neighbours) {
    const Eigen::Vector3f d = n.place - place - offset;
    spread += n.weight * d * d.transpose();
  }
  spread /= weights;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
  solver.computeDirect(spread / (spacing * spacing));
  const Eigen::Array3f ratio =
      (solver.eigenvalues().array().max(0.f).sqrt() / endless_deviation).max(least_ratio).min(largest_ratio);
  if (ratio.minCoeff() > 0.85f && offset.norm() < 0.2f * spacing) return ball(place, inside_radius * spacing);
  return {place + to_mean * offset, axis_length * spacing * ratio, solver.eigenvectors()};
}

}  // namespace

std::vector<Ellipsoid> particle_ellipsoids(std::span<const Eigen::Vector3f> places, std::span<const float> damage,
                                           float spacing) {
  const ParticleNeighbours all(places, reach * spacing);
  const auto broken = [&](std::size_t i) { return !damage.empty() && damage[i] >= broken_damage; };
  std::vector<Ellipsoid> ellipsoids(places.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, places.size(), 256), [&](const auto& range) {
    std::vector<Neighbour> neighbours;
    std::vector<Eigen::Vector3f> between;
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const Eigen::Vector3f& place = places[i];
      ellipsoids[i] = ball(place, (broken(i) ? broken_radius : lone_radius) * spacing);
      if (broken(i)) continue;
      neighbours.clear();
      between.clear();
      all.for_each(place, reach * spacing, [&](std::size_t j) {
        if (broken(j))
          between.push_back(places[j]);
        else if (j != i) {
          const float r = (places[j] - place).norm() / (reach * spacing);
          neighbours.push_back({places[j], 1 - r * r * r});
        }
      });
      if (!between.empty())
        std::erase_if(neighbours, [&](const Neighbour& n) {
          const Eigen::Vector3f middle = (place + n.place) / 2;
          const float close = 0.5f * (n.place - place).norm();
          return std::any_of(between.begin(), between.end(),
                             [&](const Eigen::Vector3f& b) { return (b - middle).squaredNorm() < 0.64f * close * close; });
        });
      if (int(neighbours.size()) >= fewest_neighbours) ellipsoids[i] = of_neighbours(place, neighbours, spacing);
    }
  });
  return ellipsoids;
}

}  // namespace cleave::output
