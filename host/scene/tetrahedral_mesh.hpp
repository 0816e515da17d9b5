#pragma once

#include "common/types.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace cleave::scene {

/// A body cut into tetrahedra. The volume of each, (x1 - x0) . ((x2 - x0) x (x3 - x0)) / 6, is positive: its vertices 0, 2, 1
/// and the like go counter-clockwise seen from outside. Neighbours share vertices.
struct TetrahedralMesh {
  std::vector<Vector3> vertices;  ///< m
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;
};

using Triangle = std::array<std::uint32_t, 3>;

/// The faces of a tetrahedron, by its corners, with their normals outwards; face i lies opposite corner i.
inline constexpr std::array<std::array<int, 3>, 4> tetrahedron_faces = {{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

double signed_volume(const TetrahedralMesh&, std::size_t tetrahedron);  ///< m^3
std::vector<double> volumes(const TetrahedralMesh&);                    ///< m^3
std::vector<Vector3> barycentres(const TetrahedralMesh&);               ///< m

/// Faces that belong to one tetrahedron alone, with their normals outwards, in the order of tetrahedra and faces. They form
/// closed surfaces.
std::vector<Triangle> surface_of(const TetrahedralMesh&);

struct MeshMeasures {
  double volume = 0;                                             ///< m^3
  double shortest_edge = 0, mean_edge = 0, longest_edge = 0;     ///< m
  std::size_t pieces = 0;                                        ///< that no face joins
  double least_dihedral_angle = 0, greatest_dihedral_angle = 0;  ///< between two faces of a tetrahedron, radians
};
MeshMeasures measure(const TetrahedralMesh&);

/// Makes what a file or a mesh generator gives a mesh as above: turns tetrahedra that are inside out, drops vertices that none
/// uses (the others keep their order). Returns what was changed, a sentence each.
/// Throws InputError, beginning with `name` and with the number of tetrahedra and the first one (counted from `first_number`,
/// as the source counts), if there are none, some have no volume, a face belongs to more than two, or two that share a face
/// lie on the same side of it.
std::vector<std::string> make_valid(TetrahedralMesh&, const std::string& name, std::int64_t first_number = 0);

/// Gives parts that meet in a vertex or an edge, but not through faces, a copy of the vertices each. Returns how many copies.
std::size_t separate_touching_parts(TetrahedralMesh&);

}  // namespace cleave::scene
