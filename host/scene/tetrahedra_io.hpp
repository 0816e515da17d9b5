#pragma once

#include "scene/tetrahedral_mesh.hpp"

#include <filesystem>

namespace cleave::scene {

/// Names that files of tetrahedra end with.
inline const std::vector<std::string> tetrahedra_extensions = {".node", ".ele", ".mesh", ".vtk", ".vtu"};

/// Reads tetrahedra from a pair of TetGen files (either of .node and .ele may be named), an ASCII Medit .mesh or a legacy .vtk
/// file (ASCII or binary, unstructured grid) or a .vtu, by its extension, and makes them valid. What was changed goes to
/// `notes`. Throws InputError with file:line (text) or file and byte (binary) if it is malformed, and as make_valid() does.
TetrahedralMesh read_tetrahedra(const std::filesystem::path& file, std::vector<std::string>& notes);

}  // namespace cleave::scene
