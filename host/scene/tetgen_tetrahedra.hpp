#pragma once

#include "scene/mesh_io.hpp"
#include "scene/shape.hpp"
#include "scene/tetrahedral_mesh.hpp"

namespace cleave::scene {

/// Whether the program around TetGen is installed.
bool tetgen_available();

/// Fills what closed surfaces bound with tetrahedra by TetGen, keeping the surfaces' triangles or parts of them; none has more
/// than the volume of a regular tetrahedron with edges of `edge_length` (m). What `shape` does not hold, such as cavities, is
/// left out. Throws InputError beginning with `name` if the surfaces are not closed (but for small holes) or intersect, and if
/// the program is not installed.
TetrahedralMesh tetgen_tetrahedra(const TriangleMesh& surfaces, const SignedDistance& shape, double edge_length,
                                  const std::string& name);

}  // namespace cleave::scene
