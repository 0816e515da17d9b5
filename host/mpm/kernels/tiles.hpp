#pragma once

// What the kernels share: one vector per component of a tile, the arena of a home block, weights of the quadratic stencil,
// calls of laws. Included once per instruction set; everything is internal to the file that includes it.

#include "mpm/kernels/kernels.hpp"
#include "mpm/kernels/row.hpp"

#include <cstring>
#include <type_traits>

namespace cleave::mpm::kernel {
namespace {

template <class T>
struct TileTypes;
template <>
struct TileTypes<float> {
  typedef float Real __attribute__((vector_size(register_bytes)));
  using Mask = decltype(Real{} < Real{});
  typedef std::int32_t Index __attribute__((vector_size(register_bytes)));
};
template <>
struct TileTypes<double> {
  typedef double Real __attribute__((vector_size(register_bytes)));
  using Mask = decltype(Real{} < Real{});
  typedef std::int32_t Index __attribute__((vector_size(register_bytes / 2)));
};

/// One component of one tile: 16 floats or 8 doubles.
template <class T>
using Tile = Registers<typename TileTypes<T>::Real, int(CLEAVE_TILE_BYTES) / register_bytes>;
/// As much of it as one register holds. A loop over parts keeps many components in registers, where whole tiles of them would
/// not fit; where a register holds a whole tile, it is the same type.
template <class T>
using Part = Registers<typename TileTypes<T>::Real, 1>;

/// Functions of tiles are called with the type of their numbers, those of parts with Part<T>.
template <class T>
struct VectorOf {
  using Number = T;
  using type = Tile<T>;
};
template <class R, int Count>
struct VectorOf<Registers<R, Count>> {
  using type = Registers<R, Count>;
  using Number = typename type::Number;
};
template <class V>
using Vector = typename VectorOf<V>::type;
template <class V>
using NumberOf = typename VectorOf<V>::Number;
/// What comparing tiles gives: combined by & | ~, looked at by `any`, used by `select`; m[lane] is true or false.
template <class V>
using TileMask = Registers<typename TileTypes<NumberOf<V>>::Mask, Vector<V>::count>;
/// One 32-bit integer per lane: + and * with integers.
template <class V>
using TileIndex = Registers<typename TileTypes<NumberOf<V>>::Index, Vector<V>::count>;

template <class V>
CLEAVE_INLINE Vector<V> load(const void* p) {
  return *static_cast<const Vector<V>*>(p);
}
template <class V>
CLEAVE_INLINE void store(void* p, const Vector<V>& v) {
  *static_cast<Vector<V>*>(p) = v;
}
/// A number for all lanes of a tile, or of V.
template <class V = void, class T>
CLEAVE_INLINE auto everywhere(T x) {
  return x - Vector<std::conditional_t<std::is_void_v<V>, T, V>>{};
}
/// yes where m, no elsewhere
template <class V>
CLEAVE_INLINE Vector<V> select(const TileMask<V>& m, const Vector<V>& yes, const Vector<V>& no) {
  return Vector<V>::map(
      [](auto c, auto a, auto b) __attribute__((always_inline)) { return c ? a : b; }, m, yes, no);
}
template <class V>
CLEAVE_INLINE Vector<V> maximum(const Vector<V>& a, const Vector<V>& b) {
  return select<V>(a > b, a, b);
}
template <class V>
CLEAVE_INLINE Vector<V> minimum(const Vector<V>& a, const Vector<V>& b) {
  return select<V>(a < b, a, b);
}
template <class V>
CLEAVE_INLINE Vector<V> magnitude(const Vector<V>& a) {
  return select<V>(a < NumberOf<V>(0), -a, a);
}
template <class V>
CLEAVE_INLINE Vector<V> square_root(const Vector<V>& x) {
  return Vector<V>::map(
      [](auto a) __attribute__((always_inline)) {
        for (int l = 0; l < Vector<V>::each; l++) a[l] = __builtin_sqrt(a[l]);
        return a;
      },
      x);
}
/// Truncated towards zero.
template <class V>
CLEAVE_INLINE TileIndex<V> to_index(const Vector<V>& x) {
  using I = typename TileIndex<V>::Register;
  return Vector<V>::map(
      [](auto a) __attribute__((always_inline)) { return __builtin_convertvector(a, I); }, x);
}
template <class V>
CLEAVE_INLINE Vector<V> from_index(const TileIndex<V>& i) {
  using R = typename Vector<V>::Register;
  return Vector<V>::map(
      [](auto a) __attribute__((always_inline)) { return __builtin_convertvector(a, R); }, i);
}
template <class V>
CLEAVE_INLINE void store_index(std::int32_t* p, const TileIndex<V>& i) {
  *reinterpret_cast<TileIndex<V>*>(p) = i;
}
template <class R, int Count>
CLEAVE_INLINE bool any(const Registers<R, Count>& m) {
  R all = m.r[0];
  for (int i = 1; i < Count; i++) all |= m.r[i];
  return any_bit(all);
}

template <class T>
inline constexpr int chunk_tiles = chunk_points / tile_lanes<T>;

/// Rows of weights per tile: one-dimensional weights of each axis, the products of the leading two axes, and the offsets.
template <int D>
struct WeightRows {
  static constexpr int axis(int a) { return 3 * a; }
  static constexpr int plane = 3 * D;                        // 3D only: wx_i wy_j
  static constexpr int offset = D == 3 ? plane + 9 : plane;  // D rows: middle node minus particle
  static constexpr int count = offset + D;
};

// ------------------------------------------------------------------------------------------------- arena

/// The arena is the home block with its slack: nodes -1 .. edge+2 of the home block's coordinates along each axis.
/// Visits runs of nodes along the last axis that are contiguous both in the arena and in a grid block.
template <int D, class F>
CLEAVE_INLINE void for_arena_rows(const BlockView& block, F&& run) {
  using S = GridShape<D>;
  constexpr int edge = S::block_edge, arena = S::arena_edge;
  const auto rows = [&](const std::uint32_t* neighbours, int grid_row, int arena_row) {
    // the last axis spans three blocks: one node of the first, all of the second, three of the third
    run(neighbours[0], (grid_row * edge + edge - 1), arena_row * arena, std::integral_constant<int, 1>{});
    run(neighbours[1], (grid_row * edge), arena_row * arena + 1, std::integral_constant<int, edge>{});
    run(neighbours[2], (grid_row * edge), arena_row * arena + 1 + edge, std::integral_constant<int, 3>{});
  };
  if constexpr (D == 3) {
    for (int ax = 0; ax < arena; ax++)
      for (int ay = 0; ay < arena; ay++) {
        const int gx = ax + edge - 1, gy = ay + edge - 1;
        rows(block.neighbours + (gx / edge) * 9 + (gy / edge) * 3, (gx % edge) * edge + gy % edge, ax * arena + ay);
      }
  } else {
    for (int ax = 0; ax < arena; ax++) {
      const int gx = ax + edge - 1;
      rows(block.neighbours + (gx / edge) * 3, gx % edge, ax);
    }
  }
}

/// Replaces `Bytes` bytes at `to` by f(what is there, what is at `from`), in the widest pieces there are. Copies, because rows
/// of the arena are aligned to nodes only, and a template parameter does not carry the alignment of a type.
template <class T, int Bytes, class F>
CLEAVE_INLINE void for_pieces(T* to, const T* from, F&& f) {
  typedef T Quarter __attribute__((vector_size(16)));
  int at = 0;
  const auto visit = [&](auto piece) __attribute__((always_inline)) {
    constexpr int size = int(sizeof piece);
    for (; Bytes - at >= size; at += size) {
      auto there = piece, here = piece;
      std::memcpy(&there, reinterpret_cast<const char*>(to) + at, size);
      std::memcpy(&here, reinterpret_cast<const char*>(from) + at, size);
      there = f(there, here);
      std::memcpy(reinterpret_cast<char*>(to) + at, &there, size);
    }
  };
  if constexpr (register_bytes == 64) {
    typedef T Whole __attribute__((vector_size(64)));
    visit(Whole{});
  }
  if constexpr (register_bytes >= 32) {
    typedef T Half __attribute__((vector_size(32)));
    visit(Half{});
  }
  visit(Quarter{});
}

template <class T, int D>
CLEAVE_INLINE void load_arena(const T* grid, const BlockView& block, T* arena) {
  for_arena_rows<D>(block, [&](std::uint32_t b, int node, int at, auto n) {
    constexpr int bytes = decltype(n)::value * 4 * int(sizeof(T));
    for_pieces<T, bytes>(arena + at * 4, grid + (std::size_t(b) * GridShape<D>::block_nodes + node) * 4,
                         [](const auto&, const auto& value) { return value; });
  });
}

/// Adds the arena to the grid and clears it. Home blocks of one colour reach disjoint nodes. Nodes without mass are skipped:
/// the slack around the block is mostly empty.
template <class T, int D>
CLEAVE_INLINE void merge_arena(T* grid, const BlockView& block, T* arena) {
  for_arena_rows<D>(block, [&](std::uint32_t b, int node, int at, auto n) {
    constexpr int count = decltype(n)::value, bytes = count * 4 * int(sizeof(T));
    T* from = arena + at * 4;
    T mass = 0;
    for (int i = 0; i < count; i++) mass += from[4 * i];
    if (!(mass > T(0))) return;
    for_pieces<T, bytes>(grid + (std::size_t(b) * GridShape<D>::block_nodes + node) * 4, from,
                         [](const auto& sum, const auto& value) { return sum + value; });
    std::memset(from, 0, bytes);
  });
}

// ------------------------------------------------------------------------------------------------- weights

template <class T, int D, bool Planes>
CLEAVE_INLINE void tile_weights(const ParticleView& set, const char* tile, T* w, std::int32_t* node) {
  using R = WeightRows<D>;
  using V = Part<T>;
  constexpr int lanes = tile_lanes<T>;
  constexpr int arena = GridShape<D>::arena_edge;
  for (int lane = 0; lane < lanes; lane += V::lanes, tile += sizeof(V), w += V::lanes) {
    TileIndex<V> index{};
    V one_axis[D][3];
    for (int a = 0; a < D; a++) {
      const V x = load<V>(tile + set.position + a * CLEAVE_TILE_BYTES);
      // arena nodes start at -1, and x > -1/2: truncation is floor
      const TileIndex<V> i = to_index<V>(x + T(0.5));
      index = index * arena + i;
      const V q = x - from_index<V>(i);  // particle minus middle node
      const V lower = T(0.5) - q, upper = T(0.5) + q;
      one_axis[a][0] = T(0.5) * lower * lower;
      one_axis[a][1] = T(0.75) - q * q;
      one_axis[a][2] = T(0.5) * upper * upper;
      store<V>(w + (R::offset + a) * lanes, -q);
    }
    store_index<V>(node + lane, index);
    for (int a = 0; a < D; a++)
      if (!Planes || D == 2 || a == D - 1)
        for (int i = 0; i < 3; i++) store<V>(w + (R::axis(a) + i) * lanes, one_axis[a][i]);
    if constexpr (Planes && D == 3)
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) store<V>(w + (R::plane + 3 * i + j) * lanes, one_axis[0][i] * one_axis[1][j]);
  }
}

// ------------------------------------------------------------------------------------------------- laws

template <class T>
CLEAVE_INLINE void note_status(BlockReport& report, const cleave_status* status, int count, std::uint64_t first_slot,
                               LawKind law) {
  for (int k = 0; k < count; k++)
    if (status[k] > report.status || (status[k] == report.status && status[k] > 0 && first_slot + k < report.slot)) {
      report.status = status[k];
      report.slot = first_slot + k;
      report.failed = law;
    }
}

/// Calls a law for `count` points from `tile` on. `scratch` is stream 1, `status` has room for a chunk.
template <class T>
CLEAVE_INLINE void evaluate(const BoundLaw& law, LawKind kind, const ParticleView& set, std::uint64_t tile, int count,
                            double time_step, T* scratch, cleave_status* status, BlockReport& report) {
  std::memset(status, 0, chunk_points * sizeof *status);
  cleave_batch batch;
  batch.struct_size = sizeof batch;
  batch.count = std::uint32_t(count);
  batch.layout = law.layout;
  batch.streams[0] = set.tiles + tile * set.stride;
  batch.streams[1] = scratch;
  batch.streams[2] = set.constants;
  batch.streams[3] = nullptr;
  batch.time_step = time_step;
  batch.status = status;
  batch.message = nullptr;
  const cleave_result result = law.function(law.instance, &batch);
  std::uint64_t raised[chunk_points / 8], any_raised = 0;
  static_assert(sizeof raised == chunk_points * sizeof *status);
  std::memcpy(raised, status, sizeof raised);
  for (auto r : raised) any_raised |= r;
  if (__builtin_expect(any_raised != 0, 0)) note_status<T>(report, status, count, tile * tile_lanes<T>, kind);
  if (__builtin_expect(result != CLEAVE_OK && report.result == CLEAVE_OK, 0)) {
    report.result = result;
    report.failed = kind;
    if (report.slot == ~0ull) report.slot = tile * tile_lanes<T>;
  }
}

/// The tiles of a block that one plugin call works on.
struct Chunk {
  std::uint64_t first;  ///< tile
  int tiles, points;
};

CLEAVE_INLINE void prefetch_tiles(const char* tiles, std::uint64_t first, std::uint64_t last, std::uint32_t stride) {
  for (const char *p = tiles + first * stride, *end = tiles + last * stride; p < end; p += 64) __builtin_prefetch(p);
}

/// Calls work(chunk) for every chunk of a block, while the next one is on its way from memory.
template <class T, class F>
CLEAVE_INLINE void for_chunks(const ParticleView& set, const BlockView& block, F&& work) {
  constexpr int lanes = tile_lanes<T>, most = chunk_tiles<T>;
  const int tiles = int((block.count + lanes - 1) / lanes);
  const auto length = [&](int tile) { return tile + most < tiles ? most : tiles - tile; };
  for (int t = 0; t < tiles; t += most) {
    const Chunk chunk{block.first_tile + std::uint64_t(t), length(t),
                      int(block.count) - t * lanes < chunk_points ? int(block.count) - t * lanes : chunk_points};
    const std::uint64_t next = chunk.first + std::uint64_t(chunk.tiles);
    prefetch_tiles(set.tiles, next, next + std::uint64_t(length(t + chunk.tiles)), set.stride);
    work(chunk);
  }
}

}  // namespace
}  // namespace cleave::mpm::kernel
