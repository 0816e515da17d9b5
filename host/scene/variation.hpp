#pragma once

#include "common/types.hpp"

#include <cstdint>
#include <vector>

namespace cleave::scene {

/// A random factor that varies over a body between `minimum` and `maximum`, both equally likely as anything between.
struct VariationSpec {
  enum class Pattern {
    voronoi,  ///< one value for each cell of a Voronoi tessellation (suggested by Wolper et al. 2019, CD-MPM)
    noise     ///< smooth
  };
  Pattern pattern = Pattern::voronoi;
  /// m. voronoi: mean spacing of the seeds, a Poisson process with one seed per size^dimension;
  /// noise: the underlying Gaussian field has the correlation exp(-(r/size)^2) at distance r.
  double size = 0;
  double minimum = 1, maximum = 1;
  std::uint64_t seed = 1;
};

/// The factor at each position: a function of the position alone, whatever the order of positions and number of threads. In 2D
/// the third coordinate is not looked at. Throws InputError if `size` is too small for coordinates as large as these.
std::vector<double> sample_variation(const VariationSpec&, const std::vector<Vector3>& positions, int dimension);

}  // namespace cleave::scene
