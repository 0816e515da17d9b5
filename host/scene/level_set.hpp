#pragma once

#include "scene/mesh_io.hpp"
#include "scene/shape.hpp"

namespace cleave::scene {

/// Signed distance of a mesh by way of a sparse level set of `voxel_size` (m). Small holes are closed (see mesh_closing.hpp)
/// with a note in the log. `name` stands for the mesh in messages.
/// Throws InputError if the mesh is not closed, encloses nothing the voxels resolve, or needs more voxels than is sane.
std::unique_ptr<SignedDistance> level_set_of_mesh(const TriangleMesh& mesh, double voxel_size, const std::string& name);

/// Reads a level set from an OpenVDB file: the grid of that name, or the first level set (OpenVDB sorts grids by name) if it is
/// empty. Throws InputError naming the file and the grids it has.
std::unique_ptr<SignedDistance> read_level_set(const std::filesystem::path& file, const std::string& grid);

}  // namespace cleave::scene
