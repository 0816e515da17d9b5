#include "scene/mesh_io.hpp"

#include "common/error.hpp"
#include "scene/mesh_formats.hpp"
#include "scene/text_input.hpp"

#include <bit>
#include <cctype>
#include <cstdint>
#include <string>
#include <unordered_map>

namespace cleave::scene {

TriangleMesh read_mesh(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const auto parse = extension == ".obj"   ? parse_obj
                     : extension == ".ply" ? parse_ply
                     : extension == ".stl" ? parse_stl
                                           : nullptr;
  if (parse == nullptr) throw InputError(file.string() + ": not a mesh file; its name must end in .obj, .ply or .stl");
  const std::string bytes = read_bytes(file);
  PolygonMesh polygons = parse(file, bytes);
  if (polygons.polygon_ends.empty()) throw InputError(file.string() + ": the mesh has no faces");
  return triangulate(std::move(polygons));
}

std::vector<int> coincident_vertices(const std::vector<Vector3>& vertices) {
  struct Hash {
    std::size_t operator()(const Vector3& v) const {
      std::uint64_t hash = 0;
      for (int i = 0; i < 3; ++i) {
        const double without_signed_zero = v[i] + 0.0;
        hash = (hash ^ std::bit_cast<std::uint64_t>(without_signed_zero)) * 0x9e3779b97f4a7c15u;
        hash ^= hash >> 29;
      }
      return hash;
    }
  };
  std::unordered_map<Vector3, int, Hash> first;
  first.reserve(vertices.size());
  std::vector<int> representative(vertices.size());
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    representative[i] = first.try_emplace(vertices[i], static_cast<int>(i)).first->second;
  }
  return representative;
}

}  // namespace cleave::scene
