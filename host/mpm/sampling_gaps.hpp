#pragma once

#include "mpm/grid.hpp"
#include "mpm/particles.hpp"

#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// How many particles are no longer sampled as a continuum: along some axis the cell next to theirs is empty and the one
/// beyond it is not, or both cells next to theirs are empty. Matter drawn out so far comes apart by numbers alone, whatever its
/// law ("numerical fracture"); cracks are the same but meant, so that particles with d > 1/2 are not counted. Particles of all
/// sets stand for each other.
template <class T, int D>
std::int64_t under_sampled(const Grid<T, D>&, const std::vector<const Particles<T, D>*>&);

}  // namespace cleave::mpm
