#pragma once

#include "scene/shape.hpp"
#include "scene/tetrahedral_mesh.hpp"

namespace cleave::scene {

/// Fills a shape with tetrahedra of a body-centred cubic lattice, those across its surface cut along it (isosurface stuffing:
/// F. Labelle and J. R. Shewchuk, "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles", 2007). Cubes have
/// edges of about `edge_length` (m), the longest of a tetrahedron inside: a whole number of them fits the bounding box, so
/// that boxes along the axes come out exactly. Each has the room of twelve tetrahedra. Neighbours share whole faces, parts that
/// touch in points or edges alone do not hang together, and the same shape gives the same mesh.
/// What is thinner than a cube may be missed, and where the surface has a sharp edge (but for those boxes) it is cut off
/// within a cube. Throws InputError if the shape is unbounded, or holds no or too many tetrahedra.
TetrahedralMesh lattice_tetrahedra(const SignedDistance&, double edge_length);

}  // namespace cleave::scene
