#pragma once

#include "scene/mesh_io.hpp"

namespace cleave::scene {

/// What a mesh bounds, ready to be turned into a signed volume.
struct ClosedSurfaces {
  TriangleMesh solids;           ///< everything that encloses matter
  TriangleMesh cavities;         ///< inward-facing components inside a solid
  std::size_t open_edges = 0;    ///< before closing
  std::size_t closed_holes = 0;  ///< loops of open edges that were capped
};

/// Makes a mesh watertight. Vertices at the same place count as one, so that seams do not matter. The edges with an odd number
/// of triangles then always form loops; each loop is capped by a fan about its centroid. That is a repair only if the caps are
/// small: `name`d InputError "not closed: N open edges" if together they have more than a twentieth of the mesh's own area,
/// because what such a mesh encloses is a guess.
/// A connected component whose triangles face the other way round and that lies within another component's box is a cavity.
ClosedSurfaces close_mesh(const TriangleMesh& mesh, const std::string& name);

}  // namespace cleave::scene
