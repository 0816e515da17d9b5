#pragma once

// Between the particles of a chunk and the nodes of an arena: four numbers per node, one record of 16 per particle
// (see transpose.hpp), weights as `tile_weights` stores them.

#include "mpm/kernels/tiles.hpp"
#include "mpm/kernels/transpose.hpp"

namespace cleave::mpm::kernel {
namespace {

// ------------------------------------------------------------------------------------------------- scatter

/// Adds records to the arena. Particles are sorted by cell, so that the stencil stays in registers over a run of them.
template <class T, int D>
CLEAVE_INLINE void scatter(T* arena, const T* records, const T* weights, const std::int32_t* node, int count) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>, edge = GridShape<D>::arena_edge, nrows = D == 3 ? 9 : 3;
  int p = 0;
  while (p < count) {
    const std::int32_t first = node[p];
    Row<T> sum[nrows];
    for (auto& s : sum) s = Row<T>::zero();
    do {
      const T* r = records + p * record_size;
      const T* w = weights + (p / lanes) * (W::count * lanes) + p % lanes;
      const Row<T> last = Row<T>::weights(w + W::axis(D - 1) * lanes, lanes);
      if constexpr (D == 3) {
        Row<T> x = last * Row<T>::repeat(r + 4), y = last * Row<T>::repeat(r + 8);
        Row<T> q = last * Row<T>::add_offset(Row<T>::repeat(r + 12), Row<T>::repeat(r));
        x.pin();
        y.pin();
        q.pin();
        for (int i = 0; i < 3; i++) {
          const Row<T> qi = i == 0 ? q - x : i == 1 ? q : q + x;
          sum[3 * i] = Row<T>::multiply_add(w[(W::plane + 3 * i) * lanes], qi - y, sum[3 * i]);
          sum[3 * i + 1] = Row<T>::multiply_add(w[(W::plane + 3 * i + 1) * lanes], qi, sum[3 * i + 1]);
          sum[3 * i + 2] = Row<T>::multiply_add(w[(W::plane + 3 * i + 2) * lanes], qi + y, sum[3 * i + 2]);
        }
      } else {
        Row<T> x = last * Row<T>::repeat(r + 4);
        Row<T> q = last * Row<T>::add_offset(Row<T>::repeat(r + 8), Row<T>::repeat(r));
        x.pin();
        q.pin();
        sum[0] = Row<T>::multiply_add(w[0], q - x, sum[0]);
        sum[1] = Row<T>::multiply_add(w[lanes], q, sum[1]);
        sum[2] = Row<T>::multiply_add(w[2 * lanes], q + x, sum[2]);
      }
      p++;
    } while (p < count && node[p] == first);
    T* a = arena + first * 4;
    for (int i = 0; i < nrows; i++) {
      T* at = a + (D == 3 ? (i / 3) * edge * edge + (i % 3) * edge : i * edge) * 4;
      (Row<T>::load(at) + sum[i]).store(at);
    }
  }
}

// ------------------------------------------------------------------------------------------------- gather

/// `Together` particles at a time: their chains of dependent additions hide each other's latency.
template <class T, int D, int Together>
CLEAVE_INLINE void gather(const T* arena, const T* weights, const std::int32_t* node, int p, T* records) {
  using W = WeightRows<D>;
  constexpr int lanes = tile_lanes<T>, edge = GridShape<D>::arena_edge, N = Together;
  const T* w[N];
  const T* g[N];
  for (int u = 0; u < N; u++) {
    w[u] = weights + ((p + u) / lanes) * (W::count * lanes) + (p + u) % lanes;
    g[u] = arena + node[p + u] * 4;
  }
  const auto weight = [&](int u, int axis, int i) { return w[u][(W::axis(axis) + i) * lanes]; };
  Row<T> low[N], value[N], slope_x[N], slope_y[N], last[N];
  if constexpr (D == 3) {
    Row<T> sum[3][N], slope[3][N];
    for (int i = 0; i < 3; i++) {
      const int at = i * edge * edge * 4;
      const auto node_row = [&](int u, int j) { return Row<T>::load(g[u] + at + j * edge * 4); };
      for (int u = 0; u < N; u++) low[u] = weight(u, 1, 0) * node_row(u, 0);
      for (int u = 0; u < N; u++) low[u].pin();
      for (int u = 0; u < N; u++) sum[i][u] = Row<T>::multiply_add(weight(u, 1, 1), node_row(u, 1), low[u]);
      for (int u = 0; u < N; u++) slope[i][u] = Row<T>::multiply_subtract(weight(u, 1, 2), node_row(u, 2), low[u]);
      for (int u = 0; u < N; u++) sum[i][u] = Row<T>::multiply_add(weight(u, 1, 2), node_row(u, 2), sum[i][u]);
    }
    for (int u = 0; u < N; u++) last[u] = Row<T>::weights(w[u] + W::axis(2) * lanes, lanes);
    for (int u = 0; u < N; u++) low[u] = weight(u, 0, 0) * sum[0][u];
    for (int u = 0; u < N; u++) low[u].pin();
    for (int u = 0; u < N; u++) slope_y[u] = weight(u, 0, 2) * slope[2][u];
    for (int u = 0; u < N; u++) value[u] = Row<T>::multiply_add(weight(u, 0, 1), sum[1][u], low[u]);
    for (int u = 0; u < N; u++) slope_x[u] = Row<T>::multiply_subtract(weight(u, 0, 2), sum[2][u], low[u]);
    for (int u = 0; u < N; u++) slope_y[u] = Row<T>::multiply_add(weight(u, 0, 1), slope[1][u], slope_y[u]);
    for (int u = 0; u < N; u++) value[u] = Row<T>::multiply_add(weight(u, 0, 2), sum[2][u], value[u]);
    for (int u = 0; u < N; u++) slope_y[u] = Row<T>::multiply_add(weight(u, 0, 0), slope[0][u], slope_y[u]);
    for (int u = 0; u < N; u++) Row<T>::reduce(records + (p + u) * record_size, last[u], value[u], slope_x[u], slope_y[u]);
  } else {
    const auto node_row = [&](int u, int i) { return Row<T>::load(g[u] + i * edge * 4); };
    for (int u = 0; u < N; u++) last[u] = Row<T>::weights(w[u] + W::axis(1) * lanes, lanes);
    for (int u = 0; u < N; u++) low[u] = weight(u, 0, 0) * node_row(u, 0);
    for (int u = 0; u < N; u++) low[u].pin();
    for (int u = 0; u < N; u++) value[u] = Row<T>::multiply_add(weight(u, 0, 1), node_row(u, 1), low[u]);
    for (int u = 0; u < N; u++) slope_x[u] = Row<T>::multiply_subtract(weight(u, 0, 2), node_row(u, 2), low[u]);
    for (int u = 0; u < N; u++) value[u] = Row<T>::multiply_add(weight(u, 0, 2), node_row(u, 2), value[u]);
    for (int u = 0; u < N; u++) Row<T>::reduce(records + (p + u) * record_size, last[u], value[u], slope_x[u]);
  }
}

template <class T, int D>
CLEAVE_INLINE void gather_chunk(const T* arena, const T* weights, const std::int32_t* node, int count, T* records) {
  constexpr int together = sizeof(T) == 4 && register_bytes == 64 ? 2 : 1;  // of whom there are registers enough
  int p = 0;
  for (; p + together <= count; p += together) gather<T, D, together>(arena, weights, node, p, records);
  for (; p < count; p++) gather<T, D, 1>(arena, weights, node, p, records);
  // lanes beyond the last particle feel no velocity, so that they keep finite values
  const int end = (count + tile_lanes<T> - 1) / tile_lanes<T> * tile_lanes<T>;
  if (p < end) std::memset(records + p * record_size, 0, sizeof(T) * record_size * (end - p));
}

}  // namespace
}  // namespace cleave::mpm::kernel
