#pragma once

#include "common/types.hpp"

#include <array>
#include <filesystem>
#include <vector>

namespace cleave::scene {

struct TriangleMesh {
  std::vector<Vector3> vertices;              ///< m
  std::vector<std::array<int, 3>> triangles;  ///< corners, counter-clockwise seen from outside
};

/// Reads a Wavefront .obj, Stanford .ply or .stl file, by its extension; polygons are triangulated. Vertices keep the file's
/// order, except that the separate corners of an .stl are welded where they coincide.
/// Throws InputError with file:line (text) or the byte offset (binary) if it is malformed, or the file's name if it is missing
/// or has no faces.
TriangleMesh read_mesh(const std::filesystem::path& file);

/// For each vertex the first one at exactly the same place.
std::vector<int> coincident_vertices(const std::vector<Vector3>& vertices);

}  // namespace cleave::scene
