// Sweeps over particles and grid for the evolution of damage: one number per node where transfers of momentum have four.
//
// The Laplacian is the weak form on the kernel of the transfers, with the gradient of moving least squares:
//   grad_i(x_p) = 4 w_ip (x_i - x_p),   K_ij = sum_p V_p grad_i . grad_j,   lap d = -M^-1 K d,   M_i = sum_p V_p w_ip
// in cells. With o = offset of the middle node from the particle, x_i - x_p = o + (-1, 0, 1) along each axis.

#include "mpm/kernels/quads.hpp"

#include <algorithm>

namespace cleave::mpm::kernel {
namespace {

template <class T, int D>
struct DamageScratch {
  static constexpr int lanes = tile_lanes<T>;
  static constexpr int tiles = chunk_tiles<T>;
  alignas(64) T from[GridShape<D>::arena_nodes + 16];
  alignas(64) T to[GridShape<D>::arena_nodes + 16];
  alignas(64) T collected[(GridShape<D>::arena_nodes + 16) * 4];
  alignas(64) T weights[tiles * WeightRows<D>::count * lanes];
  alignas(64) T laws[tiles * stress_rows * lanes];
  alignas(64) T values[chunk_points];
  alignas(64) T coefficient[chunk_points];
  alignas(64) T record[chunk_points * 4];
  alignas(64) std::int32_t node[chunk_points + 16];
  alignas(64) cleave_status status[chunk_points];
};

// ------------------------------------------------------------------------------------------------- arena of one number per
// node

template <class T, int D>
CLEAVE_INLINE void load_numbers(const T* grid, const BlockView& block, T* arena) {
  for_arena_rows<D>(block, [&](std::uint32_t b, int node, int at, auto n) {
    const T* from = grid + std::size_t(b) * GridShape<D>::block_nodes + node;
    for (int i = 0; i < decltype(n)::value; i++) arena[at + i] = from[i];
  });
}

/// Whether the arena holds anything but zeros: damage has come to few blocks, and one operator after it to few more.
template <class T, int D>
CLEAVE_INLINE bool any_number(const T* arena) {
  constexpr int lanes = tile_lanes<T>;
  static_assert(GridShape<D>::arena_nodes % lanes == 0);
  TileMask<T> present{};
  for (int i = 0; i < GridShape<D>::arena_nodes; i += lanes) present |= load<T>(arena + i) != T(0);
  return any(present);
}

/// Adds the arena to the grid and clears it.
template <class T, int D>
CLEAVE_INLINE void merge_numbers(T* grid, const BlockView& block, T* arena) {
  for_arena_rows<D>(block, [&](std::uint32_t b, int node, int at, auto n) {
    T* to = grid + std::size_t(b) * GridShape<D>::block_nodes + node;
    for (int i = 0; i < decltype(n)::value; i++) {
      to[i] += arena[at + i];
      arena[at + i] = 0;
    }
  });
}

/// Reads one number more than the row has; its weight is zero.
template <class T>
CLEAVE_INLINE Quad<T> load_row(const T* p) {
  Quad<T> q;
  std::memcpy(&q, p, sizeof q);
  return q;
}
template <class T>
CLEAVE_INLINE void add_row(T* p, const Quad<T>& v) {
  const Quad<T> sum = load_row(p) + v;
  std::memcpy(p, &sum, sizeof sum);
}

/// Rows of the stencil: nine in three dimensions, three in two.
template <int D>
inline constexpr int stencil_rows = D == 3 ? 9 : 3;
template <int D>
CLEAVE_INLINE constexpr int row_start(int r) {
  constexpr int edge = GridShape<D>::arena_edge;
  return D == 3 ? (r / 3) * edge * edge + (r % 3) * edge : r * edge;
}

/// Weights of one particle in the layout of `tile_weights` with planes.
template <class T, int D>
struct Stencil {
  using W = WeightRows<D>;
  static constexpr int lanes = tile_lanes<T>;
  const T* w;
  CLEAVE_INLINE Stencil(const T* weights, int p) : w(weights + (p / lanes) * (W::count * lanes) + p % lanes) {}
  /// Product of the weights of all axes but the last, of row r.
  CLEAVE_INLINE T plane(int r) const { return D == 3 ? w[(W::plane + r) * lanes] : w[r * lanes]; }
  CLEAVE_INLINE Quad<T> last() const {
    return quad<T>(w[W::axis(D - 1) * lanes], w[(W::axis(D - 1) + 1) * lanes], w[(W::axis(D - 1) + 2) * lanes], T(0));
  }
  CLEAVE_INLINE T offset(int a) const { return w[(W::offset + a) * lanes]; }
};

template <class T>
CLEAVE_INLINE T sum3(const Quad<T>& q) {
  return q[0] + q[1] + q[2];
}

/// sum w f over the stencil.
template <class T, int D>
CLEAVE_INLINE T gather_value(const T* arena, const T* weights, const std::int32_t* node, int p) {
  const Stencil<T, D> s(weights, p);
  const T* a = arena + node[p];
  Quad<T> sum{};
  for (int r = 0; r < stencil_rows<D>; r++) sum += s.plane(r) * load_row(a + row_start<D>(r));
  return sum3<T>(sum * s.last());
}

template <class T, int D>
CLEAVE_INLINE void chunk_weights(const ParticleView& set, const Chunk& chunk, DamageScratch<T, D>& s) {
  constexpr int lanes = tile_lanes<T>;
  for (int k = 0; k < chunk.tiles; k++)
    tile_weights<T, D, true>(set, set.tiles + (chunk.first + std::uint64_t(k)) * set.stride,
                             s.weights + k * (WeightRows<D>::count * lanes), s.node + k * lanes);
}

// ------------------------------------------------------------------------------------------------- laws

template <class T, int D>
CLEAVE_INLINE Tile<T> jacobian(const ParticleView& set, const char* tile) {
  const auto at = [&](int c) { return load<T>(tile + set.strain + c * CLEAVE_TILE_BYTES); };
  Tile<T> det;
  if constexpr (D == 3) {
    if (set.stores_b) {
      const Tile<T> xx = at(0), yy = at(1), zz = at(2), xy = at(3), xz = at(4), yz = at(5);
      det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    } else {
      det = at(0) * (at(4) * at(8) - at(5) * at(7)) - at(1) * (at(3) * at(8) - at(5) * at(6)) +
            at(2) * (at(3) * at(7) - at(4) * at(6));
    }
  } else {
    det = set.stores_b ? (at(0) * at(1) - at(3) * at(3)) * at(2) : (at(0) * at(3) - at(1) * at(2)) * at(4);
  }
  if (set.stores_b) {
    return square_root<T>(maximum<T>(det, Tile<T>{}));
  }
  return magnitude<T>(det);
}

template <class T, int D>
void drive(const ParticleView& set, const BlockView& block, const DamageView& view, void* scratch, BlockReport& report,
           DamageReport& damage) {
  auto& s = *static_cast<DamageScratch<T, D>*>(scratch);
  constexpr int lanes = tile_lanes<T>;
  const T negligible = T(negligible_damage);
  Tile<T> largest{};
  TileMask<T> active{}, damaged{};
  for_chunks<T>(set, block, [&](const Chunk& chunk) {
    if (view.inputs.function)
      evaluate<T>(view.inputs, LawKind::elasticity, set, chunk.first, chunk.points, view.time_step, s.laws, s.status, report);
    evaluate<T>(view.law, LawKind::damage, set, chunk.first, chunk.points, view.time_step, s.laws, s.status, report);
    for (int k = 0; k < chunk.tiles; k++) {
      const std::uint64_t tile = chunk.first + std::uint64_t(k);
      const char* at = set.tiles + tile * set.stride;
      const Tile<T> d = load<T>(at + set.damage), rest = load<T>(at + set.volume);
      const auto exists = rest > T(0);
      damaged |= exists & (d > T(0));
      if (view.local) continue;
      Tile<T> force = load<T>(s.laws + (k * stress_rows + driving_force_row) * lanes);
      force = select<T>(exists & (force > negligible), force, Tile<T>{});
      store<T>(static_cast<T*>(view.driving_force) + tile * lanes, force);
      store<T>(static_cast<T*>(view.volume) + tile * lanes, rest * jacobian<T, D>(set, at));
      active |= force > T(0);
      largest = maximum<T>(largest, select<T>(d < T(saturated_damage), force, Tile<T>{}));
    }
  });
  for (int l = 0; l < lanes; l++) damage.largest_driving_force = std::max(damage.largest_driving_force, double(largest[l]));
  damage.damaged = any(damaged);
  damage.active = damage.damaged || any(active);
}

// ------------------------------------------------------------------------------------------------- particles to nodes

template <class T, int D>
void collect(const ParticleView& set, const BlockView& block, const DamageView& view, T* nodes, void* scratch) {
  auto& s = *static_cast<DamageScratch<T, D>*>(scratch);
  constexpr int lanes = tile_lanes<T>, rows = stencil_rows<D>;
  for_chunks<T>(set, block, [&](const Chunk& chunk) {
    chunk_weights<T, D>(set, chunk, s);
    for (int k = 0; k < chunk.tiles; k++) {
      const std::uint64_t tile = chunk.first + std::uint64_t(k);
      const Tile<T> volume = load<T>(static_cast<T*>(view.volume) + tile * lanes);
      const Tile<T> damage = volume * load<T>(set.tiles + tile * set.stride + set.damage);
      const Tile<T> force = volume * load<T>(static_cast<T*>(view.driving_force) + tile * lanes);
      for (int l = 0; l < lanes; l++)
        store_quad<T>(s.record + (k * lanes + l) * 4, quad<T>(volume[l], damage[l], force[l], T(0)));
    }
    for (int p = 0; p < chunk.points;) {
      const std::int32_t first = s.node[p];
      Row<T> sum[rows];
      for (auto& r : sum) r = Row<T>::zero();
      do {
        const Stencil<T, D> w(s.weights, p);
        const Row<T> last = Row<T>::weights(w.w + WeightRows<D>::axis(D - 1) * lanes, lanes) * Row<T>::repeat(s.record + p * 4);
        for (int r = 0; r < rows; r++) sum[r] = Row<T>::multiply_add(w.plane(r), last, sum[r]);
      } while (++p < chunk.points && s.node[p] == first);
      for (int r = 0; r < rows; r++) {
        T* at = s.collected + (first + row_start<D>(r)) * 4;
        (Row<T>::load(at) + sum[r]).store(at);
      }
    }
  });
  merge_arena<T, D>(nodes, block, s.collected);
}

/// What a particle, or as many of one cell as Q is for, adds to K f, from weights in the layout of `tile_weights` with planes:
/// value are rows of f, c is 16 V.
template <class Q, class T, int D>
CLEAVE_INLINE void add_stiffness(const T* w, const Q& c, const Q (&value)[stencil_rows<D>], Q (&sum)[stencil_rows<D>]) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>, rows = stencil_rows<D>;
  const Q along_row = repeat_quad<Q, T>(quad<T>(-1, 0, 1, 0));
  const auto row = [&](int r) { return spread<Q>(w + r * lanes); };
  const auto offset = [&](int a) { return row(W::offset + a); };
  const Q last = for_nodes(row(W::axis(D - 1)), row(W::axis(D - 1) + 1), row(W::axis(D - 1) + 2));
  Q plane[rows];
  for (int r = 0; r < rows; r++) plane[r] = row(D == 3 ? W::plane + r : r);
  // gradient: sums of w f and of w f times (-1, 0, 1) along each axis
  Q all{}, along_x{}, along_y{};
  for (int i = 0; i < rows; i += 3) {
    const Q low = plane[i] * value[i];
    const Q up_to_middle = low + plane[i + 1] * value[i + 1], line = up_to_middle + plane[i + 2] * value[i + 2];
    const Q slope = plane[i + 2] * value[i + 2] - low;
    all += line;
    if constexpr (D == 3) {
      along_y += slope;
      if (i == 0) along_x -= line;
      if (i == 6) along_x += line;
    } else {
      along_x = slope;
    }
  }
  const Q weighted = all * last, total = sum_quads(weighted);
  const Q gx = c * (sum_quads(along_x * last) + offset(0) * total);
  const Q gz = c * (sum_quads(along_row * weighted) + offset(D - 1) * total);
  // back: w (g . (x_i - x_p))
  Q middle = gx * offset(0) + gz * offset(D - 1);
  if constexpr (D == 3) {
    const Q gy = c * (sum_quads(along_y * last) + offset(1) * total);
    middle += gy * offset(1);
    const Q base = last * (middle + along_row * gz), step_x = gx * last, step_y = gy * last;
    for (int i = 0; i < 3; i++) {
      const Q line = i == 0 ? base - step_x : i == 1 ? base : base + step_x;
      sum[3 * i] += plane[3 * i] * (line - step_y);
      sum[3 * i + 1] += plane[3 * i + 1] * line;
      sum[3 * i + 2] += plane[3 * i + 2] * (line + step_y);
    }
  } else {
    const Q base = last * (middle + along_row * gz), step_x = gx * last;
    sum[0] += plane[0] * (base - step_x);
    sum[1] += plane[1] * base;
    sum[2] += plane[2] * (base + step_x);
  }
}

template <class T, int D>
void stiffness(const ParticleView& set, const BlockView& block, const DamageView& view, const T* from, T* to, void* scratch) {
  auto& s = *static_cast<DamageScratch<T, D>*>(scratch);
  using W = WeightRows<D>;
  using V = Part<T>;
  constexpr int lanes = tile_lanes<T>, rows = stencil_rows<D>, together = side_by_side<Quads<T>>;
  load_numbers<T, D>(from, block, s.from);
  if (!any_number<T, D>(s.from)) return;
  for_chunks<T>(set, block, [&](const Chunk& chunk) {
    chunk_weights<T, D>(set, chunk, s);
    const T* volume = static_cast<const T*>(view.volume) + chunk.first * lanes;
    for (int p = 0; p < chunk.tiles * lanes; p += V::lanes) store<V>(s.coefficient + p, T(16) * load<V>(volume + p));
    for (int p = 0; p < chunk.points;) {
      const std::int32_t first = s.node[p];
      int end = p + 1;  // of the particles of this cell, within a tile
      while (end < chunk.points && end % lanes != 0 && s.node[end] == first) end++;
      Quad<T> value[rows], sum[rows];
      auto present = Quad<T>{} != Quad<T>{};
      for (int r = 0; r < rows; r++) {
        value[r] = load_row(s.from + first + row_start<D>(r));
        present |= value[r] != T(0);
        sum[r] = Quad<T>{};
      }
      if (any(present)) {
        const T* w = s.weights + (p / lanes) * (W::count * lanes) - p / lanes * lanes;
        int next = p;
        if (together > 1 && end - p >= together) {
          Quads<T> values[rows], sums[rows];
          for (int r = 0; r < rows; r++) {
            values[r] = repeat_quad<Quads<T>, T>(value[r]);
            sums[r] = Quads<T>{};
          }
          for (; next + together <= end; next += together)
            add_stiffness<Quads<T>, T, D>(w + next, spread<Quads<T>>(s.coefficient + next), values, sums);
          for (int r = 0; r < rows; r++) sum[r] = add_up<T>(sums[r]);
        }
        for (; next < end; next++) add_stiffness<Quad<T>, T, D>(w + next, spread<Quad<T>>(s.coefficient + next), value, sum);
        for (int r = 0; r < rows; r++) add_row<T>(s.to + first + row_start<D>(r), sum[r]);
      }
      p = end;
    }
  });
  merge_numbers<T, D>(to, block, s.to);
}

// ------------------------------------------------------------------------------------------------- nodes to particles

/// Calls update(tile, values of the chunk's tile) with sum w f of each particle.
template <class T, int D, class Update>
CLEAVE_INLINE void gather_tiles(const ParticleView& set, const BlockView& block, const T* field, DamageScratch<T, D>& s,
                                Update&& update) {
  constexpr int lanes = tile_lanes<T>;
  load_numbers<T, D>(field, block, s.from);
  if (!any_number<T, D>(s.from)) {
    const std::uint64_t end = block.first_tile + (block.count + lanes - 1) / lanes;
    for (std::uint64_t tile = block.first_tile; tile < end; tile++) update(tile, Tile<T>{});
    return;
  }
  for_chunks<T>(set, block, [&](const Chunk& chunk) {
    chunk_weights<T, D>(set, chunk, s);
    for (int p = 0; p < chunk.points; p++) s.values[p] = gather_value<T, D>(s.from, s.weights, s.node, p);
    for (int p = chunk.points; p < chunk.tiles * lanes; p++) s.values[p] = 0;
    for (int k = 0; k < chunk.tiles; k++) update(chunk.first + std::uint64_t(k), load<T>(s.values + k * lanes));
  });
}

/// Stores d, kept from falling, inside [0,1], and at zero where it would become `negligible` in this step.
template <class T>
CLEAVE_INLINE void store_damage(const ParticleView& set, std::uint64_t tile, Tile<T> before, Tile<T> after, T negligible,
                                TileMask<T>& damaged) {
  char* at = set.tiles + tile * set.stride;
  after = minimum<T>(maximum<T>(before, after), everywhere(T(1)));
  after = select<T>((before > T(0)) | (after > negligible), after, Tile<T>{});
  store<T>(at + set.damage, after);
  damaged |= (after > T(0)) & (load<T>(at + set.volume) > T(0));
}

template <class T, int D>
void advance(const ParticleView& set, const BlockView& block, const T* change, double negligible, void* scratch,
             DamageReport& report) {
  TileMask<T> damaged{};
  gather_tiles<T, D>(set, block, change, *static_cast<DamageScratch<T, D>*>(scratch), [&](std::uint64_t tile, Tile<T> value) {
    const Tile<T> d = load<T>(set.tiles + tile * set.stride + set.damage);
    store_damage<T>(set, tile, d, d + value, T(negligible), damaged);
  });
  report.damaged = any(damaged);
}

/// One explicit step of a tile.
template <class T>
CLEAVE_INLINE void integrate_tile(const ParticleView& set, const DamageView& view, std::uint64_t tile, Tile<T> laplacian,
                                  T rate, T length2, TileMask<T>& damaged) {
  const Tile<T> d = load<T>(set.tiles + tile * set.stride + set.damage);
  const Tile<T> force = load<T>(static_cast<T*>(view.driving_force) + tile * tile_lanes<T>);
  const Tile<T> growth = (T(1) - d) * force - (d - length2 * laplacian);
  store_damage<T>(set, tile, d, d + rate * growth, rate * T(negligible_damage), damaged);
}

template <class T, int D>
void integrate(const ParticleView& set, const BlockView& block, const DamageView& view, const T* laplacian, double rate,
               double length, void* scratch, DamageReport& report) {
  TileMask<T> damaged{};
  gather_tiles<T, D>(set, block, laplacian, *static_cast<DamageScratch<T, D>*>(scratch),
                     [&](std::uint64_t tile, Tile<T> value) {
                       integrate_tile<T>(set, view, tile, value, T(rate), T(length * length), damaged);
                     });
  report.damaged = any(damaged);
}

// ------------------------------------------------------------------------------------------------- cubic B-splines

/// Node n of the lattice of cell centres lies at n - 1/2, so that the four nodes of a particle start in its own cell and stay
/// inside the home block's arena. Weights and second derivatives along one axis.
template <class T>
struct Cubic {
  int first;
  T weight[4], second[4];
  CLEAVE_INLINE explicit Cubic(T x) {
    const T y = x - T(0.5);
    first = int(y);  // y >= 0: particles are sorted
    const T u = y - T(first), v = T(1) - u;
    weight[0] = v * v * v / 6;
    weight[1] = T(2) / 3 - u * u + u * u * u / 2;
    weight[2] = T(2) / 3 - v * v + v * v * v / 2;
    weight[3] = u * u * u / 6;
    second[0] = v;
    second[1] = 3 * u - 2;
    second[2] = 3 * v - 2;
    second[3] = u;
  }
};

/// Calls visit(arena node, weight, Laplacian of the weight) for the nodes of a particle.
template <class T, int D, class Visit>
CLEAVE_INLINE void for_cubic(const ParticleView& set, const char* tile, int lane, Visit&& visit) {
  constexpr int edge = GridShape<D>::arena_edge;
  const auto axis = [&](int a) {
    return Cubic<T>(reinterpret_cast<const T*>(tile + set.position + a * CLEAVE_TILE_BYTES)[lane]);
  };
  const Cubic<T> x = axis(0), y = axis(1);
  // arena nodes start at -1
  if constexpr (D == 3) {
    const Cubic<T> z = axis(2);
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++)
        for (int k = 0; k < 4; k++)
          visit(((x.first + i + 1) * edge + y.first + j + 1) * edge + z.first + k + 1, x.weight[i] * y.weight[j] * z.weight[k],
                x.second[i] * y.weight[j] * z.weight[k] + x.weight[i] * y.second[j] * z.weight[k] +
                    x.weight[i] * y.weight[j] * z.second[k]);
  } else {
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++)
        visit((x.first + i + 1) * edge + y.first + j + 1, x.weight[i] * y.weight[j],
              x.second[i] * y.weight[j] + x.weight[i] * y.second[j]);
  }
}

template <class T, int D>
void collect_cubic(const ParticleView& set, const BlockView& block, const DamageView& view, T* nodes, void* scratch) {
  auto& s = *static_cast<DamageScratch<T, D>*>(scratch);
  constexpr int lanes = tile_lanes<T>;
  for (std::uint32_t p = 0; p < block.count; p++) {
    const std::uint64_t tile = block.first_tile + p / lanes;
    const int lane = int(p % lanes);
    const char* at = set.tiles + tile * set.stride;
    const T volume = static_cast<const T*>(view.volume)[tile * lanes + std::uint64_t(lane)];
    const T damage = reinterpret_cast<const T*>(at + set.damage)[lane];
    for_cubic<T, D>(set, at, lane, [&](int node, T weight, T) {
      s.collected[node * 4] += volume * weight;
      s.collected[node * 4 + 1] += volume * weight * damage;
    });
  }
  merge_arena<T, D>(nodes, block, s.collected);
}

template <class T, int D>
void integrate_cubic(const ParticleView& set, const BlockView& block, const DamageView& view, const T* damage, double rate,
                     double length, void* scratch, DamageReport& report) {
  auto& s = *static_cast<DamageScratch<T, D>*>(scratch);
  constexpr int lanes = tile_lanes<T>;
  load_numbers<T, D>(damage, block, s.from);
  TileMask<T> damaged{};
  for (std::uint32_t p = 0; p < block.count; p += lanes) {
    const std::uint64_t tile = block.first_tile + p / lanes;
    T* laplacian = s.values;
    for (int l = 0; l < lanes; l++) {
      laplacian[l] = 0;
      if (p + std::uint32_t(l) < block.count)
        for_cubic<T, D>(set, set.tiles + tile * set.stride, l,
                        [&](int node, T, T second) { laplacian[l] += second * s.from[node]; });
    }
    integrate_tile<T>(set, view, tile, load<T>(laplacian), T(rate), T(length * length), damaged);
  }
  report.damaged = any(damaged);
}

template <class T, int D>
DamageKernels<T, D> table() {
  return {sizeof(DamageScratch<T, D>), drive<T, D>,          collect<T, D>, stiffness<T, D>, advance<T, D>, integrate<T, D>,
          collect_cubic<T, D>,         integrate_cubic<T, D>};
}

}  // namespace
}  // namespace cleave::mpm::kernel

cleave::mpm::KernelTable<cleave::mpm::DamageKernels> cleave::mpm::damage_kernels() {
  return {kernel::table<float, 2>(), kernel::table<float, 3>(), kernel::table<double, 2>(), kernel::table<double, 3>()};
}
