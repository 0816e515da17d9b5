#include "mpm/sampling_gaps.hpp"

#include <tbb/parallel_for.h>

#include <array>
#include <atomic>
#include <cmath>

namespace cleave::mpm {

namespace {

/// Cells by the block and the number of the node at their low corner.
template <class T, int D>
class Cells {
 public:
  Cells(const Grid<T, D>& grid) : filled_(grid.blocks()) {}

  struct Place {
    std::uint32_t block;
    int number;
  };
  /// `c` counts from the first node of the home block, and is at most `edge` cells away from it.
  static Place place(const BlockView& home, const std::array<int, 3>& c) {
    constexpr int edge = GridShape<D>::block_edge;
    int neighbour = 0, number = 0;
    for (int a = 0; a < D; a++) {
      const int offset = c[std::size_t(a)] < 0 ? -1 : c[std::size_t(a)] >= edge ? 1 : 0;
      neighbour = neighbour * 3 + offset + 1;
      number = number * edge + c[std::size_t(a)] - offset * edge;
    }
    return {home.neighbours[neighbour], number};
  }
  void fill(const Place& p) { filled_[p.block].fetch_or(std::uint64_t(1) << p.number, std::memory_order_relaxed); }
  bool filled(const Place& p) const { return filled_[p.block].load(std::memory_order_relaxed) >> p.number & 1; }

 private:
  std::vector<std::atomic<std::uint64_t>> filled_;
};

template <class T, int D>
std::array<int, 3> cell_of(const Particles<T, D>& set, std::uint64_t slot) {
  // What has strayed farther than its neighbourhood counts at the rim of it until particles are sorted again.
  constexpr double low = 2 - GridShape<D>::block_edge, high = 2 * GridShape<D>::block_edge - 3;
  std::array<int, 3> c{};
  for (int a = 0; a < D; a++) {
    const double x = double(set.value(set.layout().position, a, slot));
    c[std::size_t(a)] = int(std::floor(x > low ? (x < high ? x : high) : low));
  }
  return c;
}

}  // namespace

template <class T, int D>
std::int64_t under_sampled(const Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets) {
  static_assert(GridShape<D>::block_nodes == 64, "a bit for each cell of a block");
  Cells<T, D> cells(grid);
  const auto for_blocks = [](const Particles<T, D>& set, const auto& work) {
    tbb::parallel_for(std::size_t(0), set.blocks().size(), [&](std::size_t i) {
      const auto& block = set.blocks()[i];
      for (std::uint32_t p = 0; p < block.count; p++) work(i, block, block.first_tile * Particles<T, D>::lanes + p);
    });
  };
  for (const auto* set : sets)
    for_blocks(*set, [&](std::size_t, const BlockView& block, std::uint64_t slot) {
      cells.fill(cells.place(block, cell_of(*set, slot)));
    });
  std::int64_t total = 0;
  for (const auto* set : sets) {
    std::vector<std::int64_t> counts(set->blocks().size(), 0);
    const auto& layout = set->layout();
    for_blocks(*set, [&](std::size_t i, const BlockView& block, std::uint64_t slot) {
      if (layout.damage && double(set->value(layout.damage, slot)) > 0.5) return;
      const auto c = cell_of(*set, slot);
      for (std::size_t a = 0; a < D; a++) {
        const auto filled = [&](int offset) {
          auto beside = c;
          beside[a] += offset;
          return cells.filled(cells.place(block, beside));
        };
        const bool before = filled(-1), after = filled(1);
        if ((!before && (!after || filled(-2))) || (!after && filled(2))) {
          counts[i]++;
          return;
        }
      }
    });
    for (const auto n : counts) total += n;
  }
  return total;
}

template std::int64_t under_sampled(const Grid<float, 2>&, const std::vector<const Particles<float, 2>*>&);
template std::int64_t under_sampled(const Grid<float, 3>&, const std::vector<const Particles<float, 3>*>&);
template std::int64_t under_sampled(const Grid<double, 2>&, const std::vector<const Particles<double, 2>*>&);
template std::int64_t under_sampled(const Grid<double, 3>&, const std::vector<const Particles<double, 3>*>&);

}  // namespace cleave::mpm
