/// The rows of B: the mean rate of stretch of the fibres around each grid cell.
#pragma once

#include <cleave/projection.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace inextensibility {

/// With Gamma_z linear between the centres of cells, 1 at that of cell z, and N_i quadratic at the nodes,
///
///   B_(z, i alpha) = sum_p V_p Gamma_z(x_p) a_alpha (a . grad N_i(x_p))          [Wolper et al. 2020, eq. 22]
///
/// a unit fibre a of a particle at x in cell z or within half a cell of it has a part in the rows of the 2^D cells around it,
/// and each row reaches the 4^D nodes from z - 1 to z + 2.
template <unsigned D>
class FiberRows {
 public:
  explicit FiberRows(const cleave_constraint_system& system) : system_(system), row_of_corner_(system.node_count, no_row) {}

  /// A particle with the unit fibre a, as it is at present, of which the length is exp(strain) of what it should be.
  void add(std::uint64_t particle, const std::array<double, 3>& a, double strain) {
    std::array<std::array<double, 4>, D> N{}, dN{}, Gamma{};
    std::array<std::int32_t, D> base;
    for (unsigned k = 0; k < D; ++k) {
      const double x = system_.position[particle * D + k], from = x - 0.5, f = from - std::floor(from);  // of the first node
      base[k] = std::int32_t(std::floor(from));
      const double scale = a[k] / system_.cell_size;
      N[k] = {0.5 * (1 - f) * (1 - f), 0.5 + f * (1 - f), 0.5 * f * f, 0};
      dN[k] = {(f - 1) * scale, (1 - 2 * f) * scale, f * scale, 0};
      Gamma[k] = {1 - f, f};
    }
    // The derivatives along the fibre; the last axis has a place before the first node, to be shifted by a cell
    constexpr unsigned planes = D == 3 ? 9 : 3;
    std::array<std::array<double, 5>, planes> slope{};
    for (unsigned n = 0; n < planes; ++n) {
      const unsigned i = D == 3 ? n / 3 : n, j = n % 3;
      for (unsigned k = 0; k < 3; ++k) {
        if constexpr (D == 3)
          slope[n][1 + k] = (dN[0][i] * N[1][j] + N[0][i] * dN[1][j]) * N[2][k] + N[0][i] * N[1][j] * dN[2][k];
        else
          slope[n][1 + k] = dN[0][i] * N[1][k] + N[0][i] * dN[1][k];
      }
    }
    const std::uint64_t* nodes = system_.nodes + particle * stencil;
    for (unsigned corner = 0; corner < (1u << D); ++corner) {
      std::array<unsigned, 3> o{};
      double weight = system_.volume[particle];
      unsigned at = 0;
      for (unsigned k = 0; k < D; ++k) {
        o[k] = corner >> (D - 1 - k) & 1;
        weight *= Gamma[k][o[k]];
        at = at * 3 + o[k];
      }
      // Within the rounding of a position a cell may begin with a node that no mass has reached.
      if (!(weight > 0) || !is_at(nodes[at], base, o)) continue;
      Row& row = row_of(nodes[at]);
      row.strain += weight * strain;
      for (unsigned n = 0; n < planes; ++n) {
        const unsigned i = (D == 3 ? n / 3 : n) + 1 - o[0], j = n % 3 + 1 - o[1];
        const unsigned to = D == 3 ? (i * 4 + j) * 4 : i * 4;
        const unsigned shift = o[D - 1];  // 1: the stencil begins at the first node of the row, 0: one later
        const double* from = slope[n].data() + shift;
        for (unsigned k = 0; k < 4; ++k)
          for (unsigned c = 0; c < D; ++c) row.value[c][to + k] += weight * a[c] * from[k];
        for (unsigned k = 0; k < 3; ++k) row.node[to + k + 1 - shift] = nodes[n * 3 + k];
      }
    }
  }

  /// `rate`: of the strain there is, how much is to be taken back per second.
  void write(cleave::Projection& projection, double rate) const {
    for (std::uint64_t corner = 0; corner < system_.node_count; ++corner) {
      if (row_of_corner_[corner] == no_row) continue;
      const Row& row = rows_[row_of_corner_[corner]];
      std::array<std::int32_t, 3> cell{};
      for (unsigned k = 0; k < D; ++k) cell[k] = system_.node_cell[corner * D + k];
      projection.begin_row({.correction = -rate * row.strain, .cell = cell});
      for (unsigned n = 0; n < width; ++n)
        if (row.value[0][n] != 0 || row.value[1][n] != 0 || row.value[D - 1][n] != 0)
          projection.add(row.node[n], {row.value[0][n], row.value[1][n], D == 3 ? row.value[D - 1][n] : 0});
    }
  }

 private:
  static constexpr std::uint32_t no_row = ~std::uint32_t(0);
  static constexpr unsigned stencil = D == 3 ? 27 : 9, width = D == 3 ? 64 : 16;
  struct Row {
    std::array<std::uint64_t, width> node{};
    std::array<std::array<double, width>, D> value{};
    double strain = 0;
  };

  bool is_at(std::uint64_t node, const std::array<std::int32_t, D>& base, const std::array<unsigned, 3>& offset) const {
    for (unsigned k = 0; k < D; ++k)
      if (system_.node_cell[node * D + k] != base[k] + std::int32_t(offset[k])) return false;
    return true;
  }
  Row& row_of(std::uint64_t corner) {
    std::uint32_t& row = row_of_corner_[corner];
    if (row == no_row) {
      row = std::uint32_t(rows_.size());
      rows_.emplace_back();
    }
    return rows_[row];
  }

  const cleave_constraint_system& system_;
  std::vector<std::uint32_t> row_of_corner_;  // by the node at the lower corner of the cell
  std::vector<Row> rows_;
};

}  // namespace inextensibility
