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

}  // namespace

Families find_families(std::span<const double> position, double spacing, double reach, unsigned multiple) {
  Families f;
  const auto places = along_curve(position, spacing);
  const auto points = std::uint32_t(places.size());
  std::vector<double> x(3 * std::size_t(points));
  f.order.resize(points);
  for (std::uint32_t i = 0; i < points; ++i) {
    f.order[i] = places[i].second;
    std::copy_n(&position[3 * std::size_t(f.order[i])], 3, &x[3 * std::size_t(i)]);
  }
  const CellList cells(x, reach);
  std::vector<std::uint32_t> place_in_block(points);
  std::vector<std::vector<std::uint32_t>> lists;
  f.first.push_back(0);
  for (std::uint32_t begin = 0, end; begin < points; begin = end) {
    const auto block_of = [&](std::uint32_t i) { return places[i].first >> (3 * block_bits); };
    for (end = begin + 1; end < points && end - begin < largest_block && block_of(end) == block_of(begin);) ++end;
    lists.assign(end - begin, {});
    const std::size_t near_first = f.near.size();
    for (std::uint32_t i = begin; i < end; ++i) f.near.push_back(i);
    for (std::uint32_t i = begin; i < end; ++i) {
      const double* at = &x[3 * std::size_t(i)];
      cells.near(at, [&](std::uint32_t j) {
        const double* y = &x[3 * std::size_t(j)];
        const double d[3] = {y[0] - at[0], y[1] - at[1], y[2] - at[2]}, square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        if (j == i || !(square < reach * reach)) return;
        if (square < 1e-18 * spacing * spacing)
          throw std::runtime_error("points " + std::to_string(f.order[i]) + " and " + std::to_string(f.order[j]) +
                                   " are at the same place; a bond needs a length");
        lists[i - begin].push_back(j);
      });
      std::sort(lists[i - begin].begin(), lists[i - begin].end());
      f.near.insert(f.near.end(), lists[i - begin].begin(), lists[i - begin].end());
    }
    const auto part = f.near.begin() + std::ptrdiff_t(near_first);
    std::sort(part, f.near.end());
    f.near.erase(std::unique(part, f.near.end()), f.near.end());
    if (f.near.size() - near_first > largest_part)
      throw std::runtime_error("a family has some " + std::to_string(lists[0].size()) +
                               " points, too many to number; give a smaller horizon");
    for (std::size_t k = near_first; k < f.near.size(); ++k) place_in_block[f.near[k]] = std::uint32_t(k - near_first);
    for (std::uint32_t i = begin; i < end; ++i) {
      const auto& list = lists[i - begin];
      for (const std::uint32_t j : list) f.neighbour.push_back(std::uint16_t(2 * place_in_block[j]));
      while (f.neighbour.size() % multiple) f.neighbour.push_back(std::uint16_t(2 * place_in_block[i]));
      f.count.push_back(std::uint32_t(list.size()));
      f.first.push_back(f.neighbour.size());
    }
    f.blocks.push_back({begin, end, near_first, f.near.size()});
  }
  f.near.shrink_to_fit();
  f.neighbour.shrink_to_fit();
  return f;
}

}  // namespace cleave::peridynamics
