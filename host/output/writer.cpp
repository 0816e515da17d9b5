#include "common/error.hpp"
#include "output/atomic_file.hpp"
#include "output/frame.hpp"
#include "output/frame_table.hpp"
#include "output/ply.hpp"
#include "output/summary.hpp"
#include "output/vdb.hpp"
#include "output/vtp.hpp"

#include <algorithm>
#include <array>
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
};

constexpr Kind point_kind{"points", ".vdb", write_points_vdb}, surface_kind{"surface", ".vdb", write_surface_vdb},
    vtp_kind{"vtp", ".vtp", write_vtp}, ply_kind{"ply", ".ply", write_ply};
constexpr std::array all_kinds{point_kind, surface_kind, vtp_kind, ply_kind};

constexpr const char* series_name = "particles.pvd";
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
  for (const Kind& kind : all_kinds) {
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
  for (const char* name : {series_name, table_name, summary_name}) {
    remove_file(directory / name);
    remove_file(directory / (std::string(name) + partial_suffix));
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
                    frame.volumes.size() == particles;
  for (const Attribute& attribute : frame.attributes)
    consistent = consistent && attribute.components > 0 &&
                 attribute.values.size() == particles * static_cast<std::size_t>(attribute.components);
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
  std::vector<Kind> kinds;
  bool series_wanted = false;
  std::map<int, SeriesEntry> series;
  std::unique_ptr<FrameTable> table;
  std::vector<fs::path> texts;
  bool summarized = false;
};

Writer::Writer(fs::path directory, std::vector<std::string> formats, bool surface, const EarlierPart* earlier)
    : state_(std::make_unique<State>()) {
  state_->directory = std::move(directory);
  const std::map<std::string, Kind> by_format{{"vdb", point_kind}, {"vtp", vtp_kind}, {"ply", ply_kind}};
  std::vector<std::string> seen;
  for (const std::string& format : formats) {
    const auto found = by_format.find(format);
    if (found == by_format.end()) throw InputError("unknown output format '" + format + "'; there are vdb, vtp and ply");
    if (std::find(seen.begin(), seen.end(), format) != seen.end()) continue;
    seen.push_back(format);
    state_->kinds.push_back(found->second);
    if (format == "vtp") state_->series_wanted = true;
  }
  if (surface) state_->kinds.push_back(surface_kind);

  make_directory(state_->directory);
  remove_previous_run(state_->directory, earlier ? earlier->frames : 0);
  for (const Kind& kind : state_->kinds) make_directory(state_->directory / kind.folder);
  state_->table = std::make_unique<FrameTable>(state_->directory / table_name, earlier ? earlier->table : "");
  if (earlier && state_->series_wanted)
    for (const auto& [index, time] : times_of(earlier->table))
      if (const fs::path file = fs::path(vtp_kind.folder) / frame_name(index, vtp_kind.extension);
          fs::exists(state_->directory / file))
        state_->series[index] = {time, file.string()};
}

Writer::~Writer() = default;

void Writer::frame(const ParticleFrame& frame) {
  check(frame);
  for (const Kind& kind : state_->kinds) {
    const fs::path path = state_->directory / kind.folder / frame_name(frame.index, kind.extension);
    naming(path, [&] { kind.write(path, frame); });
  }
  if (!state_->series_wanted) return;
  state_->series[frame.index] = {frame.time,
                                 (fs::path(vtp_kind.folder) / frame_name(frame.index, vtp_kind.extension)).string()};
  const fs::path index = state_->directory / series_name;
  naming(index, [&] { write_pvd(index, state_->series); });
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
  for (const Kind& kind : state_->kinds) paths.push_back(state_->directory / kind.folder);
  if (!state_->series.empty()) paths.push_back(state_->directory / series_name);
  paths.push_back(state_->directory / table_name);
  if (state_->summarized) paths.push_back(state_->directory / summary_name);
  paths.insert(paths.end(), state_->texts.begin(), state_->texts.end());
  return paths;
}

}  // namespace cleave::output
