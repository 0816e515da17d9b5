#pragma once

#include "common/types.hpp"

#include <cstdint>
#include <vector>

namespace cleave::scene {

/// Points on a torus of `cells` grid cells a side (in 2D: a square torus), exactly `points_per_cell` a cell on average, with a
/// minimum distance. Repeated over space it is a Poisson-disk pattern of exactly known density whose points are found cell by
/// cell, in any order and by any number of threads.
struct BlueNoiseTile {
  int dimension = 3;
  int cells = 0;                         ///< a side
  double minimum_distance = 0;           ///< as reached, in cells
  std::vector<std::size_t> cell_begins;  ///< of points, by cell (x fastest), one more than there are cells
  std::vector<Vector3> points;           ///< in cells from the corner of their own cell, 0..1; in 2D z = 0
};

/// Starts from `points_per_cell` random points in every cell and pushes close pairs apart until none is nearer than 0.85
/// (2D: 0.8) of the edge of the volume a point has to itself, less two percent. The even start keeps the density even at all
/// scales; the densest packing possible would reach 1.12 (2D: 1.07).
BlueNoiseTile make_blue_noise_tile(int points_per_cell, int dimension, std::uint64_t seed);

}  // namespace cleave::scene
