// Particles to grid, grid update, grid to particles: MLS-MPM with quadratic B-splines (Hu et al. 2018), APIC (Jiang et al.
// 2015).
//
// Per particle, with d the offset from the particle to the middle node of its stencil in cells, and w the separable weights:
//   node i gets     mass     w m
//                   momentum w (m v + A (x_i - x_p)),   A = m dx C - k V tau,  k = 4 dt / (dx rho_ref)
//   particle gets   v = sum w v_i,   C = 4/dx sum w v_i (x_i - x_p)^T
// Each is written as a sum over rows of three nodes along the last axis; the offset from the middle node is -1, 0 or 1, so
// that (x_i - x_p) needs no multiplication.

#include "mpm/kernels/stencil.hpp"

namespace cleave::mpm::kernel {
namespace {

template <class T, int D>
struct Scratch {
  static constexpr int lanes = tile_lanes<T>;
  static constexpr int tiles = chunk_tiles<T>;
  alignas(64) T scatter_arena[(GridShape<D>::arena_nodes + 16) * 4];
  alignas(64) T gather_arena[(GridShape<D>::arena_nodes + 16) * 4];
  alignas(64) T before_arena[(GridShape<D>::arena_nodes + 16) * 4];
  alignas(64) T records[chunk_points * record_size];
  alignas(64) T before_records[chunk_points * record_size];
  alignas(64) T rows[tiles * record_size * lanes];
  alignas(64) T before_rows[tiles * record_size * lanes];
  alignas(64) T weights[tiles * WeightRows<D>::count * lanes];
  alignas(64) T stress[tiles * stress_rows * lanes];
  alignas(64) std::int32_t node[chunk_points + 16];  // first node of the stencil in the arena
  alignas(64) cleave_status status[chunk_points];
};

// ------------------------------------------------------------------------------------------------- stages

/// g = (1-r)(1-d)^2 + r, in a form that is exactly 1 where there is no damage.
template <class T>
CLEAVE_INLINE void degrade(const ParticleView& set, std::uint64_t first, int tiles, T* scratch) {
  using V = Part<T>;
  constexpr int lanes = tile_lanes<T>;
  for (int k = 0; k < tiles; k++)
    for (int lane = 0; lane < lanes; lane += V::lanes) {
      const V d = load<V>(set.tiles + (first + k) * set.stride + set.damage + lane * sizeof(T));
      store<V>(scratch + (k * stress_rows + degradation_row) * lanes + lane, T(1) - T(1 - set.residual) * d * (T(2) - d));
    }
}

template <class T, int D>
void particle_to_grid(const ParticleView& set, const BlockView& block, const StepView& step, void* scratch,
                      BlockReport& report) {
  auto& s = *static_cast<Scratch<T, D>*>(scratch);
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  constexpr int quads = D + 1;
  constexpr std::uint32_t row = CLEAVE_TILE_BYTES;
  const bool affine = step.scheme == TransferScheme::apic;
  using V = Part<T>;
  const V density = everywhere<V>(T(set.relative_density)), cell_size = everywhere<V>(T(step.cell_size)),
          force = everywhere<V>(T(step.force_scale));
  for_chunks<T>(
      set, block, [&](const Chunk& chunk) __attribute__((always_inline)) {
        const std::uint64_t first = chunk.first;
        const int count = chunk.points;
        if (step.stress) {
          if (block.damaged) degrade<T>(set, first, chunk.tiles, s.stress);
          evaluate<T>(block.damaged ? set.degraded_elasticity : set.elasticity, LawKind::elasticity, set, first, count,
                      step.time_step, s.stress, s.status, report);
        }
        for (int k = 0; k < chunk.tiles; k++) {
          const char* tile = set.tiles + (first + k) * set.stride;
          T* w = s.weights + k * (W::count * lanes);
          tile_weights<T, D, true>(set, tile, w, s.node + k * lanes);
          for (int lane = 0; lane < lanes; lane += V::lanes, tile += sizeof(V), w += V::lanes) {
            const V volume = load<V>(tile + set.volume), mass = volume * density;
            const V kv = volume * force, md = mass * cell_size;
            constexpr int sym3[9] = {0, 3, 4, 3, 1, 5, 4, 5, 2};
            V A[D][D], q[D];
            for (int i = 0; i < D; i++) {
              for (int a = 0; a < D; a++) {
                A[i][a] = affine ? md * load<V>(tile + set.affine + (D * i + a) * row) : V{};
                if (step.stress) A[i][a] -= kv * load<V>(s.stress + (k * stress_rows + sym3[3 * i + a]) * lanes + lane);
              }
              q[i] = mass * load<V>(tile + set.velocity + i * row);
              for (int a = 0; a < D; a++) q[i] += A[i][a] * load<V>(w + (W::offset + a) * lanes);
            }
            // records: [m q][0 A_x][0 A_y][0 A_z]
            T* rows = s.rows + lane;
            store<V>(rows, mass);
            for (int i = 0; i < 3; i++) store<V>(rows + (1 + i) * lanes, i < D ? q[i < D ? i : 0] : V{});
            for (int a = 0; a < D; a++) {
              store<V>(rows + (4 + 4 * a) * lanes, V{});
              for (int i = 0; i < 3; i++) store<V>(rows + (5 + 4 * a + i) * lanes, i < D ? A[i < D ? i : 0][a] : V{});
            }
          }
          lanes_to_records<T, quads>(s.rows, s.records + k * lanes * record_size);
        }
        scatter<T, D>(s.scatter_arena, s.records, s.weights, s.node, count);
      });
  merge_arena<T, D>(static_cast<T*>(step.grid), block, s.scatter_arena);
}

/// b <- A b A^T for the stored components.
template <class V, int D>
CLEAVE_INLINE void update_b(char* strain, const V (&A)[D][D]) {
  constexpr std::uint32_t row = CLEAVE_TILE_BYTES;
  if constexpr (D == 3) {
    V b[6], t[3][3];
    for (int i = 0; i < 6; i++) b[i] = load<V>(strain + i * row);
    constexpr int at[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) t[i][j] = A[i][0] * b[at[0][j]] + A[i][1] * b[at[1][j]] + A[i][2] * b[at[2][j]];
    const auto component = [&](int i, int j) { return t[i][0] * A[j][0] + t[i][1] * A[j][1] + t[i][2] * A[j][2]; };
    store<V>(strain, component(0, 0));
    store<V>(strain + row, component(1, 1));
    store<V>(strain + 2 * row, component(2, 2));
    store<V>(strain + 3 * row, component(0, 1));
    store<V>(strain + 4 * row, component(0, 2));
    store<V>(strain + 5 * row, component(1, 2));
  } else {  // xx yy zz xy; zz does not change in plane strain
    const V xx = load<V>(strain), yy = load<V>(strain + row), xy = load<V>(strain + 3 * row);
    const V t00 = A[0][0] * xx + A[0][1] * xy, t01 = A[0][0] * xy + A[0][1] * yy;
    const V t10 = A[1][0] * xx + A[1][1] * xy, t11 = A[1][0] * xy + A[1][1] * yy;
    store<V>(strain, t00 * A[0][0] + t01 * A[0][1]);
    store<V>(strain + row, t10 * A[1][0] + t11 * A[1][1]);
    store<V>(strain + 3 * row, t00 * A[1][0] + t01 * A[1][1]);
  }
}

/// F <- A F. 2D: F is 00 01 10 11 22, and 22 does not change.
template <class V, int D>
CLEAVE_INLINE void update_F(char* strain, const V (&A)[D][D]) {
  constexpr std::uint32_t row = CLEAVE_TILE_BYTES;
  for (int j = 0; j < D; j++) {
    V f[D];
    for (int i = 0; i < D; i++) f[i] = load<V>(strain + (D * i + j) * row);
    for (int i = 0; i < D; i++) {
      V sum = A[i][0] * f[0];
      for (int a = 1; a < D; a++) sum += A[i][a] * f[a];
      store<V>(strain + (D * i + j) * row, sum);
    }
  }
}

template <class V, int D>
CLEAVE_INLINE V determinant(const V (&A)[D][D]) {
  if constexpr (D == 3)
    return A[0][0] * (A[1][1] * A[2][2] - A[1][2] * A[2][1]) - A[0][1] * (A[1][0] * A[2][2] - A[1][2] * A[2][0]) +
           A[0][2] * (A[1][0] * A[2][1] - A[1][1] * A[2][0]);
  else
    return A[0][0] * A[1][1] - A[0][1] * A[1][0];
}

template <class V, int D>
CLEAVE_INLINE void update_strain(const ParticleView& set, char* tile, const V (&A)[D][D]) {
  if (set.stores_b)
    update_b<V, D>(tile + set.strain, A);
  else
    update_F<V, D>(tile + set.strain, A);
}

/// The same, but points with d >= saturated_damage are not stretched beyond tr b = largest_broken_stretch, nor turned inside
/// out: nothing holds them, and det b of six rounded numbers would soon be lost.
template <class V, int D>
__attribute__((noinline)) void update_broken(const ParticleView& set, char* tile, const V (&A)[D][D]) {
  constexpr int most = D == 3 ? 9 : 5;
  const int components = D == 3 ? (set.stores_b ? 6 : 9) : (set.stores_b ? 4 : 5);
  V before[most];
  const auto row = [&](int c) { return tile + set.strain + c * CLEAVE_TILE_BYTES; };
  for (int c = 0; c < components; c++) before[c] = load<V>(row(c));
  update_strain<V, D>(set, tile, A);
  const auto stretch = [&](auto&& component) {
    V sum{};
    for (int c = 0; c < (set.stores_b ? 3 : components); c++) sum += set.stores_b ? component(c) : component(c) * component(c);
    return sum;
  };
  const V now = stretch([&](int c) { return load<V>(row(c)); }), then = stretch([&](int c) { return before[c]; });
  TileMask<V> kept = (now > NumberOf<V>(largest_broken_stretch)) & (now > then);
  if (set.detect_inversion) kept |= ~(determinant<V, D>(A) > NumberOf<V>(0));
  kept &= load<V>(tile + set.damage) >= NumberOf<V>(saturated_damage);
  if (!any(kept)) return;
  for (int c = 0; c < components; c++) store<V>(row(c), select<V>(kept, before[c], load<V>(row(c))));
}

template <class T, int D>
void grid_to_particle(const ParticleView& set, const BlockView& block, const StepView& step, void* scratch,
                      BlockReport& report) {
  auto& s = *static_cast<Scratch<T, D>*>(scratch);
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  constexpr int quads = D + 1;
  constexpr std::uint32_t row = CLEAVE_TILE_BYTES;
  const bool flip = step.scheme == TransferScheme::flip, apic = step.scheme == TransferScheme::apic;
  load_arena<T, D>(static_cast<const T*>(step.grid), block, s.gather_arena);
  if (flip) load_arena<T, D>(static_cast<const T*>(step.grid_before), block, s.before_arena);
  using V = Part<T>;
  const V dt = everywhere<V>(T(step.time_step)), to_cells = everywhere<V>(T(step.time_step / step.cell_size)),
          gradient = everywhere<V>(T(4 / step.cell_size)), ratio = everywhere<V>(T(step.flip_ratio)),
          least_ratio = everywhere<V>(T(step.least_volume_ratio));
  constexpr T low = T(-0.5), high = T(GridShape<D>::block_edge + 1.5);
  V fastest{};
  TileMask<V> strayed{}, broken{}, inverted{};
  for_chunks<T>(
      set, block, [&](const Chunk& chunk) __attribute__((always_inline)) {
        const std::uint64_t first = chunk.first;
        const int count = chunk.points;
        for (int k = 0; k < chunk.tiles; k++)
          tile_weights<T, D, false>(set, set.tiles + (first + k) * set.stride, s.weights + k * (W::count * lanes),
                                    s.node + k * lanes);
        gather_chunk<T, D>(s.gather_arena, s.weights, s.node, count, s.records);
        if (flip) gather_chunk<T, D>(s.before_arena, s.weights, s.node, count, s.before_records);
        for (int k = 0; k < chunk.tiles; k++) {
          char* tile = set.tiles + (first + k) * set.stride;
          const T* w = s.weights + k * (W::count * lanes);
          records_to_lanes<T, quads>(s.records + k * lanes * record_size, s.rows);
          if (flip) records_to_lanes<T, quads>(s.before_records + k * lanes * record_size, s.before_rows);
          for (int lane = 0; lane < lanes; lane += V::lanes, tile += sizeof(V), w += V::lanes) {
            const T *rows = s.rows + lane, *before_rows = s.before_rows + lane;
            V v[D], A[D][D];
            for (int i = 0; i < D; i++) v[i] = load<V>(rows + (1 + i) * lanes);
            for (int a = 0; a < D; a++) {
              const V offset = load<V>(w + (W::offset + a) * lanes);
              for (int i = 0; i < D; i++) A[i][a] = gradient * (load<V>(rows + (5 + 4 * a + i) * lanes) + offset * v[i]);
            }
            for (int i = 0; i < D; i++)
              for (int a = 0; a < D; a++) store<V>(tile + set.affine + (D * i + a) * row, apic ? A[i][a] : V{});
            for (int i = 0; i < D; i++) {
              char* position = tile + set.position + i * row;
              const V x = load<V>(position) + to_cells * v[i];
              store<V>(position, x);
              strayed |= (x < low) | (x >= high);
              const V speed = magnitude<V>(v[i]);
              fastest = maximum<V>(speed, fastest);
              broken |= ~(speed < T(1e18));
            }
            if (flip) {
              for (int i = 0; i < D; i++) {
                char* velocity = tile + set.velocity + i * row;
                const V change = v[i] - load<V>(before_rows + (1 + i) * lanes);
                store<V>(velocity, v[i] + ratio * (load<V>(velocity) + change - v[i]));
              }
            } else {
              for (int i = 0; i < D; i++) store<V>(tile + set.velocity + i * row, v[i]);
            }
            for (int i = 0; i < D; i++)
              for (int a = 0; a < D; a++) A[i][a] = dt * A[i][a] + T(i == a ? 1 : 0);
            if (set.detect_inversion) {
              auto turned = ~(determinant<V, D>(A) > least_ratio);
              if (block.damaged) turned &= load<V>(tile + set.damage) < T(saturated_damage);
              inverted |= turned;
            }
            if (block.damaged)
              update_broken<V, D>(set, tile, A);
            else
              update_strain<V, D>(set, tile, A);
            const auto trouble = broken | inverted;
            if (__builtin_expect(any(trouble), 0) && report.slot == ~0ull)
              for (int l = 0; l < V::lanes; l++)
                if (trouble[l]) {
                  report.slot = (first + k) * lanes + lane + l;
                  break;
                }
          }
        }
        if (set.plasticity.function)
          evaluate<T>(set.plasticity, LawKind::plasticity, set, first, count, step.time_step, s.stress, s.status, report);
      });
  for (int l = 0; l < V::lanes; l++)
    if (double(fastest[l]) > report.maximum_speed) report.maximum_speed = double(fastest[l]);
  report.strayed = report.strayed || any(strayed);
  report.not_finite = report.not_finite || any(broken);
  report.inverted = report.inverted || any(inverted);
}

template <class T, int D>
void grid_update(T* grid, std::uint64_t first, std::uint64_t last, const T* velocity_change) {
  const Quad<T> change = quad<T>(0, velocity_change[0], velocity_change[1], velocity_change[2]);
  constexpr std::size_t numbers = GridShape<D>::block_nodes * 4;
  for (T *p = grid + first * numbers, *end = grid + last * numbers; p < end; p += 4) {
    const Quad<T> node = load_quad(p);
    const T mass = node[0];
    if (!(mass > T(0))) continue;
    Quad<T> velocity = node * (T(1) / mass) + change;
    velocity.r[0][0] = mass;
    store_quad<T>(p, velocity);
  }
}

template <class T, int D>
TransferKernels<T, D> table() {
  return {sizeof(Scratch<T, D>), particle_to_grid<T, D>, grid_update<T, D>, grid_to_particle<T, D>};
}

}  // namespace
}  // namespace cleave::mpm::kernel

extern "C" __attribute__((visibility("default"))) const cleave::mpm::KernelSet* cleave_kernels() {
  using namespace cleave::mpm;
  static const KernelSet set{
      CLEAVE_KERNEL_ISA,
      {kernel::table<float, 2>(), kernel::table<float, 3>(), kernel::table<double, 2>(), kernel::table<double, 3>()},
      damage_kernels(),
      implicit_kernels()};
  return &set;
}
