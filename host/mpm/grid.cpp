#include "mpm/grid.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>

namespace cleave::mpm {

template <class T, int D>
void Grid<T, D>::rebuild(const std::vector<BlockCoordinate>& home_blocks) {
  BlockDirectory seen;
  seen.reset(home_blocks.size() * 3);
  struct Entry {
    std::uint64_t key;
    BlockCoordinate coordinate;
  };
  std::vector<Entry> entries;
  constexpr int depth = D == 3 ? 1 : 0;
  for (const auto& c : home_blocks)
    for (int x = -1; x <= 1; x++)
      for (int y = -1; y <= 1; y++)
        for (int z = -depth; z <= depth; z++) {
          const BlockCoordinate n{c[0] + x, c[1] + y, c[2] + z};
          const std::uint64_t key = morton_key(n);
          const auto next = std::uint32_t(entries.size());
          if (seen.insert(key, next) == next) entries.push_back({key, n});
        }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.key < b.key; });
  coordinates_.resize(entries.size());
  directory_.reset(entries.size());
  for (std::size_t i = 0; i < entries.size(); i++) {
    coordinates_[i] = entries[i].coordinate;
    directory_.insert(entries[i].key, std::uint32_t(i));
  }
  const std::size_t bytes = nodes() * 4 * sizeof(T);
  if (bytes > values_.bytes()) {
    values_.reserve(bytes + bytes / 4);
    before_ = Buffer();
  }
}

template <class T, int D>
void Grid<T, D>::link(BlockView& block, const BlockCoordinate& c) const {
  constexpr int depth = D == 3 ? 1 : 0;
  int i = 0;
  for (int x = -1; x <= 1; x++)
    for (int y = -1; y <= 1; y++)
      for (int z = -depth; z <= depth; z++) block.neighbours[i++] = find({c[0] + x, c[1] + y, c[2] + z});
}

template <class T, int D>
void Grid<T, D>::clear(T* values) const {
  constexpr std::size_t block_bytes = block_nodes * 4 * sizeof(T);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks(), 256), [&](const auto& r) {
    std::memset(static_cast<void*>(values + r.begin() * block_nodes * 4), 0, r.size() * block_bytes);
  });
}

template <class T, int D>
std::size_t Grid<T, D>::node_index(const Index3& c) const {
  BlockCoordinate block{0, 0, 0};
  std::size_t inside = 0;
  for (int a = 0; a < D; a++) {
    block[a] = floor_divide(c[a], edge);
    inside = inside * edge + std::size_t(c[a] - block[a] * edge);
  }
  const std::uint32_t b = find(block);
  return b == BlockDirectory::none ? ~std::size_t(0) : b * std::size_t(block_nodes) + inside;
}

template class Grid<float, 2>;
template class Grid<float, 3>;
template class Grid<double, 2>;
template class Grid<double, 3>;

}  // namespace cleave::mpm
