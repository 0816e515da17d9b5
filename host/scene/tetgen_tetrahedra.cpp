#include "scene/tetgen_tetrahedra.hpp"

#include "common/error.hpp"
#include "scene/mesh_closing.hpp"
#include "scene/tetgen/tetgen_module.h"

#include <boost/dll/shared_library.hpp>
#include <cmath>
#include <filesystem>
#include <system_error>

namespace cleave::scene {
namespace {

std::filesystem::path module_path() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "lib/cleave/meshers/tetgen.so";
}

/// Null if the module is not there; stays open once it is.
cleave_tetrahedralize_function load(std::string* reason) {
  static boost::dll::shared_library library;
  if (!library.is_loaded()) {
    std::error_code error;
    library.load(module_path(), error, boost::dll::load_mode::rtld_now | boost::dll::load_mode::rtld_local);
    if (error) {
      if (reason) *reason = module_path().string() + ": " + error.message();
      return nullptr;
    }
  }
  return &library.get<const char*(std::uint64_t, const double*, std::uint64_t, const std::uint32_t*, double, void*,
                                  cleave_take_tetrahedra)>(CLEAVE_TETRAHEDRALIZE_SYMBOL);
}

struct Taken {
  TetrahedralMesh mesh;
  std::vector<std::uint32_t> region;
};

void take(void* user, std::uint64_t vertex_count, const double* vertices, std::uint64_t tetrahedron_count,
          const std::uint32_t* tetrahedra, const std::uint32_t* region) {
  auto& [mesh, regions] = *static_cast<Taken*>(user);
  for (std::uint64_t v = 0; v < vertex_count; v++) mesh.vertices.emplace_back(vertices + 3 * v);
  for (std::uint64_t t = 0; t < tetrahedron_count; t++)
    mesh.tetrahedra.push_back({tetrahedra[4 * t], tetrahedra[4 * t + 1], tetrahedra[4 * t + 2], tetrahedra[4 * t + 3]});
  regions.assign(region, region + tetrahedron_count);
}

/// Surfaces bound regions, which are inside or outside as a whole; where most of their volume lies decides, as a distance from
/// voxels is only that exact.
void drop_regions_outside(Taken& taken, const SignedDistance& shape) {
  const auto volume = volumes(taken.mesh);
  const auto centres = barycentres(taken.mesh);
  std::vector<double> inside;
  for (std::size_t t = 0; t < volume.size(); t++) {
    if (taken.region[t] >= inside.size()) inside.resize(taken.region[t] + 1, 0);
    inside[taken.region[t]] += shape.distance(centres[t]) < 0 ? std::abs(volume[t]) : -std::abs(volume[t]);
  }
  std::size_t kept = 0;
  for (std::size_t t = 0; t < volume.size(); t++)
    if (inside[taken.region[t]] > 0) taken.mesh.tetrahedra[kept++] = taken.mesh.tetrahedra[t];
  taken.mesh.tetrahedra.resize(kept);
}

}  // namespace

bool tetgen_available(std::string* reason) { return load(reason) != nullptr; }

TetrahedralMesh tetgen_tetrahedra(const TriangleMesh& surfaces, const SignedDistance& shape, double edge_length,
                                  const std::string& name) {
  std::string reason;
  const auto tetrahedralize = load(&reason);
  if (!tetrahedralize)
    throw InputError(name +
                     ": method = \"tetgen\" needs the module that is built where TetGen's library is installed (Debian: "
                     "libtet1.5-dev); use method = \"lattice\", or build it: " +
                     reason);
  const ClosedSurfaces closed = close_mesh(surfaces, name);
  std::vector<double> vertices;
  std::vector<std::uint32_t> triangles;
  for (const TriangleMesh* mesh : {&closed.solids, &closed.cavities}) {
    const std::size_t first = vertices.size() / 3;
    for (const Vector3& x : mesh->vertices) vertices.insert(vertices.end(), x.data(), x.data() + 3);
    for (const auto& triangle : mesh->triangles)
      for (const int corner : triangle) triangles.push_back(std::uint32_t(first + std::size_t(corner)));
  }
  const double greatest_volume = edge_length * edge_length * edge_length / (6 * std::sqrt(2.0));
  Taken taken;
  if (const char* problem = tetrahedralize(vertices.size() / 3, vertices.data(), triangles.size() / 3, triangles.data(),
                                           greatest_volume, &taken, &take))
    throw InputError(name + ": " + problem + "; mend it, or use method = \"lattice\"");
  drop_regions_outside(taken, shape);
  make_valid(taken.mesh, name);
  return std::move(taken.mesh);
}

}  // namespace cleave::scene
