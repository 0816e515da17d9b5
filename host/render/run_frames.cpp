#include "render/run_frames.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numbers>

namespace cleave::render {
namespace {

namespace fs = std::filesystem;

std::map<int, fs::path> frame_files(const fs::path& folder, const std::string& extension) {
  std::map<int, fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string(), prefix = "frame_";
    if (!name.starts_with(prefix) || !name.ends_with(extension)) continue;
    int index = 0;
    const char* const end = name.data() + name.size() - extension.size();
    if (const auto [rest, bad] = std::from_chars(name.data() + prefix.size(), end, index); bad == std::errc() && rest == end)
      files[index] = entry->path();
  }
  return files;
}

double volume(float radius, int dimension) {
  const double r = double(radius);
  return std::numbers::pi * (dimension == 2 ? r * r : 4.0 / 3 * r * r * r);
}

/// Particles of the file at the places of their ids.
void put_particles(const fs::path& path, FileFrame& file, output::ParticleFrame& frame) {
  const std::size_t count = file.positions.size();
  if (file.id.size() != count || file.body.size() != count || file.radius.size() != count || file.velocities.size() != count)
    throw InputError("error: " + path.string() + " has not the particles of a frame: id, body, velocity and pscale");
  std::int64_t last = -1;
  for (const std::int64_t id : file.id) {
    if (id < 0 || id > std::int64_t(count) * 64 + 1000000)
      throw InputError("error: " + path.string() + ": particle number " + std::to_string(id) + " cannot be right");
    last = std::max(last, id);
  }
  const std::size_t places = std::size_t(last + 1);
  frame.positions.assign(places, Vector3::Constant(std::numeric_limits<double>::quiet_NaN()));
  frame.velocities.assign(places, Eigen::Vector3f::Zero());
  frame.volumes.assign(places, 0);
  frame.body_ends.assign(frame.bodies.size(), 0);
  frame.attributes = file.attributes;
  for (auto& attribute : frame.attributes) attribute.values.assign(places * std::size_t(attribute.components), 0);
  for (std::size_t n = 0; n < count; n++) {
    const auto i = std::size_t(file.id[n]), body = std::size_t(file.body[n]);
    if (body >= frame.bodies.size())
      throw InputError("error: " + path.string() + ": there is no body number " + std::to_string(file.body[n]));
    frame.positions[i] = file.positions[n];
    frame.velocities[i] = file.velocities[n];
    frame.volumes[i] = float(volume(file.radius[n], frame.dimension));
    frame.body_ends[body] = std::max(frame.body_ends[body], i + 1);
    for (std::size_t a = 0; a < frame.attributes.size(); a++) {
      const auto width = std::size_t(file.attributes[a].components);
      std::copy_n(file.attributes[a].values.data() + width * n, width, frame.attributes[a].values.data() + width * i);
    }
  }
  std::size_t end = 0;
  for (std::size_t& body_end : frame.body_ends) body_end = end = std::max(end, body_end);
}

void put_mesh(FileFrame& file, output::ParticleFrame& frame) {
  const std::size_t vertices = file.positions.size();
  for (std::size_t body = 0; body < frame.bodies.size(); body++) {
    output::BodyMesh mesh;
    mesh.body = std::int32_t(body);
    std::vector<std::uint32_t> number(vertices);
    const output::Attribute* damage = nullptr;
    for (const auto& a : file.attributes)
      if (a.name == "damage") damage = &a;
    for (std::size_t v = 0; v < vertices; v++) {
      if (file.body[v] != std::int32_t(body)) continue;
      number[v] = std::uint32_t(mesh.vertex_count());
      mesh.vertices.insert(mesh.vertices.end(), file.positions[v].data(), file.positions[v].data() + 3);
      if (!file.velocities.empty())
        mesh.velocity.insert(mesh.velocity.end(), file.velocities[v].data(), file.velocities[v].data() + 3);
      if (damage) mesh.damage.push_back(damage->values[v]);
      mesh.piece.push_back(file.piece.empty() ? -1 : file.piece[v]);
    }
    for (std::size_t t = 0; t + 3 <= file.triangles.size(); t += 3)
      if (file.body[file.triangles[t]] == std::int32_t(body))
        for (std::size_t k = 0; k < 3; k++) mesh.triangles.push_back(number[file.triangles[t + k]]);
    if (mesh.vertex_count() > 0) frame.meshes.push_back(std::move(mesh));
  }
}

}  // namespace

RunFrames::RunFrames(fs::path directory) : directory_(std::move(directory)) {
  const struct {
    const char *folder, *extension;
    FileFrame (*read)(const fs::path&, const Wanted&);
  } kinds[] = {{"points", ".vdb", read_points_vdb}, {"vtp", ".vtp", read_vtp}, {"ply", ".ply", read_ply}},
    mesh_kinds[] = {{"meshes", ".ply", read_ply}, {"meshes", ".vtp", read_vtp}};
  for (const auto& kind : kinds)
    if (particles_.empty()) {
      particles_ = frame_files(directory_ / kind.folder, kind.extension);
      read_particles_ = kind.read;
    }
  for (const auto& kind : mesh_kinds)
    if (meshes_.empty()) {
      meshes_ = frame_files(directory_ / kind.folder, kind.extension);
      read_meshes_ = kind.read;
    }
  if (!particles_.empty() || !meshes_.empty()) return;
  if (!fs::is_directory(directory_)) throw InputError("error: there is no directory " + directory_.string());
  throw InputError(
      "error: " + directory_.string() +
      " has no frames that can be drawn: `cleave run` writes them with output.formats = [\"vdb\"], \"vtp\" or \"ply\"");
}

std::vector<int> RunFrames::indices() const {
  std::set<int> all;
  for (const auto* files : {&particles_, &meshes_})
    for (const auto& [index, path] : *files) all.insert(index);
  return {all.begin(), all.end()};
}

output::ParticleFrame RunFrames::load(int index, const Wanted& attributes, int dimension) const {
  output::ParticleFrame frame;
  frame.index = index;
  const auto particles = particles_.find(index), meshes = meshes_.find(index);
  if (particles == particles_.end() && meshes == meshes_.end())
    throw InputError("error: " + directory_.string() + " has no frame " + std::to_string(index));
  const auto begin = [&](const FileFrame& file) {
    frame.time = file.time;
    frame.cell_size = std::max(frame.cell_size, file.cell_size);
    frame.dimension = file.dimension > 0 ? file.dimension : dimension;
    if (file.bodies.size() > frame.bodies.size()) frame.bodies = file.bodies;
  };
  FileFrame surfaces;
  if (meshes != meshes_.end()) {
    surfaces = read_meshes_(meshes->second, [](const std::string& name) { return name == "damage"; });
    begin(surfaces);
  }
  if (particles != particles_.end()) {
    FileFrame file = read_particles_(particles->second, attributes);
    begin(file);
    put_particles(particles->second, file, frame);
  }
  frame.body_ends.resize(frame.bodies.size(), frame.body_ends.empty() ? 0 : frame.body_ends.back());
  put_mesh(surfaces, frame);
  return frame;
}

std::set<std::string> RunFrames::attribute_names(int index) const {
  const auto none = [](const std::string&) { return false; };
  std::set<std::string> names;
  if (const auto file = particles_.find(index); file != particles_.end()) names = read_particles_(file->second, none).names;
  if (const auto file = meshes_.find(index); file != meshes_.end()) names.merge(read_meshes_(file->second, none).names);
  return names;
}

}  // namespace cleave::render
