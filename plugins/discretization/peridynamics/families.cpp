#include "families.hpp"

#include "cell_list.hpp"

#include <stdexcept>
#include <string>

namespace cleave::peridynamics {
namespace {

constexpr unsigned block_bits = 3;             // blocks of 2^3 spacings
constexpr std::uint32_t largest_block = 1024;  // points; where they lie closer than the mean
constexpr std::uint64_t largest_part = 32768;  // what 15 bits can number

/// The bits of i, two zeros between each.
std::uint64_t spread(std::uint64_t i) {
  i &= 0x1fffff;
  i = (i | i << 32) & 0x1f00000000ffff;
  i = (i | i << 16) & 0x1f0000ff0000ff;
  i = (i | i << 8) & 0x100f00f00f00f00f;
  i = (i | i << 4) & 0x10c30c30c30c30c3;
  return (i | i << 2) & 0x1249249249249249;
}

/// Points along a Z-order curve through cubes of one spacing [Morton 1966].
std::vector<std::pair<std::uint64_t, std::uint32_t>> along_curve(std::span<const double> position, double spacing) {
  std::array<double, 3> low = {HUGE_VAL, HUGE_VAL, HUGE_VAL};
  for (std::size_t k = 0; k < position.size(); ++k) low[k % 3] = std::min(low[k % 3], position[k]);
  std::vector<std::pair<std::uint64_t, std::uint32_t>> places(position.size() / 3);
  for (std::size_t i = 0; i < places.size(); ++i) {
    std::uint64_t code = 0;
    for (std::size_t a = 0; a < 3; ++a)
      code = code << 1 | spread(std::uint64_t((position[3 * i + a] - low[a]) / spacing + 1e-6));
    places[i] = {code, std::uint32_t(i)};
  }
  std::sort(places.begin(), places.end());
  return places;
}

/// What a block adds to the families.
struct Part {
  std::vector<std::uint32_t> near, count;
  std::vector<std::uint16_t> neighbour;
};

/// Points in the order of the families, and what they are found with.
struct Search {
  const std::vector<std::uint32_t>& order;
  const std::vector<double>& x;
  const CellList& cells;
  double spacing, reach;
  unsigned multiple;

  Part of(std::uint32_t first, std::uint32_t last) const {
    // All points that any in the block may reach, ascending, and with them its lists.
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (std::size_t k = 3 * std::size_t(first); k < 3 * std::size_t(last); ++k) {
      low[k % 3] = std::min(low[k % 3], x[k] - reach);
      high[k % 3] = std::max(high[k % 3], x[k] + reach);
    }
    std::vector<std::uint32_t> candidates;
    cells.in_box(low, high, [&](std::uint32_t j) {
      const double* y = &x[3 * std::size_t(j)];
      if (y[0] > low[0] && y[1] > low[1] && y[2] > low[2] && y[0] < high[0] && y[1] < high[1] && y[2] < high[2])
        candidates.push_back(j);
    });
    std::sort(candidates.begin(), candidates.end());
    const std::size_t size = candidates.size();
    std::vector<double> at(3 * size);
    for (std::size_t c = 0; c < size; ++c) std::copy_n(&x[3 * std::size_t(candidates[c])], 3, &at[3 * c]);

    Part part;
    std::vector<std::uint32_t> lists, list(size);
    std::vector<std::uint8_t> used(size);
    for (std::uint32_t i = first; i < last; ++i) {
      const double* own = &x[3 * std::size_t(i)];
      std::size_t count = 0;
      for (std::size_t c = 0; c < size; ++c) {
        const double d[3] = {at[3 * c] - own[0], at[3 * c + 1] - own[1], at[3 * c + 2] - own[2]};
        const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        list[count] = std::uint32_t(c);
        count += square < reach * reach;
        if (square < 1e-18 * spacing * spacing) [[unlikely]] {
          used[c] = 1;
          count -= candidates[c] == i;
          if (candidates[c] == i) continue;
          throw std::runtime_error("points " + std::to_string(order[std::min(i, candidates[c])]) + " and " +
                                   std::to_string(order[std::max(i, candidates[c])]) +
                                   " are at the same place; a bond needs a length");
        }
      }
      for (std::size_t k = 0; k < count; ++k) used[list[k]] = 1;
      lists.insert(lists.end(), list.begin(), list.begin() + std::ptrdiff_t(count));
      part.count.push_back(std::uint32_t(count));
    }
    std::vector<std::uint16_t> place(size);
    for (std::size_t c = 0; c < size; ++c) {
      if (!used[c]) continue;
      place[c] = std::uint16_t(2 * part.near.size());
      part.near.push_back(candidates[c]);
    }
    if (part.near.size() > largest_part)
      throw std::runtime_error("a family has some " + std::to_string(part.count[0]) +
                               " points, too many to number; give a smaller horizon");
    const auto self = std::size_t(std::lower_bound(candidates.begin(), candidates.end(), first) - candidates.begin());
    auto next = lists.begin();
    for (std::size_t k = 0; k < part.count.size(); ++k) {
      for (std::uint32_t n = 0; n < part.count[k]; ++n) part.neighbour.push_back(place[*next++]);
      while (part.neighbour.size() % multiple) part.neighbour.push_back(place[self + k]);
    }
    return part;
  }
};

}  // namespace

Families find_families(const Threads& threads, std::span<const double> position, double spacing, double reach,
                       unsigned multiple) {
  Families f;
  const auto places = along_curve(position, spacing);
  const auto points = std::uint32_t(places.size());
  std::vector<double> x(3 * std::size_t(points));
  f.order.resize(points);
  for (std::uint32_t i = 0; i < points; ++i) {
    f.order[i] = places[i].second;
    std::copy_n(&position[3 * std::size_t(f.order[i])], 3, &x[3 * std::size_t(i)]);
  }
  for (std::uint32_t begin = 0, end; begin < points; begin = end) {
    const auto block_of = [&](std::uint32_t i) { return places[i].first >> (3 * block_bits); };
    for (end = begin + 1; end < points && end - begin < largest_block && block_of(end) == block_of(begin);) ++end;
    f.blocks.push_back({begin, end, 0, 0});
  }
  const CellList cells(x, reach);
  const Search search{f.order, x, cells, spacing, reach, multiple};
  std::vector<Part> parts(f.blocks.size());
  threads.for_each(f.blocks.size(), [&](std::uint64_t b) { parts[b] = search.of(f.blocks[b].first, f.blocks[b].last); });

  std::uint64_t near = 0, slots = 0;
  std::vector<std::uint64_t> first_slot(parts.size());
  f.first.reserve(points + std::size_t(1));
  f.count.reserve(points);
  f.first.push_back(0);
  for (std::size_t b = 0; b < parts.size(); ++b) {
    f.blocks[b].near_first = near;
    f.blocks[b].near_last = near += parts[b].near.size();
    first_slot[b] = slots;
    for (const std::uint32_t count : parts[b].count) {
      f.count.push_back(count);
      f.first.push_back(slots += (count + multiple - 1) / multiple * multiple);
    }
  }
  f.near.resize(near);
  f.neighbour.resize(slots);
  threads.for_each(parts.size(), [&](std::uint64_t b) {
    std::copy(parts[b].near.begin(), parts[b].near.end(), f.near.begin() + std::ptrdiff_t(f.blocks[b].near_first));
    std::copy(parts[b].neighbour.begin(), parts[b].neighbour.end(), f.neighbour.begin() + std::ptrdiff_t(first_slot[b]));
    parts[b] = {};
  });
  return f;
}

}  // namespace cleave::peridynamics
