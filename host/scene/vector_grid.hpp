#pragma once

#include "common/types.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::scene {

/// Unit directions at positions, interpolated trilinearly from a grid of vectors (world space, float or double) in an OpenVDB
/// file; `name` empty: the first such grid. A fiber has no sense: where the vectors around a position point to both sides they
/// are turned to agree with the nearest. In 2D the grid is read at z = 0 and its vectors are taken into the plane.
/// Throws InputError naming the file: unreadable, no such grid, or no direction at a position.
std::vector<Vector3> grid_directions(const std::filesystem::path&, const std::string& name,
                                     const std::vector<Vector3>& positions, int dimension);

}  // namespace cleave::scene
