#pragma once

#include "output/frame.hpp"

#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace cleave::render {

/// What a frame file holds, by the names the files have: numbers per particle, in the order of the file.
struct FileFrame {
  double time = 0, cell_size = 0;
  int dimension = 0;  ///< 0: the file does not say
  std::vector<std::string> bodies;
  std::vector<Vector3> positions;
  std::vector<std::int64_t> id;
  std::vector<std::int32_t> body;
  std::vector<float> radius;
  std::vector<output::Attribute> attributes;  ///< those asked for, without units
  std::vector<Eigen::Vector3f> velocities;
  std::vector<std::uint32_t> triangles;
  std::vector<std::int32_t> piece;
  std::set<std::string> names;  ///< of all attributes there are
};

using Wanted = std::function<bool(const std::string&)>;

/// Of files that `cleave run` has written. Throw InputError naming the file.
FileFrame read_points_vdb(const std::filesystem::path&, const Wanted&);
FileFrame read_vtp(const std::filesystem::path&, const Wanted&);
FileFrame read_ply(const std::filesystem::path&, const Wanted&);

/// The frames in a directory that `cleave run` has filled: particles in the first of vdb, vtp and ply that there is, and the
/// surfaces of discretized bodies.
class RunFrames {
 public:
  /// Throws InputError if there are none.
  explicit RunFrames(std::filesystem::path directory);

  std::vector<int> indices() const;
  /// Particles by their ids, with NaN as place of those the file leaves out. `dimension`: of files that do not say.
  output::ParticleFrame load(int index, const Wanted& attributes, int dimension) const;
  /// Attributes of particles and of surfaces.
  std::set<std::string> attribute_names(int index) const;

 private:
  std::filesystem::path directory_;
  FileFrame (*read_particles_)(const std::filesystem::path&, const Wanted&) = nullptr;
  FileFrame (*read_meshes_)(const std::filesystem::path&, const Wanted&) = nullptr;
  std::map<int, std::filesystem::path> particles_, meshes_;
};

}  // namespace cleave::render
