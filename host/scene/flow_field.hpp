#pragma once

#include "scene/shape.hpp"

#include <vector>

namespace cleave::scene {

/// Directions of a potential flow through a body, as flow-generated fibers are laid (AnisoMPM, Wolper et al. 2020, section 7;
/// Saito et al. 2015). On the cells (edge `cell_size`) that hold a position,
///   lap phi = 0,  phi = 1 in `inflow`, phi = 0 in `outflow` (as many cells as have their centre there),  d phi/dn = 0
///   elsewhere,
/// and the direction is -grad phi/|grad phi|, downstream. The surface inside a cell follows from how densely positions lie
/// around its corners; they should be spread evenly. Where nothing flows (inside the two regions, deep in dead ends) the
/// directions next to it are carried on.
/// Throws InputError if a region holds no cell, the two share cells, or part of the body does not touch a flow between them.
std::vector<Vector3> flow_directions(const SignedDistance& inflow, const SignedDistance& outflow,
                                     const std::vector<Vector3>& positions, double cell_size, int dimension);

}  // namespace cleave::scene
