#include "mpm/handles.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <tuple>
#include <utility>

namespace cleave::mpm {

namespace {
constexpr std::size_t colours = 8;
}

template <class T, int D>
void Handles<T, D>::assign(std::vector<std::uint16_t> handle_of_id) {
  handle_of_id_ = std::move(handle_of_id);
  any_ = std::any_of(handle_of_id_.begin(), handle_of_id_.end(), [](auto h) { return h != none; });
}

template <class T, int D>
void Handles<T, D>::prepare(const std::vector<Particles<T, D>*>& sets) {
  constexpr std::uint64_t lanes = Particles<T, D>::lanes;
  members_.assign(sets.size(), {});
  reached_.assign(handles_.size(), {});
  for (std::size_t s = 0; s < sets.size(); s++) {
    const auto& set = *sets[s];
    const auto& blocks = set.blocks();
    auto& [slots, runs, begin] = members_[s];
    std::vector<std::vector<Run>> found(blocks.size());
    tbb::parallel_for(std::size_t(0), blocks.size(), [&](std::size_t b) {
      const auto& c = blocks[b].coordinate;
      const auto colour = std::uint16_t((c[0] & 1) * 4 + (c[1] & 1) * 2 + (c[2] & 1));
      for (std::uint32_t i = 0; i < blocks[b].count; i++) {
        const std::uint16_t h = handle_of_id_[set.id(blocks[b].first_tile * lanes + i)];
        if (h == none) continue;
        auto run = std::find_if(found[b].begin(), found[b].end(), [&](const Run& r) { return r.handle == h; });
        if (run == found[b].end()) run = found[b].insert(run, {h, colour, std::uint32_t(b), 0, 0});
        run->count++;
      }
    });
    for (const auto& list : found) runs.insert(runs.end(), list.begin(), list.end());
    std::sort(runs.begin(), runs.end(), [](const Run& a, const Run& b) {
      return std::tie(a.handle, a.colour, a.block) < std::tie(b.handle, b.colour, b.block);
    });
    std::uint32_t members = 0;
    begin.assign(handles_.size() * colours + 1, 0);
    for (Run& run : runs) {
      run.first = std::exchange(members, members + run.count);
      begin[run.handle * colours + run.colour + 1]++;
      const auto& neighbours = blocks[run.block].neighbours;
      reached_[run.handle].insert(reached_[run.handle].end(), neighbours, neighbours + GridShape<D>::neighbours);
    }
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    slots.resize(members);
    tbb::parallel_for(std::size_t(0), runs.size(), [&](std::size_t r) {
      const auto& block = blocks[runs[r].block];
      auto slot = slots.begin() + runs[r].first;
      for (std::uint32_t i = 0; i < block.count; i++)
        if (const std::uint64_t at = block.first_tile * lanes + i; handle_of_id_[set.id(at)] == runs[r].handle) *slot++ = at;
    });
  }
  for (auto& grid : reached_) {
    std::sort(grid.begin(), grid.end());
    grid.erase(std::unique(grid.begin(), grid.end()), grid.end());
  }
}

/// In an arena of the nodes that the particles of a block reach, -1 to edge + 2, which is merged with the grid once.
template <class T, int D>
void Handles<T, D>::add_mass(const Particles<T, D>& set, const Members& members, const Run& run, double density) {
  constexpr int edge = GridShape<D>::block_edge, width = edge + 4, last = D == 3 ? 3 : 1;
  const TileLayout& l = set.layout();
  const auto& block = set.blocks()[run.block];
  double arena[D == 3 ? width * width * width : width * width] = {};
  for (std::uint32_t i = run.first; i < run.first + run.count; i++) {
    const std::uint64_t slot = members.slots[i];
    const double m_p = double(set.value(l.volume, slot)) * density;
    int base = 0;
    double w[3][3] = {{1, 0, 0}, {1, 0, 0}, {1, 0, 0}};
    for (int a = 0; a < D; a++) {
      const double x = double(set.value(l.position, a, slot)), first = std::floor(x - 0.5), q = x - first - 1;
      base = base * width + int(first) + 1;
      w[a][0] = 0.5 * (0.5 - q) * (0.5 - q);
      w[a][1] = 0.75 - q * q;
      w[a][2] = 0.5 * (0.5 + q) * (0.5 + q);
    }
    for (int a = 0; a < 3; a++)
      for (int b = 0; b < 3; b++)
        for (int c = 0; c < last; c++)
          arena[base + (D == 3 ? (a * width + b) * width + c : a * width + b)] += m_p * w[0][a] * w[1][b] * w[2][c];
  }
  for (int n = 0; n < int(std::size(arena)); n++) {
    if (arena[n] == 0) continue;
    int neighbour = 0, inside = 0;
    for (int a = 0, rest = n, weight = int(std::size(arena)) / width; a < D; a++, rest %= weight, weight /= width) {
      const int x = rest / weight - 1 + edge;  // counted from the first node of the block before
      neighbour = neighbour * 3 + x / edge;
      inside = inside * edge + x % edge;
    }
    mass_[std::size_t(block.neighbours[neighbour]) * GridShape<D>::block_nodes + std::size_t(inside)] += float(arena[n]);
  }
}

template <class T, int D>
void Handles<T, D>::apply(Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets,
                          const std::vector<double>& densities, double time, double time_step,
                          std::vector<HeldNode>* held_nodes) {
  constexpr std::size_t nodes = GridShape<D>::block_nodes;
  mass_.resize(grid.nodes(), 0.f);
  for (std::uint16_t h = 0; h < handles_.size(); h++) {
    if (!active(h, time)) continue;
    // Blocks of one colour reach disjoint nodes; sets and colours follow each other, so that sums have one order.
    for (std::size_t s = 0; s < sets.size(); s++)
      for (std::size_t c = h * colours; c < (h + 1u) * colours; c++)
        tbb::parallel_for(tbb::blocked_range(members_[s].begin[c], members_[s].begin[c + 1], 4), [&](const auto& range) {
          for (std::size_t r = range.begin(); r < range.end(); r++)
            add_mass(*sets[s], members_[s], members_[s].runs[r], densities[s]);
        });
    // velocity that carries a point exactly from its pose before the step to the one after
    const auto before = handles_[h].motion.at(time), after = handles_[h].motion.at(time + time_step);
    const auto prescribe = [&](const tbb::blocked_range<std::size_t>& range, std::vector<HeldNode> held) {
      for (std::size_t b = range.begin(); b < range.end(); b++)
        for (std::size_t n = reached_[h][b] * nodes, end = n + nodes; n < end; n++) {
          const float mass = std::exchange(mass_[n], 0.f);
          T* const node = grid.node(n);
          if (!(mass > 0) || !(mass >= 0.5f * float(node[0]))) continue;
          const Vector3 x = grid.node_coordinates(n).template cast<double>() * cell_size_;
          const Vector3 v = (after.to_world(before.to_scene(x)) - x) / time_step;
          for (int a = 0; a < D; a++) node[1 + a] = T(v[a]);
          if (held_nodes) held.push_back({n, Vector3::Zero()});
        }
      return held;
    };
    const auto joined = [](std::vector<HeldNode> first, const std::vector<HeldNode>& second) {
      first.insert(first.end(), second.begin(), second.end());
      return first;
    };
    const auto held = tbb::parallel_reduce(tbb::blocked_range<std::size_t>(0, reached_[h].size(), 16), std::vector<HeldNode>(),
                                           prescribe, joined);
    if (held_nodes) held_nodes->insert(held_nodes->end(), held.begin(), held.end());
  }
}

template <class T, int D>
std::vector<std::vector<Vector3>> Handles<T, D>::positions(const std::vector<const Particles<T, D>*>& sets) const {
  std::vector<std::vector<Vector3>> all(sets.size());
  for (std::size_t s = 0; s < sets.size(); s++) {
    if (!sets[s]) continue;
    const auto& [slots, runs, begin] = members_[s];
    all[s].resize(slots.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, runs.size(), 4), [&, &slots = slots, &runs = runs](const auto& range) {
      for (std::size_t r = range.begin(); r < range.end(); r++)
        for (std::uint32_t i = runs[r].first; i < runs[r].first + runs[r].count; i++)
          all[s][i] = sets[s]->position(sets[s]->blocks()[runs[r].block], slots[i]);
    });
  }
  return all;
}

template <class T, int D>
bool Handles<T, D>::move(const std::vector<Particles<T, D>*>& sets, const std::vector<std::vector<Vector3>>& positions_before,
                         double time, double time_step) const {
  constexpr int edge = GridShape<D>::block_edge;
  std::vector<scene::RigidMotion::Pose> before, after;
  for (const auto& h : handles_) {
    before.push_back(h.motion.at(time));
    after.push_back(h.motion.at(time + time_step));
  }
  bool any_strayed = false;
  for (std::size_t s = 0; s < sets.size(); s++) {
    if (!sets[s]) continue;
    const auto& set = *sets[s];
    const auto& members = members_[s];
    const auto move_run = [&](const Run& run) {
      bool strayed = false;
      const auto& origin = set.blocks()[run.block].coordinate;
      for (std::uint32_t i = run.first; i < run.first + run.count; i++) {
        const std::uint64_t slot = members.slots[i];
        const Vector3 x = positions_before[s][i] * cell_size_;
        const Vector3 moved = after[run.handle].to_world(before[run.handle].to_scene(x));
        for (int a = 0; a < D; a++) {
          const double local = moved[a] / cell_size_ - double(origin[a]) * edge;
          set.value(set.layout().position, a, slot) = T(local);
          set.value(set.layout().velocity, a, slot) = T((moved[a] - x[a]) / time_step);
          strayed = strayed || T(local) < T(-0.5) || T(local) >= T(edge + 1.5);
        }
      }
      return strayed;
    };
    any_strayed = tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, members.runs.size(), 4), any_strayed,
        [&](const auto& range, bool strayed) {
          for (std::size_t r = range.begin(); r < range.end(); r++)
            if (active(members.runs[r].handle, time)) strayed = move_run(members.runs[r]) || strayed;
          return strayed;
        },
        std::logical_or<>());
  }
  return any_strayed;
}

template <class T, int D>
double Handles<T, D>::maximum_speed(double time) const {
  double fastest = 0;
  for (const auto& h : handles_)
    if (time < h.release) fastest = std::max(fastest, h.motion.at(time).velocity.norm());
  return fastest;
}

template class Handles<float, 2>;
template class Handles<float, 3>;
template class Handles<double, 2>;
template class Handles<double, 3>;

}  // namespace cleave::mpm
