#include "discretization/connected_pieces.hpp"

#include <algorithm>
#include <numeric>

namespace cleave::discretization {

Pieces connected_pieces(const cleave_surface& surface) {
  const std::size_t vertices = surface.vertex_count;
  Pieces pieces;
  pieces.of_vertex.assign(vertices, -1);
  if (surface.piece) {
    for (std::size_t i = 0; i < vertices; i++) {
      pieces.of_vertex[i] = std::int32_t(surface.piece[i]);
      pieces.count = std::max(pieces.count, pieces.of_vertex[i] + 1);
    }
    return pieces;
  }
  std::vector<std::uint32_t> above(vertices);
  std::iota(above.begin(), above.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (above[v] != v) v = above[v] = above[above[v]];
    return v;
  };
  std::vector<bool> used(vertices, false);
  const auto connect = [&](const std::uint32_t* cells, std::size_t count, std::size_t corners) {
    for (std::size_t c = 0; c < count * corners; c += corners)
      for (std::size_t k = 0; k < corners; k++) {
        used[cells[c + k]] = true;
        const std::uint32_t a = root(cells[c]), b = root(cells[c + k]);
        above[std::max(a, b)] = std::min(a, b);
      }
  };
  connect(surface.triangles, surface.triangle_count, 3);
  connect(surface.tetrahedra, surface.tetrahedron_count, 4);
  for (std::uint32_t v = 0; v < vertices; v++)  // the root of a piece is its first vertex
    if (used[v]) pieces.of_vertex[v] = root(v) == v ? pieces.count++ : pieces.of_vertex[root(v)];
  return pieces;
}

}  // namespace cleave::discretization
