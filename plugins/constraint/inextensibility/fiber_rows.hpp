/// The rows of B: the mean rate of stretch of the fibres around each place of a multiplier.
#pragma once

#include <cleave/projection.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace inextensibility {

/// Where the multipliers lambda are, and their functions Gamma, products of one function for each axis.
enum class Multipliers {
  /// Along the axis that the fibres are nearest to, linear between the centres of cells; across it, constant around each node.
  /// Neither a stretch that alternates from node to node nor a tension that does escapes the rows.
  staggered,
  /// At the centres of cells, linear between them along all axes [Wolper et al. 2020, eq. 22]. Stretch that alternates across
  /// the
  /// fibres is not seen, and tension that does makes no force.
  centred
};

/// With N_i quadratic at the nodes,
///
///   B_(z, i alpha) = sum_p V_p Gamma_z(x_p) a_alpha (a . grad N_i(x_p))          [Wolper et al. 2020, eq. 22]
///
/// A particle has a part in two staggered rows, each of which reaches 4 nodes along the fibre and 3 across, or in 2^D centred
/// ones of 4^D nodes.
template <unsigned D>
class FiberRows {
 public:
  explicit FiberRows(const cleave_constraint_system& system, Multipliers multipliers = Multipliers::staggered)
      : system_(system), multipliers_(multipliers) {}

  /// A particle with the unit fibre a, as it is at present, that is to stretch at a . C a = `stretching` and of which the
  /// length is exp(strain) of what it should be.
  void add(std::uint64_t particle, const std::array<double, 3>& a, double stretching, double strain) {
    fibers_.push_back({particle, a, stretching, strain});
  }

  /// `rate`: of the strain there is, how much is to be taken back per second.
  void write(cleave::Projection& projection, double rate) const {
    const std::vector<Place> places = multipliers_ == Multipliers::staggered ? staggered_places() : centred_places();
    // By rows: the fibres of each, in the order of the particles
    std::vector<std::uint32_t> row_of_key(system_.node_count * D, no_row), keys;
    const unsigned parts = multipliers_ == Multipliers::staggered ? 2 : 1u << D;
    std::vector<std::uint64_t> of_fiber(fibers_.size() * parts, no_key);
    for (std::size_t f = 0; f < fibers_.size(); ++f)
      for (unsigned part = 0; part < parts; ++part) {
        const std::uint64_t corner = corner_of(places[f], part);
        if (corner == no_node) continue;
        const std::uint64_t key = corner * D + places[f].axis;
        of_fiber[f * parts + part] = key;
        row_of_key[key] = 0;
      }
    std::uint32_t rows = 0;
    for (std::uint64_t key = 0; key < row_of_key.size(); ++key)
      if (row_of_key[key] != no_row) {
        row_of_key[key] = rows++;
        keys.push_back(std::uint32_t(key));
      }
    std::vector<std::uint32_t> begin(rows + 1, 0);
    for (const std::uint64_t key : of_fiber)
      if (key != no_key) ++begin[row_of_key[key] + 1];
    for (std::uint32_t i = 0; i < rows; ++i) begin[i + 1] += begin[i];
    std::vector<std::uint32_t> members(begin[rows]), at(begin.begin(), begin.end() - 1);
    for (std::size_t k = 0; k < of_fiber.size(); ++k)
      if (of_fiber[k] != no_key) members[at[row_of_key[of_fiber[k]]]++] = std::uint32_t(k / parts);

    projection.add_rows(rows, reach(), [&](std::size_t i, cleave::Projection::RowWriter& out) {
      write_row(places, keys[i], {members.data() + begin[i], members.data() + begin[i + 1]}, rate, out);
    });
  }

 private:
  static constexpr std::uint32_t no_row = ~std::uint32_t(0);
  static constexpr std::uint64_t no_key = ~std::uint64_t(0), no_node = no_key;
  static constexpr unsigned stencil = D == 3 ? 27 : 9, width = D == 3 ? 64 : 16, staggered_width = D == 3 ? 36 : 12;
  struct Fiber {
    std::uint64_t particle;
    std::array<double, 3> direction;
    double stretching, strain;
  };
  /// The first node of a particle's stencil, how far from it towards the next it is less half a cell, and the axis of its rows.
  struct Place {
    std::array<std::int32_t, D> base;
    std::array<double, D> f;
    const std::uint64_t* nodes;
    unsigned axis;
  };
  struct Members {
    const std::uint32_t *first, *last;
    const std::uint32_t* begin() const { return first; }
    const std::uint32_t* end() const { return last; }
  };

  std::vector<Place> centred_places() const {
    std::vector<Place> places(fibers_.size());
    cleave::threads_of(system_).for_ranges(fibers_.size(), 4096, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t i = first; i < last; ++i) {
        const std::uint64_t p = fibers_[i].particle;
        Place& place = places[i];
        for (unsigned k = 0; k < D; ++k) {
          const double from = system_.position[p * D + k] - 0.5, start = std::floor(from);
          place.base[k] = std::int32_t(start);
          place.f[k] = from - start;
        }
        place.nodes = system_.nodes + p * stencil;
        place.axis = 0;
      }
    });
    return places;
  }

  /// With the axis that all fibres are nearest to, but where those around the nearest node and its neighbours are clearly
  /// nearer to another: rows of two axes say nearly the same where they meet.
  std::vector<Place> staggered_places() const {
    std::vector<Place> places = centred_places();
    std::array<double, D> all{};
    std::vector<std::array<double, D>> sum(system_.node_count, std::array<double, D>{});
    for (std::size_t i = 0; i < fibers_.size(); ++i) {
      const std::array<double, D> parts = squares(fibers_[i].direction);
      for (unsigned k = 0; k < D; ++k) {
        const double part = system_.volume[fibers_[i].particle] * parts[k];
        sum[places[i].nodes[stencil / 2]][k] += part;
        all[k] += part;
      }
    }
    const unsigned common = steepest(all);
    std::vector<std::uint8_t> axis(system_.node_count, D);
    for (Place& place : places) {
      std::uint8_t& of_node = axis[place.nodes[stencil / 2]];
      if (of_node == D) {
        std::array<double, D> around{};
        double whole = 0;
        for (unsigned n = 0; n < stencil; ++n)
          for (unsigned k = 0; k < D; ++k) {
            around[k] += sum[place.nodes[n]][k];
            whole += sum[place.nodes[n]][k];
          }
        const unsigned own = steepest(around);
        of_node = std::uint8_t(around[own] > around[common] + 0.5 * whole ? own : common);
      }
      place.axis = of_node;
    }
    return places;
  }
  static std::array<double, D> squares(const std::array<double, 3>& a) {
    std::array<double, D> result;
    for (unsigned k = 0; k < D; ++k) result[k] = a[k] * a[k];
    return result;
  }
  static unsigned steepest(const std::array<double, D>& parts) {
    return unsigned(std::max_element(parts.begin(), parts.end()) - parts.begin());
  }

  /// Nodes of a row.
  unsigned reach() const { return multipliers_ == Multipliers::centred ? width : staggered_width; }
  bool linear_along(unsigned k, unsigned axis) const { return multipliers_ == Multipliers::centred || k == axis; }

  /// The node by which a row is known: where Gamma is linear, at the lower corner of the cell; where it is constant, in the
  /// middle.
  std::uint64_t corner_of(const Place& place, unsigned part) const {
    std::array<std::int32_t, D> offset;
    unsigned at = 0;
    bool any = true;
    for (unsigned k = 0, bit = 0; k < D; ++k) {
      offset[k] = 1;
      if (linear_along(k, place.axis)) {
        offset[k] = std::int32_t(part >> bit++ & 1);
        any = any && (offset[k] ? place.f[k] : 1 - place.f[k]) > 0;
      }
      at = at * 3 + unsigned(offset[k]);
    }
    const std::uint64_t node = place.nodes[at];
    // Within the rounding of a position a cell may begin with a node that no mass has reached.
    for (unsigned k = 0; k < D; ++k) any = any && system_.node_cell[node * D + k] == place.base[k] + offset[k];
    return any ? node : no_node;
  }

  void write_row(const std::vector<Place>& places, std::uint32_t key, Members members, double rate,
                 cleave::Projection::RowWriter& out) const {
    const unsigned axis = key % D;
    std::array<std::int32_t, D> cell;
    std::array<unsigned, D> extent;
    for (unsigned k = 0; k < D; ++k) {
      cell[k] = system_.node_cell[key / D * D + k];
      extent[k] = linear_along(k, axis) ? 4 : 3;
    }
    std::array<std::uint64_t, width> node{};
    std::array<std::array<double, D>, width> value{};
    double stretching = 0, strain = 0;
    for (const std::uint32_t member : members) {
      const Place& place = places[member];
      const Fiber& fiber = fibers_[member];
      std::array<std::array<double, 3>, D> N, dN;
      double weight = system_.volume[fiber.particle];
      unsigned first = 0;
      for (unsigned k = 0; k < D; ++k) {
        const double f = place.f[k], scale = fiber.direction[k] / system_.cell_size;
        N[k] = {0.5 * (1 - f) * (1 - f), 0.5 + f * (1 - f), 0.5 * f * f};
        dN[k] = {(f - 1) * scale, (1 - 2 * f) * scale, f * scale};
        const std::int32_t before = cell[k] - 1, offset = place.base[k] - before;  // the row begins one node before its own
        if (extent[k] == 4) weight *= offset ? 1 - f : f;
        first = first * extent[k] + unsigned(offset);
      }
      stretching += weight * fiber.stretching;
      strain += weight * fiber.strain;
      std::array<double, D> part;
      for (unsigned c = 0; c < D; ++c) part[c] = weight * fiber.direction[c];
      const std::uint64_t* from = place.nodes;
      const auto add = [&](unsigned to, double slope) {
        node[to] = *from++;
        for (unsigned c = 0; c < D; ++c) value[to][c] += part[c] * slope;
      };
      for (unsigned i = 0; i < 3; ++i)
        for (unsigned j = 0; j < 3; ++j) {
          const double flat = N[0][i] * N[1][j], steep = dN[0][i] * N[1][j] + N[0][i] * dN[1][j];
          if constexpr (D == 2) {
            add(first + i * extent[1] + j, steep);
          } else {
            const unsigned to = first + (i * extent[1] + j) * extent[2];
            for (unsigned k = 0; k < 3; ++k) add(to + k, steep * N[2][k] + flat * dN[2][k]);
          }
        }
    }
    if (multipliers_ == Multipliers::staggered && held(node, members, axis)) return;
    out.row.value = stretching;
    out.row.correction = -rate * strain;
    // In halves of a cell: the rows of different axes are at different places.
    for (unsigned k = 0; k < D; ++k) out.row.cell[k] = 2 * cell[k] + (extent[k] == 4);
    for (unsigned n = 0; n < reach(); ++n)
      if (std::any_of(value[n].begin(), value[n].end(), [](double b) { return b != 0; })) {
        std::array<double, 3> coefficients{};
        std::copy(value[n].begin(), value[n].end(), coefficients.begin());
        out.add(node[n], coefficients);
      }
  }

  /// Whether both ends of a row's cell are prescribed along the fibre: the rows beside it say all that can be said of what is
  /// between the nodes that are free.
  bool held(const std::array<std::uint64_t, width>& node, Members members, unsigned axis) const {
    const auto& a = fibers_[*members.begin()].direction;
    for (const unsigned end : {1u, 2u}) {
      unsigned at = 0;
      for (unsigned k = 0; k < D; ++k) at = k == axis ? at * 4 + end : at * 3 + 1;
      const std::uint64_t n = node[at];
      double along = 0;
      for (unsigned k = 0; k < D && system_.prescribed[n] == 2; ++k) along += a[k] * system_.normal[n * D + k];
      if (system_.prescribed[n] == 0 || (system_.prescribed[n] == 2 && along * along < 0.5)) return false;
    }
    return true;
  }

  const cleave_constraint_system& system_;
  Multipliers multipliers_;
  std::vector<Fiber> fibers_;
};

}  // namespace inextensibility
