#include "scene/tetgen_tetrahedra.hpp"

#include "common/error.hpp"
#include "scene/mesh_closing.hpp"
#include "scene/tetgen/exchange.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <system_error>

namespace cleave::scene {
namespace {

std::filesystem::path program() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "lib/cleave/meshers/tetgen";
}

class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string name = (std::filesystem::temp_directory_path() / "cleave-tetgen-XXXXXX").string();
    if (!mkdtemp(name.data())) throw InputError("no temporary directory can be made beside " + name);
    path_ = name;
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Runs TetGen without its messages. Its exit status; tetgen::failed if it crashed.
int run(const std::filesystem::path& surface, const std::filesystem::path& mesh) {
  std::array<std::string, 3> words{program().string(), surface.string(), mesh.string()};
  std::array<char*, 4> arguments{words[0].data(), words[1].data(), words[2].data(), nullptr};
  posix_spawn_file_actions_t silent;
  posix_spawn_file_actions_init(&silent);
  for (const int stream : {STDOUT_FILENO, STDERR_FILENO})
    posix_spawn_file_actions_addopen(&silent, stream, "/dev/null", O_WRONLY, 0);
  pid_t process = 0;
  const int problem = posix_spawn(&process, words[0].c_str(), &silent, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&silent);
  if (problem != 0) return tetgen::cannot_exchange;
  int status = 0;
  while (waitpid(process, &status, 0) < 0)
    if (errno != EINTR) return tetgen::cannot_exchange;
  return WIFEXITED(status) ? WEXITSTATUS(status) : int(tetgen::failed);
}

const char* meaning(int status) {
  switch (status) {
    case tetgen::cannot_exchange:
      return "TetGen could not be run or its mesh not be read";
    case tetgen::out_of_memory:
      return "TetGen ran out of memory";
    case tetgen::intersecting:
      return "the surface intersects itself";
    case tetgen::too_close:
      return "TetGen found parts of the surface too close to each other to resolve";
    default:
      return "TetGen failed on this surface";
  }
}

struct Taken {
  TetrahedralMesh mesh;
  std::vector<std::uint32_t> region;
};

Taken tetrahedralize(const tetgen::Surface& surface, const std::string& name) {
  const TemporaryDirectory directory;
  const auto given = directory.path() / "surface", made = directory.path() / "mesh";
  {
    std::ofstream file(given, std::ios::binary);
    file.write(reinterpret_cast<const char*>(&surface.greatest_volume), sizeof surface.greatest_volume);
    tetgen::put(file, surface.vertices);
    tetgen::put(file, surface.triangles);
  }
  const auto fail = [&](int status) {
    throw InputError(name + ": " + meaning(status) + "; mend it, or use method = \"lattice\"");
  };
  if (const int status = run(given, made); status != tetgen::done) fail(status);
  tetgen::Mesh mesh;
  std::ifstream file(made, std::ios::binary);
  tetgen::get(file, mesh.vertices);
  tetgen::get(file, mesh.tetrahedra);
  tetgen::get(file, mesh.region);
  if (!file) fail(tetgen::cannot_exchange);
  Taken taken;
  for (std::size_t v = 0; v < mesh.vertices.size(); v += 3) taken.mesh.vertices.emplace_back(mesh.vertices.data() + v);
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); t += 4)
    taken.mesh.tetrahedra.push_back(
        {mesh.tetrahedra[t], mesh.tetrahedra[t + 1], mesh.tetrahedra[t + 2], mesh.tetrahedra[t + 3]});
  taken.region = std::move(mesh.region);
  return taken;
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

bool tetgen_available() { return access(program().c_str(), X_OK) == 0; }

TetrahedralMesh tetgen_tetrahedra(const TriangleMesh& surfaces, const SignedDistance& shape, double edge_length,
                                  const std::string& name) {
  if (!tetgen_available())
    throw InputError(name + ": method = \"tetgen\" needs " + program().string() +
                     ", which is built where TetGen's library is installed (Debian: libtet1.5-dev); use method = \"lattice\"");
  const ClosedSurfaces closed = close_mesh(surfaces, name);
  tetgen::Surface surface;
  auto& [vertices, triangles, greatest_volume] = surface;
  for (const TriangleMesh* mesh : {&closed.solids, &closed.cavities}) {
    const std::size_t first = vertices.size() / 3;
    for (const Vector3& x : mesh->vertices)
      for (const double component : x) vertices.push_back(component / edge_length);
    for (const auto& triangle : mesh->triangles)
      for (const int corner : triangle) triangles.push_back(std::uint32_t(first + std::size_t(corner)));
  }
  greatest_volume = 1 / (6 * std::sqrt(2.0));
  Taken taken = tetrahedralize(surface, name);
  for (Vector3& x : taken.mesh.vertices) x *= edge_length;
  drop_regions_outside(taken, shape);
  make_valid(taken.mesh, name);
  return std::move(taken.mesh);
}

}  // namespace cleave::scene
