/// Points by the cube they are in, for finding those close to a place.
#ifndef CLEAVE_PERIDYNAMICS_CELL_LIST_HPP
#define CLEAVE_PERIDYNAMICS_CELL_LIST_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace cleave::peridynamics {

class CellList {
 public:
  /// Cubes of the given edge around points, 3 numbers each.
  CellList(std::span<const double> position, double edge) : edge_(edge), keys_(position.size() / 3) {
    low_.fill(HUGE_VAL);
    for (std::size_t k = 0; k < position.size(); ++k) low_[k % 3] = std::min(low_[k % 3], position[k]);
    for (std::size_t i = 0; i < keys_.size(); ++i) {
      const auto [a, b, c] = cell(&position[3 * i]);
      keys_[i] = {key(a, b, c), std::uint32_t(i)};
    }
    std::sort(keys_.begin(), keys_.end());
  }

  /// visit(j) for every point in the cubes that a ball around x, of a radius of at most the edge, can reach.
  template <class Visit>
  void near(const double* x, const Visit& visit) const {
    const auto [a, b, c] = cell(x);
    rows({a - 1, b - 1, c - 1}, {a + 1, b + 1, c + 1}, visit);
  }

  /// visit(j) for every point in the cubes that meet the box.
  template <class Visit>
  void in_box(const double* low, const double* high, const Visit& visit) const {
    rows(cell(low), cell(high), visit);
  }

  /// The k-th point, cube by cube: searches around points that follow each other look at the same memory.
  std::uint32_t point(std::size_t k) const { return keys_[k].point; }

 private:
  struct Entry {
    std::uint64_t key;
    std::uint32_t point;
    auto operator<=>(const Entry&) const = default;
  };

  /// Cubes from one corner to the other; those along the last axis follow each other.
  template <class Visit>
  void rows(const std::array<std::uint64_t, 3>& first, const std::array<std::uint64_t, 3>& last, const Visit& visit) const {
    for (std::uint64_t a = first[0]; a <= last[0]; ++a)
      for (std::uint64_t b = first[1]; b <= last[1]; ++b) {
        const Entry low{key(a, b, first[2]), 0};
        const std::uint64_t high = key(a, b, last[2]);
        for (auto k = std::lower_bound(keys_.begin(), keys_.end(), low); k != keys_.end() && k->key <= high; ++k)
          visit(k->point);
      }
  }

  /// 21 bits per axis; the last cube holds all that is farther away, which costs time alone.
  static constexpr double last = 0x1ffffe;
  std::array<std::uint64_t, 3> cell(const double* x) const {
    std::array<std::uint64_t, 3> c;
    for (std::size_t a = 0; a < 3; ++a) c[a] = std::uint64_t(std::min(std::max(1.0, (x[a] - low_[a]) / edge_ + 1), last));
    return c;
  }
  static std::uint64_t key(std::uint64_t a, std::uint64_t b, std::uint64_t c) { return a << 42 | b << 21 | c; }

  double edge_;
  std::array<double, 3> low_;
  std::vector<Entry> keys_;
};

}  // namespace cleave::peridynamics

#endif
