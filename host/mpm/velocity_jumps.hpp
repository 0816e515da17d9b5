#pragma once

#include "mpm/grid.hpp"
#include "mpm/particle_blocks.hpp"
#include "mpm/particles.hpp"

#include <vector>

namespace cleave::mpm {

/// How much a step can strain a particle at most, told from the velocities of the grid before any particle is moved.
///
/// The velocity gradient of a particle is C_ia = 4/dx sum_n w_n o_n v_in along an axis a, o_n the offset of node n in cells
/// (MLS-MPM, Hu et al. 2018), with sum_n w_n o_n = 0 and sum_n w_n o_n^2 = 1/4. Summed by parts it is a sum of the differences
/// of velocity between nodes that are next to each other, with weights that are not negative and come to 1/dx:
///
///   |C_ia| <= max |v_i(n + 1) - v_i(n)| / dx
///
/// over the nodes of the particle's stencil. Nodes without mass have no weight.
template <class T, int D>
class VelocityJumps {
 public:
  /// The largest difference of a component of velocity anywhere in the neighbourhood of a home block: never less than the
  /// largest jump, m/s. Costs a look at every node.
  double bound(const Grid<T, D>&, const std::vector<const Particles<T, D>*>&);
  /// The largest jump itself, of home blocks whose neighbourhoods differ by more than `least`, m/s.
  double largest(const Grid<T, D>&, const std::vector<const Particles<T, D>*>&, double least) const;

 private:
  struct Range {
    T low[D], high[D];
  };
  double around(const BlockView&) const;
  static double largest_of(const Grid<T, D>&, const BlockView&);

  std::vector<Range> ranges_;  // of each block of the grid
};

}  // namespace cleave::mpm
