#include "output/particle_neighbours.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <tuple>

namespace cleave::output {

bool ParticleNeighbours::before(const Cell& a, const Cell& b) {
  return std::lexicographical_compare(a.zyx, a.zyx + 3, b.zyx, b.zyx + 3);
}

ParticleNeighbours::ParticleNeighbours(std::span<const Eigen::Vector3f> points, float radius)
    : inverse_width_(1 / radius), sorted_(points.size()) {
  tbb::parallel_for(std::size_t(0), points.size(), [&](std::size_t i) {
    const Eigen::Vector3f cell = (points[i] * inverse_width_).array().floor();
    sorted_[i] = {{{cell.z(), cell.y(), cell.x()}}, points[i], std::uint32_t(i)};
  });
  tbb::parallel_sort(sorted_.begin(), sorted_.end(), [](const Entry& a, const Entry& b) {
    if (before(a.cell, b.cell)) return true;
    return !before(b.cell, a.cell) && a.index < b.index;
  });
}

std::size_t ParticleNeighbours::first_of(const Cell& cell) const {
  return std::size_t(std::lower_bound(sorted_.begin(), sorted_.end(), cell,
                                      [](const Entry& entry, const Cell& wanted) { return before(entry.cell, wanted); }) -
                     sorted_.begin());
}

}  // namespace cleave::output
