#include "scene/mesh_formats.hpp"
#include "scene/text_input.hpp"

#include <limits>

namespace cleave::scene {
namespace {

/// The vertex of a corner written v, v/vt, v//vn or v/vt/vn, counted from 0. Negative indices count back from the last vertex.
int vertex_of_corner(const TextCursor& cursor, std::string_view corner, std::size_t vertices_so_far) {
  long index = 0;
  const char* const end = corner.data() + corner.size();
  const auto [rest, error] = std::from_chars(corner.data(), end, index);
  const auto expected = [&] {
    cursor.fail("expected a face corner like 1, 1/2, 1//3 or 1/2/3, found '" + std::string(corner.substr(0, 40)) + "'");
  };
  if (error != std::errc() || (rest != end && *rest != '/')) expected();
  int slashes = 0;
  for (const char* c = rest; c != end; ++c) {
    if (*c == '/' ? ++slashes > 2 : ((*c < '0' || *c > '9') && *c != '-')) expected();
  }
  if (index == 0) cursor.fail("vertex indices count from 1; 0 is none");
  if (index < 0) index += static_cast<long>(vertices_so_far) + 1;
  if (index < 1) cursor.fail("the face counts back beyond the first vertex: " + std::string(corner.substr(0, 40)));
  if (index > std::numeric_limits<int>::max()) cursor.fail("vertex index too large: " + std::string(corner.substr(0, 40)));
  return static_cast<int>(index - 1);
}

}  // namespace

PolygonMesh parse_obj(const std::filesystem::path& file, std::string_view bytes) {
  PolygonMesh mesh;
  TextCursor cursor(file, bytes);
  int highest_vertex = -1, line_of_highest = 0;
  for (; !cursor.at_end(); cursor.next_line()) {
    const std::string_view keyword = cursor.word();
    if (keyword == "v") {
      Vector3 vertex;
      for (double& component : vertex) component = cursor.number("a vertex coordinate");
      mesh.vertices.push_back(vertex);
    } else if (keyword == "f") {
      const std::size_t begin = mesh.corners.size();
      for (std::string_view corner = cursor.word(); !corner.empty() && corner.front() != '#'; corner = cursor.word()) {
        mesh.corners.push_back(vertex_of_corner(cursor, corner, mesh.vertices.size()));
        // A face may come before its vertices, so that only the end tells whether they exist.
        if (mesh.corners.back() > highest_vertex) {
          highest_vertex = mesh.corners.back();
          line_of_highest = cursor.line();
        }
      }
      if (mesh.corners.size() - begin < 3) cursor.fail("a face needs at least three corners");
      mesh.polygon_ends.push_back(mesh.corners.size());
    }
  }
  if (highest_vertex >= static_cast<int>(mesh.vertices.size())) {
    cursor.fail_at(line_of_highest, "the face uses vertex " + std::to_string(highest_vertex + 1) + ", but the file has only " +
                                        std::to_string(mesh.vertices.size()));
  }
  return mesh;
}

}  // namespace cleave::scene
