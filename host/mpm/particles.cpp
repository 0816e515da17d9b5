#include "mpm/particles.hpp"

#include "common/error.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>

namespace cleave::mpm {

TileLayout::TileLayout(const Needs& needs) : stores_b(needs.stores_b), state_components(needs.state_components) {
  const int dimension = needs.dimension;
  const auto add = [&](const char* name, int components) {
    const std::uint32_t at = stride;
    if (components) parts.push_back({name, components});
    stride += std::uint32_t(components) * CLEAVE_TILE_BYTES;
    return at;
  };
  position = add("position", dimension);
  velocity = add("velocity", dimension);
  affine = add("velocity gradient", dimension * dimension);
  volume = add("rest volume", 1);
  if (stores_b)
    strain = add("left Cauchy-Green tensor b", dimension == 3 ? 6 : 4);
  else
    strain = add("deformation gradient F", dimension == 3 ? 9 : 5);
  if (needs.fibers > 0) fiber = add("fibre", 3);
  if (needs.fibers > 1) second_fiber = add("second fibre", 3);
  if (needs.damage) damage = add("damage", 1);
  if (needs.toughness) toughness = add("toughness factor", 1);
  if (state_components > 0) state = add("state variables", state_components);
}

namespace {

/// Stored components of a strain tensor as (row, column) pairs.
template <int D>
const std::vector<std::pair<int, int>>& strain_components(bool b) {
  static const std::vector<std::pair<int, int>> of_b =
      D == 3 ? std::vector<std::pair<int, int>>{{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}}
             : std::vector<std::pair<int, int>>{{0, 0}, {1, 1}, {2, 2}, {0, 1}};
  static const std::vector<std::pair<int, int>> of_F =
      D == 3 ? std::vector<std::pair<int, int>>{{0, 0}, {0, 1}, {0, 2}, {1, 0}, {1, 1}, {1, 2}, {2, 0}, {2, 1}, {2, 2}}
             : std::vector<std::pair<int, int>>{{0, 0}, {0, 1}, {1, 0}, {1, 1}, {2, 2}};
  return b ? of_b : of_F;
}

struct Home {
  BlockCoordinate block{0, 0, 0};
  std::uint8_t cell = 0;
};

/// Block and cell of a position, given in cells from node 0 of `origin`.
template <int D, class T>
Home home_of(const T* x, const BlockCoordinate& origin) {
  constexpr int edge = GridShape<D>::block_edge;
  Home h;
  int cell = 0;
  for (int a = 0; a < D; a++) {
    const double base = std::floor(double(x[a]) - 0.5);
    if (!(std::abs(base) < 8.0 * farthest_block))
      throw SimulationError("a particle is no longer anywhere (position not finite)");
    const std::int64_t block = std::int64_t(std::floor(base / edge));
    const std::int64_t coordinate = origin[a] + block;
    if (coordinate > farthest_block || coordinate < -farthest_block)
      throw SimulationError("a particle has left the range of the grid, about four million cells from the origin");
    h.block[a] = std::int32_t(coordinate);
    cell = cell * edge + int(std::int64_t(base) - block * edge);
  }
  h.cell = std::uint8_t(cell);
  return h;
}

}  // namespace

template <class T, int D>
void Particles<T, D>::colour() {
  for (auto& c : colours_) c.clear();
  for (std::uint32_t i = 0; i < blocks_.size(); i++) {
    const auto& c = blocks_[i].coordinate;
    colours_[std::size_t((c[0] & 1) * 4 + (c[1] & 1) * 2 + (c[2] & 1))].push_back(i);
  }
}

template <class T, int D>
void Particles<T, D>::place(std::size_t tiles) {
  tiles_ = tiles;
  storage_.reserve(tiles * layout_.stride);
  ids_.resize(tiles * lanes);
}

template <class T, int D>
void Particles<T, D>::assign(const std::vector<NewParticle>& particles, const std::vector<double>& state,
                             const std::vector<double>& fibers) {
  size_ = particles.size();
  struct Key {
    std::uint64_t block;
    std::uint32_t cell, index;
    BlockCoordinate coordinate;
  };
  std::vector<Key> keys(particles.size());
  tbb::parallel_for(std::size_t(0), particles.size(), [&](std::size_t i) {
    const Home h = home_of<D>(particles[i].position.data(), {0, 0, 0});
    keys[i] = {morton_key(h.block), h.cell, std::uint32_t(i), h.block};
  });
  tbb::parallel_sort(keys.begin(), keys.end(), [](const Key& a, const Key& b) {
    return std::tie(a.block, a.cell, a.index) < std::tie(b.block, b.cell, b.index);
  });
  blocks_.clear();
  std::vector<std::size_t> first_key;
  std::size_t tiles = 0;
  for (std::size_t i = 0; i < keys.size();) {
    std::size_t j = i;
    while (j < keys.size() && keys[j].block == keys[i].block) j++;
    Block b{};
    b.coordinate = keys[i].coordinate;
    b.first_tile = tiles;
    b.count = std::uint32_t(j - i);
    blocks_.push_back(b);
    first_key.push_back(i);
    tiles += (j - i + lanes - 1) / lanes;
    i = j;
  }
  place(tiles);
  const auto& strain = strain_components<D>(layout_.stores_b);
  const int n_fiber = (layout_.fiber ? 3 : 0) + (layout_.second_fiber ? 3 : 0), n_state = layout_.state_components;
  tbb::parallel_for(std::size_t(0), blocks_.size(), [&](std::size_t k) {
    const Block& b = blocks_[k];
    const std::uint32_t padded = (b.count + lanes - 1) / lanes * lanes;
    for (std::uint32_t i = 0; i < padded; i++) {
      const std::uint32_t index = keys[first_key[k] + std::min(i, b.count - 1)].index;
      const NewParticle& p = particles[index];
      const std::uint64_t slot = b.first_tile * lanes + i;
      ids_[slot] = p.id;
      for (int a = 0; a < D; a++) {
        value(layout_.position, a, slot) = T(p.position[a] - double(b.coordinate[a]) * edge);
        value(layout_.velocity, a, slot) = T(p.velocity[a]);
      }
      for (int c = 0; c < D * D; c++) value(layout_.affine, c, slot) = T(p.velocity_gradient(c / D, c % D));
      value(layout_.volume, slot) = i < b.count ? T(p.volume) : T(0);
      const Matrix3 m = layout_.stores_b ? Matrix3(p.deformation * p.deformation.transpose()) : p.deformation;
      for (std::size_t c = 0; c < strain.size(); c++)
        value(layout_.strain, int(c), slot) = T(m(strain[c].first, strain[c].second));
      if (layout_.damage) value(layout_.damage, slot) = T(p.damage);
      if (layout_.toughness) value(layout_.toughness, slot) = T(p.toughness);
      for (int c = 0; c < n_fiber; c++) value(layout_.fiber, c, slot) = T(fibers[index * n_fiber + c]);
      for (int c = 0; c < n_state; c++) value(layout_.state, c, slot) = T(state[index * n_state + c]);
    }
  });
  colour();
}

template <class T, int D>
void Particles<T, D>::sort() {
  // 1. Each old block groups its particles by the block they are in.
  struct Target {
    std::uint64_t key;
    BlockCoordinate coordinate;
    std::uint32_t source, first, count;  // order[first .. first+count) of the source block
  };
  std::vector<std::vector<Target>> targets(blocks_.size());
  auto& order = order_;
  auto& cell = cell_;
  order.resize(tiles_ * lanes);
  cell.resize(tiles_ * lanes);
  tbb::parallel_for(std::size_t(0), blocks_.size(), [&](std::size_t k) {
    const Block& b = blocks_[k];
    auto& list = targets[k];
    thread_local std::vector<std::uint32_t> group;
    group.resize(b.count);
    const std::uint64_t base = b.first_tile * lanes;
    std::uint32_t last = 0;
    for (std::uint32_t i = 0; i < b.count; i++) {
      T x[D];
      for (int a = 0; a < D; a++) x[a] = value(layout_.position, a, base + i);
      const Home h = home_of<D>(x, b.coordinate);
      cell[base + i] = h.cell;
      if (last >= list.size() || list[last].coordinate != h.block) {
        for (last = 0; last < list.size() && list[last].coordinate != h.block;) last++;
        if (last == list.size()) list.push_back({morton_key(h.block), h.block, std::uint32_t(k), 0, 0});
      }
      group[i] = last;
      list[last].count++;
    }
    std::uint32_t at = 0;
    for (auto& t : list) {
      t.first = at;
      at += t.count;
      t.count = 0;
    }
    for (std::uint32_t i = 0; i < b.count; i++) {
      Target& t = list[group[i]];
      order[base + t.first + t.count++] = i;
    }
  });

  // 2. Number the new blocks.
  std::vector<Target> all;
  for (const auto& list : targets) all.insert(all.end(), list.begin(), list.end());
  tbb::parallel_sort(all.begin(), all.end(),
                     [](const Target& a, const Target& b) { return std::tie(a.key, a.source) < std::tie(b.key, b.source); });
  std::vector<Block> blocks;
  std::vector<std::size_t> first_target;
  std::size_t tiles = 0;
  for (std::size_t i = 0; i < all.size();) {
    Block b{};
    b.coordinate = all[i].coordinate;
    b.first_tile = tiles;
    first_target.push_back(i);
    std::size_t j = i;
    for (; j < all.size() && all[j].key == all[i].key; j++) b.count += all[j].count;
    tiles += (b.count + lanes - 1) / lanes;
    blocks.push_back(b);
    i = j;
  }
  first_target.push_back(all.size());

  // 3. Each new block collects its particles, by cell.
  sorted_.reserve(tiles * layout_.stride);
  sorted_ids_.resize(tiles * lanes);
  const int components = int(layout_.stride / CLEAVE_TILE_BYTES);
  tbb::parallel_for(std::size_t(0), blocks.size(), [&](std::size_t k) {
    const Block& b = blocks[k];
    std::array<std::uint32_t, 65> start{};
    thread_local std::vector<std::uint64_t> from;
    thread_local std::vector<std::uint32_t> via;
    from.resize(b.count);
    via.resize(b.count);
    for (std::size_t t = first_target[k]; t < first_target[k + 1]; t++) {
      const std::uint64_t base = blocks_[all[t].source].first_tile * lanes;
      for (std::uint32_t i = 0; i < all[t].count; i++) start[cell[base + order[base + all[t].first + i]] + 1u]++;
    }
    std::partial_sum(start.begin(), start.end(), start.begin());
    for (std::size_t t = first_target[k]; t < first_target[k + 1]; t++) {
      const std::uint64_t base = blocks_[all[t].source].first_tile * lanes;
      for (std::uint32_t i = 0; i < all[t].count; i++) {
        const std::uint64_t slot = base + order[base + all[t].first + i];
        const std::uint32_t at = start[cell[slot]]++;
        from[at] = slot;
        via[at] = std::uint32_t(t);
      }
    }
    const std::uint32_t n_tiles = (b.count + lanes - 1) / lanes;
    for (std::uint32_t t = 0; t < n_tiles; t++) {
      const T* source[lanes];
      T shift[D][lanes];
      for (int l = 0; l < lanes; l++) {
        const std::uint32_t i = std::min(t * lanes + l, b.count - 1);
        const std::uint64_t slot = from[i];
        source[l] = reinterpret_cast<const T*>(storage_.data() + (slot / lanes) * layout_.stride) + slot % lanes;
        const auto& old = blocks_[all[via[i]].source].coordinate;
        for (int a = 0; a < D; a++) shift[a][l] = T((old[a] - b.coordinate[a]) * edge);
        sorted_ids_[(b.first_tile + t) * lanes + l] = ids_[slot];
      }
      T* to = reinterpret_cast<T*>(sorted_.data() + (b.first_tile + t) * layout_.stride);
      for (int c = 0; c < components; c++)
        for (int l = 0; l < lanes; l++) to[c * lanes + l] = source[l][c * lanes];
      T* position = to + layout_.position / sizeof(T);
      for (int a = 0; a < D; a++)
        for (int l = 0; l < lanes; l++) position[a * lanes + l] += shift[a][l];
      T* volume = to + layout_.volume / sizeof(T);
      for (std::uint32_t l = b.count - t * lanes; l < std::uint32_t(lanes); l++) volume[l] = 0;
    }
  });
  std::swap(storage_, sorted_);
  std::swap(ids_, sorted_ids_);
  blocks_ = std::move(blocks);
  tiles_ = tiles;
  colour();
}

template <class T, int D>
const typename Particles<T, D>::Block* Particles<T, D>::block_of(std::uint64_t slot) const {
  const auto it = std::upper_bound(blocks_.begin(), blocks_.end(), slot / lanes,
                                   [](std::uint64_t tile, const Block& b) { return tile < b.first_tile; });
  return it == blocks_.begin() ? nullptr : &*(it - 1);
}

template <class T, int D>
Matrix3 Particles<T, D>::deformation_or_b(std::uint64_t slot) const {
  Matrix3 m = Matrix3::Zero();
  const auto& strain = strain_components<D>(layout_.stores_b);
  for (std::size_t c = 0; c < strain.size(); c++) {
    m(strain[c].first, strain[c].second) = double(value(layout_.strain, int(c), slot));
    if (layout_.stores_b) m(strain[c].second, strain[c].first) = m(strain[c].first, strain[c].second);
  }
  return m;
}

template <class T, int D>
double Particles<T, D>::jacobian(std::uint64_t slot) const {
  const double det = deformation_or_b(slot).determinant();
  return layout_.stores_b ? std::sqrt(std::max(det, 0.0)) : det;
}

template class Particles<float, 2>;
template class Particles<float, 3>;
template class Particles<double, 2>;
template class Particles<double, 3>;

}  // namespace cleave::mpm
