#include "checkpoint/run_directory.hpp"

#include "common/error.hpp"
#include "output/atomic_file.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cerrno>
#include <charconv>

namespace cleave::checkpoint {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr const char* run_section = "run";
constexpr const char* scene_section = "scene.toml";
constexpr const char* table_section = "frames.csv";
const std::string prefix = "step_", extension = ".checkpoint";
constexpr std::size_t kept = 2;

/// Empty if it is not the name of a checkpoint.
std::optional<std::int64_t> steps_of(const std::string& name) {
  if (!name.starts_with(prefix) || !name.ends_with(extension)) return std::nullopt;
  const char* const last = name.data() + name.size() - extension.size();
  std::int64_t steps = 0;
  const auto [end, error] = std::from_chars(name.data() + prefix.size(), last, steps);
  return error == std::errc() && end == last ? std::optional(steps) : std::nullopt;
}

std::string text_of(const Run& run) {
  Json plugins = Json::array();
  for (const auto& p : run.plugins) plugins.push_back({{"id", p.id}, {"version", p.version}, {"file", p.file}, {"crc", p.crc}});
  return Json{{"program", run.program},
              {"program_crc", run.program_crc},
              {"isa", run.isa},
              {"threads", run.threads},
              {"plugins", plugins},
              {"files", run.files},
              {"frames", run.frames},
              {"steps", run.steps},
              {"time", run.time},
              {"wall_seconds", run.wall_seconds},
              {"stepping_seconds", run.stepping_seconds},
              {"output_seconds", run.output_seconds}}
      .dump(1, ' ', false, Json::error_handler_t::replace);
}

Run read_run(StateReader& reader) {
  Run run;
  run.scene = reader.text(scene_section);
  run.table = reader.text(table_section);
  try {
    const Json json = Json::parse(reader.text(run_section));
    for (const Json& p : json.at("plugins"))
      run.plugins.push_back({p.at("id").get<std::string>(), p.at("version").get<std::string>(), p.at("file").get<std::string>(),
                             p.at("crc").get<std::uint32_t>()});
    json.at("program").get_to(run.program);
    json.at("program_crc").get_to(run.program_crc);
    json.at("isa").get_to(run.isa);
    json.at("threads").get_to(run.threads);
    json.at("files").get_to(run.files);
    json.at("frames").get_to(run.frames);
    json.at("steps").get_to(run.steps);
    json.at("time").get_to(run.time);
    json.at("wall_seconds").get_to(run.wall_seconds);
    json.at("stepping_seconds").get_to(run.stepping_seconds);
    json.at("output_seconds").get_to(run.output_seconds);
  } catch (const Json::exception& e) {
    reader.refuse(run_section, std::string("cannot be understood: ") + e.what());
  }
  if (run.frames < 0 || run.steps < 0) reader.refuse(run_section, "has a negative count");
  return run;
}

}  // namespace

std::uint32_t checksum_of_file(const fs::path& path, std::uint32_t before) {
  std::ifstream file(path, std::ios::binary);
  if (!file) output::throw_file_error("read", path, errno);
  std::vector<char> buffer(std::size_t(8) << 20);
  std::uint32_t crc = before;
  do {
    file.read(buffer.data(), std::streamsize(buffer.size()));
    crc = checksum(std::as_bytes(std::span(buffer.data(), std::size_t(file.gcount()))), crc);
  } while (file);
  if (!file.eof()) output::throw_file_error("read", path, errno);
  return crc;
}

std::vector<std::pair<std::int64_t, fs::path>> RunCheckpoints::files() const {
  std::vector<std::pair<std::int64_t, fs::path>> found;
  std::error_code error;
  for (fs::directory_iterator entry(folder_, error); !error && entry != fs::directory_iterator(); entry.increment(error))
    if (const auto steps = steps_of(entry->path().filename().string())) found.emplace_back(*steps, entry->path());
  if (error && error != std::errc::no_such_file_or_directory)
    output::throw_file_error("read directory", folder_, error.value());
  std::sort(found.rbegin(), found.rend());
  return found;
}

fs::path RunCheckpoints::save(std::int64_t steps, const std::function<void(StateWriter&)>& state,
                              const std::function<Run()>& run) const {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) output::throw_file_error("create directory", folder_, error.value());
  const fs::path path = folder_ / fmt::format("{}{:012}{}", prefix, steps, extension);
  output::AtomicFile file(path);
  StateWriter writer(file.stream());
  state(writer);
  const Run facts = run();
  writer.text(scene_section, facts.scene);
  writer.text(table_section, facts.table);
  writer.text(run_section, text_of(facts));
  writer.end();
  file.commit();
  std::size_t older = 0;
  for (const auto& [number, other] : files())
    if (number > steps || (number < steps && ++older >= kept)) fs::remove(other, error);
  return path;
}

std::optional<Opened> RunCheckpoints::newest(std::vector<std::string>& problems) const {
  for (const auto& [steps, path] : files()) {
    Opened opened;
    opened.file = path;
    opened.stream = std::make_unique<std::ifstream>(path, std::ios::binary);
    try {
      if (!*opened.stream) output::throw_file_error("read", path, errno);
      opened.reader = std::make_unique<StateReader>(*opened.stream, path.string());
      opened.run = read_run(*opened.reader);
      if (opened.run.steps != steps) opened.reader->refuse(run_section, "is of another step than the name of the file");
      return opened;
    } catch (const InputError& e) {
      problems.emplace_back(e.what());
    }
  }
  return std::nullopt;
}

void RunCheckpoints::clear() const {
  std::error_code error;
  for (const auto& [steps, path] : files()) {
    fs::remove(path, error);
    if (error) output::throw_file_error("remove", path, error.value());
  }
  fs::directory_iterator entry(folder_, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    std::string name = entry->path().filename().string();
    if (!name.ends_with(output::partial_suffix)) continue;
    name.erase(name.size() - std::string(output::partial_suffix).size());
    std::error_code ignored;
    if (steps_of(name)) fs::remove(entry->path(), ignored);
  }
  fs::remove(folder_, error);  // if it is empty
}

}  // namespace cleave::checkpoint
