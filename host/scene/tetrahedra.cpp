#include "scene/tetrahedra.hpp"

#include "common/error.hpp"
#include "scene/lattice_tetrahedra.hpp"
#include "scene/tetgen_tetrahedra.hpp"
#include "scene/tetrahedra_io.hpp"

#include <spdlog/spdlog.h>

namespace cleave::scene {
namespace {

TetrahedralMesh read(const ShapeSpec& file) {
  std::vector<std::string> notes;
  TetrahedralMesh mesh = read_tetrahedra(file.file, notes);
  for (const std::string& note : notes) spdlog::info("{}", note);
  place_points(file, mesh.vertices);
  return mesh;
}

TriangleMesh surface_mesh(const TetrahedralMesh& mesh) {
  TriangleMesh surface{mesh.vertices, {}};
  for (const auto& [a, b, c] : surface_of(mesh)) surface.triangles.push_back({int(a), int(b), int(c)});
  return surface;
}

}  // namespace

TetrahedralMesh build_tetrahedra(const TetrahedraSpec& spec, const ShapeSpec* shape) {
  if (spec.file) return read(*spec.file);
  if (!shape) throw InputError("tetrahedra need a shape to cut or a file to read");
  if (!(spec.edge_length > 0) || !std::isfinite(spec.edge_length)) throw InputError("tetrahedra: edge_length must be positive");
  ShapeSpec upright = *shape;
  upright.rotation = Matrix3::Identity();
  upright.translation = Vector3::Zero();
  constexpr double voxels_per_edge = 4;
  const auto distance = build_shape(upright, spec.edge_length / voxels_per_edge);
  TetrahedralMesh mesh;
  if (spec.method == TetrahedraSpec::Method::tetgen && upright.type == ShapeSpec::Type::mesh) {
    mesh = tetgen_tetrahedra(read_placed_mesh(upright), *distance, spec.edge_length, upright.file.string());
  } else {
    mesh = lattice_tetrahedra(*distance, spec.edge_length);
    if (spec.method == TetrahedraSpec::Method::tetgen)
      mesh = tetgen_tetrahedra(surface_mesh(mesh), *distance, spec.edge_length, "tetrahedra");
  }
  for (Vector3& x : mesh.vertices) x = shape->rotation * x + shape->translation;
  return mesh;
}

}  // namespace cleave::scene
