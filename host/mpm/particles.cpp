#include "mpm/particles.hpp"

#include "common/error.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>
#include <span>

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

/// Compared for every particle: std::array would call memcmp.
inline bool same(const BlockCoordinate& a, const BlockCoordinate& b) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2]; }

/// Block and cell of a position, given in cells from node 0 of `origin`.
template <int D, class T>
Home home_of(const T* x, const BlockCoordinate& origin) {
  constexpr int edge = GridShape<D>::block_edge, shift = std::countr_zero(unsigned(edge));
  Home h;
  int cell = 0;
  for (int a = 0; a < D; a++) {
    const double first = double(x[a]) - 0.5;
    if (!(std::abs(first) < 8.0 * farthest_block))
      throw SimulationError("a particle is no longer anywhere (position not finite)");
    std::int32_t base = std::int32_t(first);
    base -= first < base;  // the cast rounds towards zero
    const std::int32_t coordinate = origin[a] + (base >> shift);
    if (coordinate > farthest_block || coordinate < -farthest_block)
      throw SimulationError("a particle has left the range of the grid, about four million cells from the origin");
    h.block[a] = coordinate;
    cell = cell * edge + (base & (edge - 1));
  }
  h.cell = std::uint8_t(cell);
  return h;
}

/// Scratch up to this is kept for the next time: of more, new pages cost little beside the sorting.
constexpr std::size_t kept_scratch = std::size_t(32) << 20;

/// Places in a sequence of n that are visited together.
constexpr std::size_t stretch = 256;
template <class F>
void for_stretches(std::size_t n, F&& f) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, n, stretch), [&](const auto& range) { f(range.begin(), range.end()); });
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
  if (tiles > (std::uint64_t(1) << 32) / lanes) throw SimulationError("more than four billion places for particles are needed");
  storage_.extend(tiles * layout_.stride);
  ids_.extend(tiles * lanes * sizeof(std::uint32_t));
  tiles_ = tiles;
}

template <class T, int D>
void Particles<T, D>::assign(const std::vector<NewParticle>& particles, const std::vector<double>& state,
                             const std::vector<double>& fibers) {
  const std::size_t n_fiber = (layout_.fiber ? 3 : 0) + (layout_.second_fiber ? 3 : 0);
  const auto n_state = std::size_t(layout_.state_components);
  assign({particles.size(), [&](std::size_t i) { return particles[i].position; },
          [&](std::size_t i, double* s, double* f) {
            std::copy_n(state.begin() + std::ptrdiff_t(i * n_state), n_state, s);
            std::copy_n(fibers.begin() + std::ptrdiff_t(i * n_fiber), n_fiber, f);
            return particles[i];
          }});
}

template <class T, int D>
void Particles<T, D>::assign(const NewParticles& particles) {
  size_ = particles.count;
  // 1. Number the blocks as they are met, then in Morton order.
  struct Met {
    std::uint64_t key;
    std::uint32_t number, count;
    BlockCoordinate coordinate;
  };
  std::vector<Met> met;
  std::vector<std::uint32_t> block_of(size_), order(size_);
  BlockDirectory directory;
  directory.reset(size_ / 256);
  for (std::size_t i = 0; i < size_; i++) {
    const BlockCoordinate c = home_of<D>(particles.position(i).data(), {0, 0, 0}).block;
    if (i == 0 || c != met[block_of[i - 1]].coordinate) {
      const std::uint64_t key = morton_key(c);
      block_of[i] = directory.insert(key, std::uint32_t(met.size()));
      if (block_of[i] == met.size()) met.push_back({key, block_of[i], 0, c});
    } else {
      block_of[i] = block_of[i - 1];
    }
    met[block_of[i]].count++;
  }
  std::sort(met.begin(), met.end(), [](const Met& a, const Met& b) { return a.key < b.key; });
  blocks_.clear();
  std::vector<std::uint32_t> first(met.size() + 1, 0), next(met.size());
  std::size_t tiles = 0;
  for (std::size_t k = 0; k < met.size(); k++) {
    Block b{};
    b.coordinate = met[k].coordinate;
    b.first_tile = tiles;
    b.count = met[k].count;
    blocks_.push_back(b);
    tiles += (b.count + lanes - 1) / lanes;
    first[k + 1] = first[k] + b.count;
    next[met[k].number] = first[k];
  }
  for (std::size_t i = 0; i < size_; i++) order[next[block_of[i]]++] = std::uint32_t(i);
  std::vector<std::uint32_t>().swap(block_of);

  // 2. Each block takes its particles, by cell.
  place(tiles);
  const auto& strain = strain_components<D>(layout_.stores_b);
  const int n_fiber = (layout_.fiber ? 3 : 0) + (layout_.second_fiber ? 3 : 0), n_state = layout_.state_components;
  tbb::parallel_for(std::size_t(0), blocks_.size(), [&](std::size_t k) {
    const Block& b = blocks_[k];
    thread_local std::vector<std::pair<std::uint8_t, std::uint32_t>> members;
    thread_local std::vector<double> state, fibers;
    members.clear();
    for (std::uint32_t i = first[k]; i < first[k + 1]; i++)
      members.emplace_back(home_of<D>(particles.position(order[i]).data(), {0, 0, 0}).cell, order[i]);
    std::sort(members.begin(), members.end());
    state.resize(std::size_t(n_state));
    fibers.resize(std::size_t(n_fiber));
    const std::uint32_t padded = (b.count + lanes - 1) / lanes * lanes;
    for (std::uint32_t i = 0; i < padded; i++) {
      const std::uint32_t index = members[std::min(i, b.count - 1)].second;
      const NewParticle p = particles.read(index, state.data(), fibers.data());
      const std::uint64_t slot = b.first_tile * lanes + i;
      ids()[slot] = p.id;
      for (int a = 0; a < D; a++) {
        value(layout_.position, a, slot) = T(p.position[a] - double(b.coordinate[a]) * edge);
        value(layout_.velocity, a, slot) = T(p.velocity[a]);
      }
      for (int c = 0; c < D * D; c++) value(layout_.affine, c, slot) = T(p.velocity_gradient(c / D, c % D));
      value(layout_.volume, slot) = T(p.volume);
      const Matrix3 m = layout_.stores_b ? Matrix3(p.deformation * p.deformation.transpose()) : p.deformation;
      for (std::size_t c = 0; c < strain.size(); c++)
        value(layout_.strain, int(c), slot) = T(m(strain[c].first, strain[c].second));
      if (layout_.damage) value(layout_.damage, slot) = T(p.damage);
      if (layout_.toughness) value(layout_.toughness, slot) = T(p.toughness);
      for (int c = 0; c < n_fiber; c++) value(layout_.fiber, c, slot) = T(fibers[std::size_t(c)]);
      for (int c = 0; c < n_state; c++) value(layout_.state, c, slot) = T(state[std::size_t(c)]);
    }
  });
  clear_tails();
  colour();
}

/// The places behind the last particle of a block are copies of it without volume.
template <class T, int D>
void Particles<T, D>::clear_tails() {
  tbb::parallel_for(std::size_t(0), blocks_.size(), [&](std::size_t k) {
    const Block& b = blocks_[k];
    const std::uint64_t begin = b.first_tile * lanes + b.count;
    for (std::uint64_t slot = begin; slot % lanes != 0; slot++) value(layout_.volume, slot) = 0;
  });
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
  const std::size_t old_slots = tiles_ * lanes;
  scratch_.reserve(old_slots * (sizeof(std::uint32_t) + 1));
  auto* order = reinterpret_cast<std::uint32_t*>(scratch_.data());
  auto* cell = reinterpret_cast<std::uint8_t*>(order + old_slots);
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
      if (last >= list.size() || !same(list[last].coordinate, h.block)) {
        for (last = 0; last < list.size() && !same(list[last].coordinate, h.block);) last++;
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

  // 3. Each new block lists where its particles are, by cell.
  place(tiles);
  from_.reserve(tiles * lanes * sizeof(std::uint32_t));
  tbb::parallel_for(std::size_t(0), blocks.size(), [&](std::size_t k) {
    const Block& b = blocks[k];
    auto* from = reinterpret_cast<std::uint32_t*>(from_.data()) + b.first_tile * lanes;
    std::array<std::uint32_t, 65> start{};
    for (std::size_t t = first_target[k]; t < first_target[k + 1]; t++) {
      const std::uint64_t base = blocks_[all[t].source].first_tile * lanes;
      for (std::uint32_t i = 0; i < all[t].count; i++) start[cell[base + order[base + all[t].first + i]] + 1u]++;
    }
    std::partial_sum(start.begin(), start.end(), start.begin());
    for (std::size_t t = first_target[k]; t < first_target[k + 1]; t++) {
      const std::uint64_t base = blocks_[all[t].source].first_tile * lanes;
      for (std::uint32_t i = 0; i < all[t].count; i++) {
        const std::uint64_t slot = base + order[base + all[t].first + i];
        from[start[cell[slot]]++] = std::uint32_t(slot);
      }
    }
    for (std::uint32_t i = b.count; i % lanes != 0; i++) from[i] = from[b.count - 1];
  });

  // 4. Where they are, positions count from the new blocks; then everything moves.
  tbb::parallel_for(std::size_t(0), blocks_.size(), [&](std::size_t k) {
    const Block& b = blocks_[k];
    const std::uint64_t base = b.first_tile * lanes;
    for (const Target& t : targets[k])
      for (int a = 0; a < D; a++)
        if (const T shift = T((b.coordinate[a] - t.coordinate[a]) * edge); shift != 0)
          for (std::uint32_t i = t.first; i < t.first + t.count; i++)
            value(layout_.position, a, base + order[base + i]) += shift;
  });
  blocks_ = std::move(blocks);
  permute();
  for (Buffer* b : {&from_, &scratch_})
    if (b->bytes() > kept_scratch) *b = Buffer();
  clear_tails();
  colour();
}

/// Brings every particle from where from_ says to its place: a few components of all particles at a time by way of the scratch.
template <class T, int D>
void Particles<T, D>::permute() {
  const auto* from = reinterpret_cast<const std::uint32_t*>(from_.data());
  constexpr std::size_t line = CLEAVE_TILE_BYTES;
  const std::size_t stride = layout_.stride, lines = stride / line;
  constexpr std::size_t ahead = 16;  // tiles: a few lines of each are too little for the processor to see a pattern
  // at least three lines of a tile, and of few tiles as many as the second-level cache may hold
  const std::size_t group = std::clamp((std::size_t(1) << 20) / (tiles_ * line + 1), std::size_t(3), lines);
  scratch_.reserve(tiles_ * group * line);
  char* const scratch = scratch_.data();
  char* const tiles = storage_.data();
  for (std::size_t first = 0; first < lines; first += group) {
    const std::size_t count = std::min(group, lines - first);
    for_stretches(tiles_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; t++) {
        if (t + ahead < tiles_)
          for (int l = 0; l < lanes; l += lanes / 2) {
            const char* source = tiles + (from[(t + ahead) * lanes + std::size_t(l)] / lanes) * stride + first * line;
            for (std::size_t c = 0; c < count; c++) __builtin_prefetch(source + c * line);
          }
        const T* source[lanes];
        for (int l = 0; l < lanes; l++) {
          const std::uint32_t slot = from[t * lanes + std::size_t(l)];
          source[l] = reinterpret_cast<const T*>(tiles + (slot / lanes) * stride + first * line) + slot % lanes;
        }
        T* to = reinterpret_cast<T*>(scratch + t * count * line);
        for (std::size_t c = 0; c < count; c++)
          for (int l = 0; l < lanes; l++) to[c * lanes + std::size_t(l)] = source[l][c * lanes];
      }
    });
    for_stretches(tiles_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; t++)
        std::memcpy(tiles + t * stride + first * line, scratch + t * count * line, count * line);
    });
  }
  auto* moved = reinterpret_cast<std::uint32_t*>(scratch);
  for_stretches(tiles_ * lanes, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; i++) moved[i] = ids()[from[i]];
  });
  for_stretches(tiles_ * lanes,
                [&](std::size_t begin, std::size_t end) { std::copy(moved + begin, moved + end, ids() + begin); });
}

namespace {
struct SavedBlock {
  BlockCoordinate coordinate;
  std::uint32_t count, damaged;
};
}  // namespace

template <class T, int D>
void Particles<T, D>::save(checkpoint::StateWriter& writer, const std::string& prefix) const {
  std::vector<SavedBlock> saved;
  for (const Block& b : blocks_) saved.push_back({b.coordinate, b.count, b.damaged});
  writer.section(prefix + "blocks", saved.data(), saved.size());
  writer.section(prefix + "tiles", storage_.data(), tiles_ * layout_.stride);
  writer.section(prefix + "ids", ids(), tiles_ * lanes);
}

template <class T, int D>
void Particles<T, D>::restore(checkpoint::StateReader& reader, const std::string& prefix, std::uint64_t ids_end) {
  const std::string blocks = prefix + "blocks", ids_section = prefix + "ids";
  const auto bytes = reader.read(blocks);
  std::vector<SavedBlock> saved(bytes.size() / sizeof(SavedBlock));
  if (bytes.size() != saved.size() * sizeof(SavedBlock)) reader.refuse(blocks, "holds no whole number of blocks");
  if (!saved.empty()) std::memcpy(saved.data(), bytes.data(), bytes.size());
  blocks_.clear();
  std::uint64_t count = 0;
  std::size_t tiles = 0;
  for (const SavedBlock& s : saved) {
    Block b{};
    b.coordinate = s.coordinate;
    b.first_tile = tiles;
    b.count = s.count;
    b.damaged = s.damaged != 0;
    for (const std::int32_t c : b.coordinate)
      if (c > farthest_block || c < -farthest_block) reader.refuse(blocks, "has a block that cannot be numbered");
    if (!blocks_.empty() && morton_key(blocks_.back().coordinate) >= morton_key(b.coordinate))
      reader.refuse(blocks, "has blocks that are not in Morton order");
    count += b.count;
    tiles += (b.count + lanes - 1) / lanes;
    blocks_.push_back(b);
  }
  if (count != size_)
    reader.refuse(blocks, "counts " + std::to_string(count) + " particles, the scene has " + std::to_string(size_));
  if (reader.bytes(prefix + "tiles") != tiles * layout_.stride)
    reader.refuse(prefix + "tiles", "has another layout of particles than the materials of the scene");
  place(tiles);
  reader.read(prefix + "tiles", std::as_writable_bytes(std::span(storage_.data(), tiles * layout_.stride)));
  reader.read(ids_section, std::as_writable_bytes(std::span(ids(), tiles * lanes)));
  if (std::any_of(ids(), ids() + tiles * lanes, [&](std::uint32_t id) { return id >= ids_end; }))
    reader.refuse(ids_section, "has ids of particles that are not there");
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
