#pragma once

#include <cleave/discretization.h>

#include <cstdint>
#include <vector>

namespace cleave::discretization {

/// The pieces that a surface consists of. Vertices that no triangle and no tetrahedron has belong to none: -1.
struct Pieces {
  std::vector<std::int32_t> of_vertex;  ///< numbered from 0, in the order of their first vertices where the plugin gives none
  std::int32_t count = 0;
};

/// As the plugin says; else what triangles and tetrahedra connect.
Pieces connected_pieces(const cleave_surface&);

}  // namespace cleave::discretization
