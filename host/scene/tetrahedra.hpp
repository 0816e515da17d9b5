#pragma once

#include "scene/shape.hpp"
#include "scene/tetrahedral_mesh.hpp"

#include <optional>

namespace cleave::scene {

/// The tetrahedra of a body as the scene file describes them: those of a file, or of a shape that is cut into them.
struct TetrahedraSpec {
  enum class Method {
    lattice,  ///< of a body-centred cubic lattice, cut along the surface
    tetgen    ///< Delaunay tetrahedra by TetGen, if the program around it is installed
  };
  std::optional<ShapeSpec> file;  ///< of type mesh: a file of tetrahedra, and its place; empty: the body's shape
  Method method = Method::lattice;
  double edge_length = 0;  ///< m, of a tetrahedron inside
};

/// `shape` is not looked at where the tetrahedra are those of a file. A turned or moved shape is cut as it lies before, so that
/// its mesh turns with it. Notes on what was mended go to the log. Throws InputError naming the file or the method.
TetrahedralMesh build_tetrahedra(const TetrahedraSpec&, const ShapeSpec* shape);

}  // namespace cleave::scene
