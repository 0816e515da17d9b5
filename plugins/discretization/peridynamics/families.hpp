/// Who is in whose family: the points of a body in an order that keeps neighbours together, and for each its neighbours.
#ifndef CLEAVE_PERIDYNAMICS_FAMILIES_HPP
#define CLEAVE_PERIDYNAMICS_FAMILIES_HPP

#include <cleave/threads.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace cleave::peridynamics {

/// Points that follow each other and lie in one cube of eight spacings: what is near them fits into a core's cache.
struct Block {
  std::uint32_t first, last;            ///< points
  std::uint64_t near_first, near_last;  ///< part of Families::near
};

/// Directed bonds: each bond is in the lists of both of its ends. All numbers of points are places in `order`.
struct Families {
  std::vector<std::uint32_t> order;  ///< number of the point in the body
  std::vector<Block> blocks;
  std::vector<std::uint32_t> near;       ///< the points of a block and their neighbours, ascending
  std::vector<std::uint64_t> first;      ///< list of each point, and the end; a whole number of times `multiple` long
  std::vector<std::uint32_t> count;      ///< neighbours of each point; the rest of its list is the point itself
  std::vector<std::uint16_t> neighbour;  ///< twice the places, ascending, in the part of `near` of the block
};

/// Families of all points closer than `reach`, lists a multiple of `multiple` long. `position` has 3 numbers per point.
/// Throws if two points are at the same place, or if a family is too large.
Families find_families(const Threads&, std::span<const double> position, double spacing, double reach, unsigned multiple);

}  // namespace cleave::peridynamics

#endif
