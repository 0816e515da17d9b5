#pragma once

#include "scene/mesh_io.hpp"

#include <string_view>

namespace cleave::scene {

/// Polygons as a file gives them. Corner indices are checked by the readers.
struct PolygonMesh {
  std::vector<Vector3> vertices;
  std::vector<int> corners;               ///< of all polygons, one after the other
  std::vector<std::size_t> polygon_ends;  ///< past the last corner of each polygon
};

PolygonMesh parse_obj(const std::filesystem::path& file, std::string_view bytes);
PolygonMesh parse_ply(const std::filesystem::path& file, std::string_view bytes);
PolygonMesh parse_stl(const std::filesystem::path& file, std::string_view bytes);

/// Cuts each polygon into triangles by clipping ears in its own plane, so that concave ones are not overrun. Polygons with
/// several thousand corners are fanned.
TriangleMesh triangulate(PolygonMesh&& mesh);

}  // namespace cleave::scene
