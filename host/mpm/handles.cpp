#include "mpm/handles.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cleave::mpm {

template <class T, int D>
void Handles<T, D>::assign(std::vector<std::uint16_t> handle_of_id) {
  handle_of_id_ = std::move(handle_of_id);
  any_ = std::any_of(handle_of_id_.begin(), handle_of_id_.end(), [](auto h) { return h != none; });
}

template <class T, int D>
void Handles<T, D>::prepare(const std::vector<Particles<T, D>*>& sets) {
  members_.assign(sets.size(), {});
  for (std::size_t s = 0; s < sets.size(); s++) {
    const auto& blocks = sets[s]->blocks();
    for (std::uint32_t b = 0; b < blocks.size(); b++)
      for (std::uint32_t i = 0; i < blocks[b].count; i++) {
        const std::uint64_t slot = blocks[b].first_tile * Particles<T, D>::lanes + i;
        const std::uint16_t h = handle_of_id_[sets[s]->id(slot)];
        if (h != none) members_[s].push_back({slot, b, h});
      }
  }
}

template <class T, int D>
void Handles<T, D>::apply(Grid<T, D>& grid, const std::vector<const Particles<T, D>*>& sets,
                          const std::vector<double>& densities, double time, double time_step,
                          std::vector<HeldNode>* held_nodes) {
  constexpr int edge = GridShape<D>::block_edge, nodes = GridShape<D>::block_nodes, last = D == 3 ? 3 : 1;
  mass_.resize(grid.nodes(), 0.f);
  for (std::uint16_t h = 0; h < handles_.size(); h++) {
    if (!active(h, time)) continue;
    touched_.clear();
    for (std::size_t s = 0; s < sets.size(); s++) {
      const auto& set = *sets[s];
      const TileLayout& l = set.layout();
      for (const auto& m : members_[s]) {
        if (m.handle != h) continue;
        const auto& block = set.blocks()[m.block];
        const double m_p = double(set.value(l.volume, m.slot)) * densities[s];
        int base[3] = {0, 0, 0};  // counted from the first node of the block before
        double w[3][3] = {{1, 0, 0}, {1, 0, 0}, {1, 0, 0}};
        for (int a = 0; a < D; a++) {
          const double x = double(set.value(l.position, a, m.slot)), q = x - std::floor(x - 0.5) - 1;
          base[a] = int(std::floor(x - 0.5)) + edge;
          w[a][0] = 0.5 * (0.5 - q) * (0.5 - q);
          w[a][1] = 0.75 - q * q;
          w[a][2] = 0.5 * (0.5 + q) * (0.5 + q);
        }
        for (int i = 0; i < 3; i++)
          for (int j = 0; j < 3; j++)
            for (int k = 0; k < last; k++) {
              const int x = base[0] + i, y = base[1] + j, z = base[2] + k;
              const int neighbour = D == 3 ? (x / edge) * 9 + (y / edge) * 3 + z / edge : (x / edge) * 3 + y / edge;
              const int inside = D == 3 ? ((x % edge) * edge + y % edge) * edge + z % edge : (x % edge) * edge + y % edge;
              const std::size_t n = std::size_t(block.neighbours[neighbour]) * nodes + std::size_t(inside);
              if (mass_[n] == 0) touched_.push_back(n);
              mass_[n] += float(m_p * w[0][i] * w[1][j] * w[2][k]);
            }
      }
    }
    // velocity that carries a point exactly from its pose before the step to the one after
    const auto before = handles_[h].motion.at(time), after = handles_[h].motion.at(time + time_step);
    for (const std::size_t n : touched_) {
      T* node = grid.node(n);
      const float held = std::exchange(mass_[n], 0.f);
      if (!(held >= 0.5f * float(node[0]))) continue;
      const Vector3 x = grid.node_coordinates(n).template cast<double>() * cell_size_;
      const Vector3 v = (after.to_world(before.to_scene(x)) - x) / time_step;
      for (int a = 0; a < D; a++) node[1 + a] = T(v[a]);
      if (held_nodes) held_nodes->push_back({n, Vector3::Zero()});
    }
  }
}

template <class T, int D>
std::vector<std::vector<Vector3>> Handles<T, D>::positions(const std::vector<const Particles<T, D>*>& sets) const {
  std::vector<std::vector<Vector3>> all(sets.size());
  for (std::size_t s = 0; s < sets.size(); s++)
    for (const auto& m : members_[s]) all[s].push_back(sets[s]->position(sets[s]->blocks()[m.block], m.slot));
  return all;
}

template <class T, int D>
bool Handles<T, D>::move(const std::vector<Particles<T, D>*>& sets, const std::vector<std::vector<Vector3>>& positions_before,
                         double time, double time_step) const {
  constexpr int edge = GridShape<D>::block_edge;
  bool strayed = false;
  std::vector<scene::RigidMotion::Pose> before, after;
  for (const auto& h : handles_) {
    before.push_back(h.motion.at(time));
    after.push_back(h.motion.at(time + time_step));
  }
  for (std::size_t s = 0; s < sets.size(); s++) {
    auto& set = *sets[s];
    for (std::size_t i = 0; i < members_[s].size(); i++) {
      const auto& m = members_[s][i];
      if (!active(m.handle, time)) continue;
      const Vector3 x = positions_before[s][i] * cell_size_;
      const Vector3 moved = after[m.handle].to_world(before[m.handle].to_scene(x));
      const auto& origin = set.blocks()[m.block].coordinate;
      for (int a = 0; a < D; a++) {
        const double local = moved[a] / cell_size_ - double(origin[a]) * edge;
        set.value(set.layout().position, a, m.slot) = T(local);
        set.value(set.layout().velocity, a, m.slot) = T((moved[a] - x[a]) / time_step);
        strayed = strayed || T(local) < T(-0.5) || T(local) >= T(edge + 1.5);
      }
    }
  }
  return strayed;
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
