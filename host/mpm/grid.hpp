#pragma once

#include "common/types.hpp"
#include "mpm/block_coordinate.hpp"
#include "mpm/buffer.hpp"
#include "mpm/kernels/kernels.hpp"

#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// Sparse, unbounded background grid: the blocks that particles can reach, in Morton order, and where they are.
/// Node values are four numbers: mass (in rho_ref dx^d), then momentum or velocity.
template <class T, int D>
class Grid {
 public:
  static constexpr int edge = GridShape<D>::block_edge;
  static constexpr int block_nodes = GridShape<D>::block_nodes;

  /// Collects the neighbourhoods of all home blocks and numbers them. Call `link` for every particle block afterwards.
  void rebuild(const std::vector<BlockCoordinate>& home_blocks);
  void link(BlockView&, const BlockCoordinate&) const;
  void clear(T* nodes) const;

  std::size_t blocks() const { return coordinates_.size(); }
  std::size_t nodes() const { return coordinates_.size() * block_nodes; }
  const BlockCoordinate& coordinate(std::size_t block) const { return coordinates_[block]; }
  /// Index of a block, BlockDirectory::none if it is not active.
  std::uint32_t find(const BlockCoordinate& c) const { return directory_.find(morton_key(c)); }

  T* data() const { return reinterpret_cast<T*>(values_.data()); }
  T* node(std::size_t index) const { return data() + index * 4; }
  /// A second set of values, allocated at first use (FLIP keeps the velocities before forces there).
  T* before() {
    before_.reserve(values_.bytes());
    return reinterpret_cast<T*>(before_.data());
  }
  std::size_t bytes() const { return values_.bytes() + before_.bytes(); }

  /// Integer coordinates of a node by its index (block * block_nodes + node).
  Index3 node_coordinates(std::size_t index) const {
    const auto& b = coordinates_[index / block_nodes];
    const int n = int(index % block_nodes);
    if constexpr (D == 3) return {b[0] * 4 + n / 16, b[1] * 4 + n / 4 % 4, b[2] * 4 + n % 4};
    return {b[0] * 8 + n / 8, b[1] * 8 + n % 8, 0};
  }
  /// Index of a node from its integer coordinates; ~0 if its block is not active.
  std::size_t node_index(const Index3& c) const;

 private:
  std::vector<BlockCoordinate> coordinates_;
  BlockDirectory directory_;
  Buffer values_, before_;
};

}  // namespace cleave::mpm
