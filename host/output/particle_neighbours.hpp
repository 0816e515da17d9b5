#pragma once

#include "common/types.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace cleave::output {

/// Points sorted into cubic cells, for visits to all of them around a place. The order of visits is that of cells and, inside,
/// of indices, on any number of threads.
class ParticleNeighbours {
 public:
  /// `radius` > 0 is the largest that may be asked for.
  ParticleNeighbours(std::span<const Eigen::Vector3f> points, float radius);

  /// visit(index) for each point less than `radius` from `place`.
  template <class Visit>
  void for_each(const Eigen::Vector3f& place, float radius, const Visit& visit) const {
    const Eigen::Vector3d low = ((place.array() - radius) * inverse_width_).floor().cast<double>(),
                          high = ((place.array() + radius) * inverse_width_).floor().cast<double>();
    for (double z = low.z(); z <= high.z(); z++)
      for (double y = low.y(); y <= high.y(); y++) {
        std::size_t n = first_of({{float(z), float(y), float(low.x())}});
        for (; n < sorted_.size() && sorted_[n].cell[0] == float(z) && sorted_[n].cell[1] == float(y) &&
               sorted_[n].cell[2] <= float(high.x());
             n++)
          if ((sorted_[n].point - place).squaredNorm() < radius * radius) visit(sorted_[n].index);
      }
  }

 private:
  struct Cell {
    float zyx[3];  ///< whole numbers, too large for integers where particles have flown away
    float operator[](int a) const { return zyx[a]; }
  };
  struct Entry {
    Cell cell;
    Eigen::Vector3f point;
    std::uint32_t index;
  };
  static bool before(const Cell& a, const Cell& b);
  std::size_t first_of(const Cell&) const;

  float inverse_width_;
  std::vector<Entry> sorted_;
};

}  // namespace cleave::output
