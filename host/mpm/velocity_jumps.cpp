#include "mpm/velocity_jumps.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cleave::mpm {

template <class T, int D>
double VelocityJumps<T, D>::bound(const Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets) {
  constexpr T infinity = std::numeric_limits<T>::infinity();
  ranges_.resize(grid.blocks());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid.blocks(), 64), [&](const auto& range) {
    for (std::size_t b = range.begin(); b < range.end(); b++) {
      const T* node = grid.node(b * GridShape<D>::block_nodes);
      T low[4] = {infinity, infinity, infinity, infinity}, high[4] = {-infinity, -infinity, -infinity, -infinity};
      for (int n = 0; n < GridShape<D>::block_nodes; n++, node += 4)
        if (node[0] > T(0))
          for (int a = 0; a < 4; a++) {
            low[a] = std::min(low[a], node[a]);
            high[a] = std::max(high[a], node[a]);
          }
      std::copy_n(low + 1, D, ranges_[b].low);
      std::copy_n(high + 1, D, ranges_[b].high);
    }
  });
  double largest = 0;
  std::vector<double> of_blocks;
  for (const auto* set : sets) {
    const auto& blocks = set->blocks();
    of_blocks.assign(blocks.size(), 0.0);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 64), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); i++) of_blocks[i] = around(blocks[i]);
    });
    for (const double d : of_blocks) largest = std::max(largest, d);
  }
  return largest;
}

template <class T, int D>
double VelocityJumps<T, D>::around(const BlockView& block) const {
  double difference = 0;
  for (int a = 0; a < D; a++) {
    T low = std::numeric_limits<T>::infinity(), high = -low;
    for (int n = 0; n < GridShape<D>::neighbours; n++) {
      const Range& range = ranges_[block.neighbours[n]];
      low = std::min(low, range.low[a]);
      high = std::max(high, range.high[a]);
    }
    difference = std::max(difference, double(high) - double(low));
  }
  return difference;
}

template <class T, int D>
double VelocityJumps<T, D>::largest_of(const Grid<T, D>& grid, const BlockView& block) {
  constexpr int edge = GridShape<D>::block_edge, arena = GridShape<D>::arena_edge, depth = D == 3 ? arena : 1;
  // nodes -1 to edge + 2 along each axis: all that particles of the block reach before they are sorted again
  const auto node = [&](int x, int y, int z) {
    const std::array<int, 3> c{x - 1, y - 1, D == 3 ? z - 1 : 0};
    int neighbour = 0, inside = 0;
    for (int a = 0; a < D; a++) {
      const int offset = c[std::size_t(a)] < 0 ? -1 : c[std::size_t(a)] >= edge ? 1 : 0;
      neighbour = neighbour * 3 + offset + 1;
      inside = inside * edge + c[std::size_t(a)] - offset * edge;
    }
    return grid.node(std::size_t(block.neighbours[neighbour]) * GridShape<D>::block_nodes + std::size_t(inside));
  };
  T jump = 0;
  const auto compare = [&](const T* a, const T* b) {
    if (a[0] > T(0) && b[0] > T(0))
      for (int i = 1; i <= D; i++) jump = std::max(jump, std::abs(a[i] - b[i]));
  };
  for (int x = 0; x < arena; x++)
    for (int y = 0; y < arena; y++)
      for (int z = 0; z < depth; z++) {
        const T* here = node(x, y, z);
        if (x + 1 < arena) compare(here, node(x + 1, y, z));
        if (y + 1 < arena) compare(here, node(x, y + 1, z));
        if (z + 1 < depth) compare(here, node(x, y, z + 1));
      }
  return double(jump);
}

template <class T, int D>
double VelocityJumps<T, D>::largest(const Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets,
                                    double least) const {
  double largest = 0;
  std::vector<double> of_blocks;
  for (const auto* set : sets) {
    const auto& blocks = set->blocks();
    of_blocks.assign(blocks.size(), 0.0);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 4), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); i++)
        if (around(blocks[i]) > least) of_blocks[i] = largest_of(grid, blocks[i]);
    });
    for (const double d : of_blocks) largest = std::max(largest, d);
  }
  return largest;
}

template class VelocityJumps<float, 2>;
template class VelocityJumps<float, 3>;
template class VelocityJumps<double, 2>;
template class VelocityJumps<double, 3>;

}  // namespace cleave::mpm
