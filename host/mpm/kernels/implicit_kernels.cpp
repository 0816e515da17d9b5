// The incremental potential of a step, E(v) = 1/2 sum m_i |v_i - v*_i|^2 + sum_p V_p psi(A_p F_p), A_p = I + dt C_p(v),
// C_p = 4/dx sum w v_i (x_i - x_p)^T: what the particles add to its value, gradient and Hessian. Grid velocities come in, so
// that each is a gather, a law and a scatter. With k = 4 dt / (dx rho_ref), and offsets x_i - x_p in cells:
//   value     V psi / rho_ref
//   gradient  w k V (P F_n^T) (x_i - x_p)
//   product   w k V (dP(dt C(u) F_n) F_n^T) (x_i - x_p)
// Materials that store b: F_n is the lower triangle L of b = L L^T, which isotropic laws cannot tell from any other.

#include "mpm/kernels/stencil.hpp"

#include <cmath>

namespace cleave::mpm::kernel {
namespace {

template <class T, int D>
struct ImplicitScratch {
  static constexpr int lanes = tile_lanes<T>;
  static constexpr int tiles = chunk_tiles<T>;
  alignas(64) T gather_arena[(GridShape<D>::arena_nodes + 16) * 4];
  alignas(64) T scatter_arena[(GridShape<D>::arena_nodes + 16) * 4];
  alignas(64) T diagonal_arena[(GridShape<D>::arena_nodes + 16) * diagonal_numbers];
  alignas(64) T records[chunk_points * record_size];
  alignas(64) T rows[tiles * record_size * lanes];
  alignas(64) T weights[tiles * WeightRows<D>::count * lanes];
  alignas(64) T law[tiles * implicit_rows * lanes];
  alignas(64) T tangent[tiles * tangent_numbers<D> * lanes];  // packed upper triangle, of D*D by D*D
  alignas(64) std::int32_t node[chunk_points + 16];
  alignas(64) cleave_status status[chunk_points];
};

/// A matrix as it is stored in rows: 3D all of it, 2D the block 00 01 10 11 and 22.
template <class T, int D>
struct Strain {
  Tile<T> in_plane[D][D];
  Tile<T> out_of_plane{};  ///< 2D only
};

/// F_n of a tile.
template <class T, int D>
CLEAVE_INLINE Strain<T, D> deformation_before(const ParticleView& set, const char* tile) {
  const char* at = tile + set.strain;
  const auto row = [&](int i) { return load<T>(at + i * CLEAVE_TILE_BYTES); };
  Strain<T, D> F;
  auto& f = F.in_plane;
  if (!set.stores_b) {
    for (int i = 0; i < D; i++)
      for (int j = 0; j < D; j++) f[i][j] = row(D * i + j);
    if constexpr (D == 2) F.out_of_plane = row(4);
    return F;
  }
  // What rounding leaves of a squared pivot that is nearly none.
  constexpr T least = 4 * std::numeric_limits<T>::epsilon();
  const Tile<T> xx = row(0), yy = row(1), zz = row(2);
  f[0][0] = square_root<T>(xx);
  f[0][1] = Tile<T>{};
  const Tile<T> xy = row(3);
  f[1][0] = xy / f[0][0];
  f[1][1] = square_root<T>(maximum<T>(yy - f[1][0] * f[1][0], least * yy));
  if constexpr (D == 3) {
    const Tile<T> xz = row(4), yz = row(5);
    f[0][2] = f[1][2] = Tile<T>{};
    f[2][0] = xz / f[0][0];
    f[2][1] = (yz - f[2][0] * f[1][0]) / f[1][1];
    f[2][2] = square_root<T>(maximum<T>(zz - f[2][0] * f[2][0] - f[2][1] * f[2][1], least * zz));
  } else {
    F.out_of_plane = square_root<T>(zz);
  }
  return F;
}

/// Weights for gather and scatter.
template <class T, int D>
CLEAVE_INLINE void weights_both_ways(const ParticleView& set, const char* tile, T* w, std::int32_t* node) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  tile_weights<T, D, false>(set, tile, w, node);
  if constexpr (D == 3)
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        store<T>(w + (W::plane + 3 * i + j) * lanes,
                 load<T>(w + (W::axis(0) + i) * lanes) * load<T>(w + (W::axis(1) + j) * lanes));
}

/// g = (1-r)(1-d)^2 + r of the tiles of a chunk, where the material has damage.
template <class T>
CLEAVE_INLINE void degrade_implicit(const ParticleView& set, const ImplicitView& view, const Chunk& chunk, T* law) {
  if (!view.degraded) return;
  constexpr int lanes = tile_lanes<T>;
  for (int k = 0; k < chunk.tiles; k++) {
    const Tile<T> d = load<T>(set.tiles + (chunk.first + k) * set.stride + set.damage);
    store<T>(law + (k * implicit_rows + implicit_degradation_row) * lanes, T(1) - T(1 - set.residual) * d * (T(2) - d));
  }
}

/// As `evaluate`, with F of the present velocities as stream 3.
template <class T, int D>
CLEAVE_INLINE void evaluate_at(const BoundLaw& law, const ParticleView& set, const ImplicitView& view, const Chunk& chunk,
                               T* scratch, cleave_status* status, BlockReport& report) {
  std::memset(status, 0, chunk_points * sizeof *status);
  cleave_batch batch;
  batch.struct_size = sizeof batch;
  batch.count = std::uint32_t(chunk.points);
  batch.layout = law.layout;
  batch.streams[0] = set.tiles + chunk.first * set.stride;
  batch.streams[1] = scratch;
  batch.streams[2] = set.constants;
  batch.streams[3] = view.deformation + chunk.first * (deformation_rows<D> * CLEAVE_TILE_BYTES);
  batch.time_step = view.time_step;
  batch.status = status;
  batch.message = nullptr;
  const cleave_result result = law.function(law.instance, &batch);
  note_status<T>(report, status, chunk.points, chunk.first * tile_lanes<T>, LawKind::elasticity);
  if (result != CLEAVE_OK && report.result == CLEAVE_OK) {
    report.result = result;
    if (report.slot == ~0ull) report.slot = chunk.first * tile_lanes<T>;
  }
}

/// C(u) of the points of a tile, from the records of a gather.
template <class T, int D>
CLEAVE_INLINE void velocity_gradient(const T* records, const T* w, T* rows, Tile<T> scale, Tile<T> (&C)[D][D]) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  records_to_lanes<T, D + 1>(records, rows);
  for (int a = 0; a < D; a++) {
    const Tile<T> offset = load<T>(w + (W::offset + a) * lanes);
    for (int i = 0; i < D; i++)
      C[i][a] = scale * (load<T>(rows + (5 + 4 * a + i) * lanes) + offset * load<T>(rows + (1 + i) * lanes));
  }
}

/// Calls each(tile of the chunk, F_n, C) with the strain before the step and the gradient of the velocities in the arena, times
/// `scale`. Weights stay in the scratch as the scatter wants them, g where the laws want it.
template <class T, int D, class F>
CLEAVE_INLINE void for_velocity_gradients(ImplicitScratch<T, D>& s, const ParticleView& set, const ImplicitView& view,
                                          const Chunk& chunk, Tile<T> scale, F&& each) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  for (int k = 0; k < chunk.tiles; k++)
    weights_both_ways<T, D>(set, set.tiles + (chunk.first + k) * set.stride, s.weights + k * (W::count * lanes),
                            s.node + k * lanes);
  gather_chunk<T, D>(s.gather_arena, s.weights, s.node, chunk.points, s.records);
  degrade_implicit<T>(set, view, chunk, s.law);
  for (int k = 0; k < chunk.tiles; k++) {
    Tile<T> C[D][D];
    velocity_gradient<T, D>(s.records + k * lanes * record_size, s.weights + k * (W::count * lanes), s.rows, scale, C);
    each(k, deformation_before<T, D>(set, set.tiles + (chunk.first + k) * set.stride), C);
  }
}

/// Row i, column j of A F_n.
template <class T, int D>
CLEAVE_INLINE Tile<T> times(const Tile<T> (&A)[D][D], const Strain<T, D>& F, int i, int j) {
  Tile<T> sum = A[i][0] * F.in_plane[0][j];
  for (int a = 1; a < D; a++) sum += A[i][a] * F.in_plane[a][j];
  return sum;
}

/// S (x_i - x_p) to the nodes, beside the mass.
template <class T, int D>
CLEAVE_INLINE void impulse_records(const T* w, Tile<T> mass, const Tile<T> (&S)[D][D], T* rows, T* records) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  store<T>(rows, mass);
  for (int i = 0; i < 3; i++) {
    Tile<T> q{};
    if (i < D)
      for (int a = 0; a < D; a++) q += S[i < D ? i : 0][a] * load<T>(w + (W::offset + a) * lanes);
    store<T>(rows + (1 + i) * lanes, q);
  }
  for (int a = 0; a < D; a++) {
    store<T>(rows + (4 + 4 * a) * lanes, Tile<T>{});
    for (int i = 0; i < 3; i++) store<T>(rows + (5 + 4 * a + i) * lanes, i < D ? S[i < D ? i : 0][a] : Tile<T>{});
  }
  lanes_to_records<T, D + 1>(rows, records);
}

/// P (or dP) F_n^T, from rows of the scratch.
template <class T, int D>
CLEAVE_INLINE void times_transposed(const T* P, const Strain<T, D>& F, Tile<T> scale, Tile<T> (&S)[D][D]) {
  constexpr int lanes = tile_lanes<T>;
  for (int i = 0; i < D; i++) {
    Tile<T> p[D];
    for (int j = 0; j < D; j++) p[j] = scale * load<T>(P + (D * i + j) * lanes);
    for (int a = 0; a < D; a++) {
      S[i][a] = p[0] * F.in_plane[a][0];
      for (int j = 1; j < D; j++) S[i][a] += p[j] * F.in_plane[a][j];
    }
  }
}

/// A^-T det A
template <class T, int D>
CLEAVE_INLINE void cofactor(const Tile<T> (&A)[D][D], Tile<T> (&H)[D][D]) {
  if constexpr (D == 3) {
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        H[i][j] = A[i1][j1] * A[i2][j2] - A[i1][j2] * A[i2][j1];
      }
  } else {
    H[0][0] = A[1][1];
    H[0][1] = -A[1][0];
    H[1][0] = -A[0][1];
    H[1][1] = A[0][0];
  }
}

// ------------------------------------------------------------------------------------------------- value and gradient

template <class T, int D>
void potential(const ParticleView& set, const BlockView& block, const ImplicitView& view, const T* velocity, T* gradient,
               void* scratch, BlockReport& report, double& energy) {
  auto& s = *static_cast<ImplicitScratch<T, D>*>(scratch);
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>, F_rows = deformation_rows<D>;
  load_arena<T, D>(velocity, block, s.gather_arena);
  const Tile<T> dt_gradient = everywhere(T(view.time_step * 4 / view.cell_size)), force = everywhere(T(view.force_scale)),
                density = everywhere(T(set.relative_density));
  double sum = 0;
  for_chunks<T>(
      set, block, [&](const Chunk& chunk) __attribute__((always_inline)) {
        const auto law_row = [&](int k, int row) { return s.law + (k * implicit_rows + row) * lanes; };
        for_velocity_gradients<T, D>(
            s, set, view, chunk,
            dt_gradient, [&](int k, const Strain<T, D>& before, Tile<T>(&A)[D][D]) __attribute__((always_inline)) {
              Tile<T> F[D][D];
              for (int i = 0; i < D; i++) A[i][i] += T(1);
              char* at = view.deformation + (chunk.first + k) * (F_rows * CLEAVE_TILE_BYTES);
              for (int i = 0; i < D; i++)
                for (int j = 0; j < D; j++) {
                  F[i][j] = times<T, D>(A, before, i, j);
                  store<T>(at + (D * i + j) * CLEAVE_TILE_BYTES, F[i][j]);
                }
              if constexpr (D == 2) store<T>(at + 4 * CLEAVE_TILE_BYTES, before.out_of_plane);
              if (view.piola) return;
              for (int i = 0; i < D; i++)
                for (int a = 0; a < D; a++) store<T>(law_row(k, implicit_delta_row + D * i + a), A[i][a]);
              if (!view.takes_b) return;
              constexpr int pair[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
              for (int c = 0; c < 6; c++) {
                const int i = pair[c][0], j = pair[c][1];
                Tile<T> b{};
                if (i < D && j < D)
                  for (int a = 0; a < D; a++) b += F[i < D ? i : 0][a] * F[j < D ? j : 0][a];
                else if (i == j)
                  b = before.out_of_plane * before.out_of_plane;
                store<T>(law_row(k, implicit_b_row + c), b);
              }
            });
        evaluate_at<T, D>(view.response, set, view, chunk, s.law, s.status, report);
        for (int k = 0; k < chunk.tiles; k++) {
          const char* tile = set.tiles + (chunk.first + k) * set.stride;
          const T* w = s.weights + k * (W::count * lanes);
          const Tile<T> volume = load<T>(tile + set.volume);
          if (view.energy) {
            const T *psi = law_row(k, implicit_energy_row), *V = reinterpret_cast<const T*>(tile + set.volume);
            for (int l = 0; l < lanes && k * lanes + l < chunk.points; l++) sum += double(psi[l]) * double(V[l]);
          }
          Tile<T> S[D][D];
          if (view.piola) {
            times_transposed<T, D>(law_row(k, 0), deformation_before<T, D>(set, tile), force * volume, S);
          } else {  // P F_n^T = tau A^-T
            constexpr int symmetric[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
            Tile<T> A[D][D], H[D][D];
            for (int i = 0; i < D; i++)
              for (int a = 0; a < D; a++) A[i][a] = load<T>(law_row(k, implicit_delta_row + D * i + a));
            cofactor<T, D>(A, H);
            Tile<T> det = A[0][0] * H[0][0];
            for (int a = 1; a < D; a++) det += A[0][a] * H[0][a];
            const Tile<T> scale = force * volume / det;
            for (int i = 0; i < D; i++)
              for (int a = 0; a < D; a++) {
                S[i][a] = load<T>(law_row(k, symmetric[i][0])) * H[0][a];
                for (int j = 1; j < D; j++) S[i][a] += load<T>(law_row(k, symmetric[i][j])) * H[j][a];
                S[i][a] *= scale;
              }
          }
          impulse_records<T, D>(w, volume * density, S, s.rows, s.records + k * lanes * record_size);
        }
        scatter<T, D>(s.scatter_arena, s.records, s.weights, s.node, chunk.points);
      });
  energy = sum * view.energy_scale;
  merge_arena<T, D>(gradient, block, s.scatter_arena);
}

// ------------------------------------------------------------------------------------------------- Hessian

template <class T, int D>
void product(const ParticleView& set, const BlockView& block, const ImplicitView& view, const T* direction, T* out,
             void* scratch) {
  auto& s = *static_cast<ImplicitScratch<T, D>*>(scratch);
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>;
  load_arena<T, D>(direction, block, s.gather_arena);
  const Tile<T> dt_gradient = everywhere(T(view.time_step * 4 / view.cell_size)), force = everywhere(T(view.force_scale)),
                density = everywhere(T(set.relative_density));
  BlockReport unread;
  for_chunks<T>(
      set, block, [&](const Chunk& chunk) __attribute__((always_inline)) {
        const auto law_row = [&](int k, int row) { return s.law + (k * implicit_rows + row) * lanes; };
        for_velocity_gradients<T, D>(
            s, set, view, chunk,
            dt_gradient, [&](int k, const Strain<T, D>& before, Tile<T>(&C)[D][D]) __attribute__((always_inline)) {
              for (int i = 0; i < D; i++)
                for (int j = 0; j < D; j++) store<T>(law_row(k, implicit_delta_row + D * i + j), times<T, D>(C, before, i, j));
            });
        evaluate_at<T, D>(view.differential, set, view, chunk, s.law, s.status, unread);
        for (int k = 0; k < chunk.tiles; k++) {
          const char* tile = set.tiles + (chunk.first + k) * set.stride;
          const Tile<T> volume = load<T>(tile + set.volume);
          Tile<T> S[D][D];
          times_transposed<T, D>(law_row(k, 0), deformation_before<T, D>(set, tile), force * volume, S);
          impulse_records<T, D>(s.weights + k * (W::count * lanes), volume * density, S, s.rows,
                                s.records + k * lanes * record_size);
        }
        scatter<T, D>(s.scatter_arena, s.records, s.weights, s.node, chunk.points);
      });
  merge_arena<T, D>(out, block, s.scatter_arena);
}

/// The tangent a_iakb = (dP((e_k e_b^T) F_n) F_n^T)_ia of each point, times k V dt 4/dx, into the octants of the blocks (if
/// any) and as sum w^2 r_a r_b a_iakb into the blocks of the nodes.
template <class T, int D>
void tangent(const ParticleView& set, const BlockView& block, const ImplicitView& view, T* diagonal, T* octants,
             void* scratch) {
  auto& s = *static_cast<ImplicitScratch<T, D>*>(scratch);
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>, n = D * D, packed = tangent_numbers<D>, arena = GridShape<D>::arena_edge;
  constexpr int half = GridShape<D>::block_edge / 2, row = CLEAVE_TILE_BYTES;
  const auto upper = [](int i, int j) { return i <= j ? i * n - i * (i - 1) / 2 + j - i : j * n - j * (j - 1) / 2 + i - j; };
  const Tile<T> scale = everywhere(T(view.force_scale * view.time_step * 4 / view.cell_size));
  BlockReport unread;
  for_chunks<T>(
      set, block, [&](const Chunk& chunk) __attribute__((always_inline)) {
        const auto law_row = [&](int k, int r) { return s.law + (k * implicit_rows + r) * lanes; };
        const auto tangent_row = [&](int k, int c) { return s.tangent + (k * packed + c) * lanes; };
        degrade_implicit<T>(set, view, chunk, s.law);
        for (int column = 0; column < n; column++) {
          for (int k = 0; k < chunk.tiles; k++) {
            const Strain<T, D> before = deformation_before<T, D>(set, set.tiles + (chunk.first + k) * set.stride);
            for (int i = 0; i < D; i++)
              for (int j = 0; j < D; j++)
                store<T>(law_row(k, implicit_delta_row + D * i + j),
                         i == column / D ? before.in_plane[column % D][j] : Tile<T>{});
          }
          evaluate_at<T, D>(view.differential, set, view, chunk, s.law, s.status, unread);
          for (int k = 0; k < chunk.tiles; k++) {
            const char* tile = set.tiles + (chunk.first + k) * set.stride;
            Tile<T> S[D][D];
            times_transposed<T, D>(law_row(k, 0), deformation_before<T, D>(set, tile), scale * load<T>(tile + set.volume), S);
            for (int i = 0; i <= column; i++) store<T>(tangent_row(k, upper(i, column)), S[i / D][i % D]);
          }
        }
        for (int k = 0; k < chunk.tiles; k++) {
          const char* tile = set.tiles + (chunk.first + k) * set.stride;
          T* w = s.weights + k * (W::count * lanes);
          tile_weights<T, D, false>(set, tile, w, s.node + k * lanes);
          const int points = chunk.points - k * lanes < lanes ? chunk.points - k * lanes : lanes;
          for (int l = 0; octants && l < points; l++) {
            int grid_block = 0, octant = 0;
            for (int a = 0; a < D; a++) {
              const T x = reinterpret_cast<const T*>(tile + set.position + a * row)[l];
              const int at = x < T(0) ? -1 : int(x) / half;  // in halves of the home block
              grid_block = grid_block * 3 + (at < 0 ? 0 : at < 2 ? 1 : 2);
              octant = octant * 2 + (at & 1);
            }
            T* sum = octants + (std::size_t(block.neighbours[grid_block]) * (1 << D) + octant) * packed;
            for (int c = 0; c < packed; c++) sum[c] += tangent_row(k, c)[l];
          }
          constexpr int entries = D * (D + 1) / 2;
          constexpr int first[6] = {0, 0, 0, 1, 1, 2}, second[6] = {0, 1, 2, 1, 2, 2};  // upper triangle
          constexpr int plane_first[3] = {0, 0, 1}, plane_second[3] = {0, 1, 1};
          const auto one = [&](int e) { return D == 3 ? first[e] : plane_first[e < 3 ? e : 0]; };
          const auto two = [&](int e) { return D == 3 ? second[e] : plane_second[e < 3 ? e : 0]; };
          // coefficient of r_a r_b in entry (i, k) of a node's block: a_iakb + a_ibka
          Tile<T> coefficient[entries][entries];
          for (int e = 0; e < entries; e++)
            for (int m = 0; m < entries; m++) {
              const int i = one(e), j = two(e), a = one(m), b = two(m);
              coefficient[e][m] = load<T>(tangent_row(k, upper(i * D + a, j * D + b)));
              if (a != b) coefficient[e][m] += load<T>(tangent_row(k, upper(i * D + b, j * D + a)));
            }
          alignas(64) T block_rows[8 * lanes] = {};
          const auto weight = [&](int axis, int i) { return load<T>(w + (W::axis(axis) + i) * lanes); };
          const auto offset = [&](int axis, int i) { return load<T>(w + (W::offset + axis) * lanes) + T(i - 1); };
          for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
              for (int l = 0; l < (D == 3 ? 3 : 1); l++) {
                Tile<T> product = weight(0, i) * weight(1, j), r[3] = {offset(0, i), offset(1, j), Tile<T>{}};
                if constexpr (D == 3) {
                  product *= weight(2, l);
                  r[2] = offset(2, l);
                }
                product *= product;
                Tile<T> monomial[entries];
                for (int m = 0; m < entries; m++) monomial[m] = product * r[one(m)] * r[two(m)];
                for (int e = 0; e < entries; e++) {
                  Tile<T> sum = coefficient[e][0] * monomial[0];
                  for (int m = 1; m < entries; m++) sum += coefficient[e][m] * monomial[m];
                  store<T>(block_rows + e * lanes, sum);
                }
                const int step = D == 3 ? (i * arena + j) * arena + l : i * arena + j;
                for (int p = 0; p < points; p++) {
                  T* to = s.diagonal_arena + (s.node[k * lanes + p] + step) * diagonal_numbers;
                  for (int e = 0; e < entries; e++) to[e] += block_rows[e * lanes + p];
                }
              }
        }
      });
  for_arena_rows<D>(block, [&](std::uint32_t b, int node, int at, auto count) {
    constexpr int numbers = decltype(count)::value * diagonal_numbers;
    T* from = s.diagonal_arena + at * diagonal_numbers;
    T* to = diagonal + (std::size_t(b) * GridShape<D>::block_nodes + node) * diagonal_numbers;
    for (int i = 0; i < numbers; i++) to[i] += from[i];
    std::memset(from, 0, numbers * sizeof(T));
  });
}

template <class T, int D>
ImplicitKernels<T, D> table() {
  return {sizeof(ImplicitScratch<T, D>), potential<T, D>, product<T, D>, tangent<T, D>};
}

}  // namespace
}  // namespace cleave::mpm::kernel

cleave::mpm::KernelTable<cleave::mpm::ImplicitKernels> cleave::mpm::implicit_kernels() {
  return {kernel::table<float, 2>(), kernel::table<float, 3>(), kernel::table<double, 2>(), kernel::table<double, 3>()};
}
