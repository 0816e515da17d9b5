#include "common/error.hpp"
#include "output/atomic_file.hpp"
#include "output/frame.hpp"
#include "output/frame_table.hpp"
#include "output/mesh.hpp"
#include "output/ply.hpp"
#include "output/summary.hpp"
#include "output/usd.hpp"
#include "output/vdb.hpp"
#include "output/vtp.hpp"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <fstream>
#include <map>
#include <optional>
#include <stdexcept>
#include <system_error>

namespace cleave::output {
namespace {

namespace fs = std::filesystem;

/// Frames of one kind: a folder of files of one type.
struct Kind {
  const char* folder;
  const char* extension;
  void (*write)(const fs::path&, const ParticleFrame&);
  const char* series = nullptr;  ///< index of the files for viewers
  void (*write_series)(const fs::path&, const std::map<int, SeriesEntry>&, const Playback&) = nullptr;
};

void write_pvd_series(const fs::path& path, const std::map<int, SeriesEntry>& series, const Playback&) {
  write_pvd(path, series);
}

constexpr Kind surface_kind{"surface", ".vdb", write_surface_vdb};
/// By the name of the format.
const std::map<std::string, Kind> particle_kinds{{"vdb", {"points", ".vdb", write_points_vdb}},
                                                 {"vtp", {"vtp", ".vtp", write_vtp, "particles.pvd", write_pvd_series}},
                                                 {"ply", {"ply", ".ply", write_ply}},
                                                 {"usd", {"usd", ".usda", write_usd, "particles.usda", write_usd_series}}},
    mesh_kinds{{"ply", {"meshes", ".ply", write_mesh_ply}},
               {"obj", {"meshes", ".obj", write_mesh_obj}},
               {"vtp", {"meshes", ".vtp", write_mesh_vtp, "meshes.pvd", write_pvd_series}},
               {"vtu", {"meshes", ".vtu", write_mesh_vtu, "tetrahedra.pvd", write_pvd_series}}};

std::vector<Kind> all_kinds() {
  std::vector<Kind> all{surface_kind};
  for (const auto* kinds : {&particle_kinds, &mesh_kinds})
    for (const auto& [format, kind] : *kinds) all.push_back(kind);
  return all;
}

constexpr const char* table_name = "frames.csv";
constexpr const char* summary_name = "summary.json";

std::string frame_name(int index, const char* extension) {
  char name[32];
  std::snprintf(name, sizeof name, "frame_%04d", index);
  return std::string(name) + extension;
}

/// Whether frame_name() gives this name to some frame, or AtomicFile to one that was never finished.
bool is_frame_name(std::string name, const std::string& extension) {
  const std::string prefix = "frame_";
  if (name.ends_with(partial_suffix)) name.erase(name.size() - std::string(partial_suffix).size());
  if (!name.starts_with(prefix) || !name.ends_with(extension) || name.size() < prefix.size() + 4 + extension.size())
    return false;
  return std::all_of(name.begin() + static_cast<std::ptrdiff_t>(prefix.size()),
                     name.end() - static_cast<std::ptrdiff_t>(extension.size()), [](char c) { return c >= '0' && c <= '9'; });
}

void remove_file(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(fs::symlink_status(path, error))) return;
  fs::remove(path, error);
  if (error) throw_file_error("remove", path, error.value());
}

void make_directory(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) throw_file_error("create directory", path, error.value());
  if (!fs::is_directory(path)) throw_file_error("create directory", path, ENOTDIR);
}

/// Of a name that is_frame_name() knows; a frame that was never finished has none.
std::optional<int> frame_index(const std::string& name) {
  if (name.ends_with(partial_suffix)) return std::nullopt;
  const char* digits = name.data() + std::string("frame_").size();
  int index = 0;
  const auto [end, error] = std::from_chars(digits, name.data() + name.size(), index);
  return error == std::errc() ? std::optional(index) : std::nullopt;
}

/// A viewer that finds frames of two runs side by side would show them as one. The first `kept` frames stay.
void remove_previous_run(const fs::path& directory, int kept) {
  std::vector<std::string> files = {table_name, summary_name};
  for (const Kind& kind : all_kinds()) {
    if (kind.series) files.emplace_back(kind.series);
    const fs::path folder = directory / kind.folder;
    std::error_code error;
    if (!fs::is_directory(folder, error)) continue;
    std::vector<fs::path> stale;
    fs::directory_iterator entries(folder, error);
    for (; !error && entries != fs::directory_iterator(); entries.increment(error))
      if (const std::string name = entries->path().filename().string();
          is_frame_name(name, kind.extension) && frame_index(name).value_or(kept) >= kept)
        stale.push_back(entries->path());
    if (error) throw_file_error("read directory", folder, error.value());
    for (const fs::path& path : stale) remove_file(path);
  }
  for (const std::string& name : files) {
    remove_file(directory / name);
    remove_file(directory / (name + partial_suffix));
  }
}

/// The first two columns of a table of frames, which are whole numbers and times.
std::map<int, double> times_of(const std::string& table) {
  std::map<int, double> times;
  for (std::size_t line = table.find('\n'); line != std::string::npos; line = table.find('\n', line + 1)) {
    int index = 0;
    double time = 0;
    const char* const end = table.data() + table.size();
    const auto [comma, no_index] = std::from_chars(table.data() + line + 1, end, index);
    if (no_index != std::errc() || comma == end) continue;
    if (std::from_chars(comma + 1, end, time).ec == std::errc()) times[index] = time;
  }
  return times;
}

void check(const ParticleFrame& frame) {
  const std::size_t particles = frame.particles();
  bool consistent = frame.index >= 0 && (frame.dimension == 2 || frame.dimension == 3) && frame.cell_size > 0 &&
                    frame.body_ends.size() == frame.bodies.size() &&
                    std::is_sorted(frame.body_ends.begin(), frame.body_ends.end()) &&
                    (frame.bodies.empty() ? 0 : frame.body_ends.back()) == particles && frame.velocities.size() == particles &&
                    (frame.colors.empty() || frame.colors.size() == particles) && frame.volumes.size() == particles;
  for (const Attribute& attribute : frame.attributes)
    consistent = consistent && attribute.components > 0 &&
                 attribute.values.size() == particles * static_cast<std::size_t>(attribute.components);
  for (const BodyMesh& mesh : frame.meshes) {
    const std::size_t vertices = mesh.vertex_count();
    const auto in_range = [vertices](std::uint32_t corner) { return corner < vertices; };
    consistent = consistent && std::size_t(mesh.body) < frame.bodies.size() && mesh.piece.size() == vertices &&
                 (mesh.velocity.empty() || mesh.velocity.size() == 3 * vertices) &&
                 (mesh.damage.empty() || mesh.damage.size() == vertices) &&
                 (mesh.colors.empty() || mesh.colors.size() == vertices) && mesh.triangles.size() % 3 == 0 &&
                 mesh.tetrahedra.size() % 4 == 0 && std::all_of(mesh.triangles.begin(), mesh.triangles.end(), in_range) &&
                 std::all_of(mesh.tetrahedra.begin(), mesh.tetrahedra.end(), in_range);
  }
  if (!consistent) throw std::invalid_argument("the arrays of a particle frame do not fit together");
}

/// InputError passes; whatever else a format's library throws is given the file's name.
template <class Write>
void naming(const fs::path& path, const Write& write) {
  try {
    write();
  } catch (const InputError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw_file_error("write", path, ENOMEM);
  } catch (const std::exception& error) {
    throw InputError("cannot write " + path.string() + ": " + error.what());
  }
}

}  // namespace

struct Writer::State {
  fs::path directory;
  Playback playback;
  std::vector<Kind> kinds;
  std::map<std::string, std::map<int, SeriesEntry>> series;  ///< frames by the name of their index
  std::unique_ptr<FrameTable> table;
  std::vector<fs::path> texts;
  bool summarized = false;
};

Writer::Writer(fs::path directory, const std::vector<std::string>& formats, bool surface, const EarlierPart* earlier,
               const std::optional<std::vector<std::string>>& meshes, bool pieces, const Playback& playback)
    : state_(std::make_unique<State>()) {
  state_->directory = std::move(directory);
  state_->playback = playback;
  const auto add = [this](const std::vector<std::string>& names, const std::map<std::string, Kind>& kinds,
                          const char* there_are) {
    for (auto name = names.begin(); name != names.end(); ++name) {
      if (std::find(names.begin(), name, *name) != name) continue;
      const auto found = kinds.find(*name);
      if (found == kinds.end()) throw InputError("unknown output format '" + *name + "'; there are " + there_are);
      state_->kinds.push_back(found->second);
    }
  };
  add(formats, particle_kinds, "vdb, vtp, ply and usd");
  if (surface) state_->kinds.push_back(surface_kind);
  if (meshes) add(*meshes, mesh_kinds, "ply, obj, vtp and vtu for meshes");

  make_directory(state_->directory);
  remove_previous_run(state_->directory, earlier ? earlier->frames : 0);
  for (const Kind& kind : state_->kinds) make_directory(state_->directory / kind.folder);
  state_->table =
      std::make_unique<FrameTable>(state_->directory / table_name, earlier ? earlier->table : "", meshes.has_value(), pieces);
  if (!earlier) return;
  for (const Kind& kind : all_kinds())
    for (const auto& [index, time] : kind.series ? times_of(earlier->table) : std::map<int, double>())
      if (const fs::path file = fs::path(kind.folder) / frame_name(index, kind.extension); fs::exists(state_->directory / file))
        state_->series[kind.series][index] = {time, file.string()};
  for (const Kind& kind : all_kinds())
    if (const auto frames = state_->series.find(kind.series ? kind.series : ""); frames != state_->series.end())
      kind.write_series(state_->directory / kind.series, frames->second, playback);
}

Writer::~Writer() = default;

void Writer::frame(const ParticleFrame& frame) {
  check(frame);
  for (const Kind& kind : state_->kinds) {
    const fs::path file = fs::path(kind.folder) / frame_name(frame.index, kind.extension), path = state_->directory / file;
    naming(path, [&] { kind.write(path, frame); });
    if (!kind.series) continue;
    auto& series = state_->series[kind.series];
    series[frame.index] = {frame.time, file.string()};
    const fs::path index = state_->directory / kind.series;
    naming(index, [&] { kind.write_series(index, series, state_->playback); });
  }
}

void Writer::record(const FrameRecord& record) { state_->table->append(record); }

void Writer::summary(const Summary& summary) {
  const fs::path path = state_->directory / summary_name;
  naming(path, [&] {
    AtomicFile file(path);
    file.stream() << summary_json(summary);
    file.commit();
  });
  state_->summarized = true;
}

void Writer::text(const std::string& name, const std::string& contents) {
  const fs::path path = state_->directory / name;
  naming(path, [&] {
    AtomicFile file(path);
    file.stream() << contents;
    file.commit();
  });
  if (std::find(state_->texts.begin(), state_->texts.end(), path) == state_->texts.end()) state_->texts.push_back(path);
}

std::string Writer::table() const {
  const fs::path path = state_->directory / table_name;
  std::ifstream file(path, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  if (!file) throw_file_error("read", path, errno);
  return text;
}

std::vector<fs::path> Writer::written() const {
  std::vector<fs::path> paths;
  for (const Kind& kind : state_->kinds)
    if (const fs::path folder = state_->directory / kind.folder; std::find(paths.begin(), paths.end(), folder) == paths.end())
      paths.push_back(folder);
  for (const auto& [name, frames] : state_->series) paths.push_back(state_->directory / name);
  paths.push_back(state_->directory / table_name);
  if (state_->summarized) paths.push_back(state_->directory / summary_name);
  paths.insert(paths.end(), state_->texts.begin(), state_->texts.end());
  return paths;
}

}  // namespace cleave::output
