#include "study/record.hpp"

#include "output/atomic_file.hpp"

#include <fmt/format.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

namespace cleave::study {
namespace {

constexpr const char* format = "cleave study run 1";
constexpr Outcome outcomes[] = {Outcome::done, Outcome::refused, Outcome::failed, Outcome::timed_out};

}  // namespace

const char* word_of(Outcome outcome) {
  constexpr const char* words[] = {"done", "refused", "failed", "timed out"};
  return words[int(outcome)];
}

double Record::wall() const {
  if (wall_seconds.empty()) return 0;
  auto sorted = wall_seconds;
  std::sort(sorted.begin(), sorted.end());
  const std::size_t n = sorted.size();
  return n % 2 == 1 ? sorted[n / 2] : (sorted[n / 2 - 1] + sorted[n / 2]) / 2;
}

bool Record::complete(int repetitions, double limit, bool count_instructions) const {
  if (outcome == Outcome::timed_out) return limit <= time_limit;
  if (outcome != Outcome::done) return true;
  return int(wall_seconds.size()) >= repetitions && (!count_instructions || instructions || !instructions_by.empty());
}

std::optional<Record> read_record(const std::filesystem::path& path) {
  std::ifstream file(path);
  const auto json = nlohmann::json::parse(file, nullptr, false);
  if (!json.is_object() || json.value("format", "") != format) return std::nullopt;
  try {
    Record record;
    const auto word = json.at("outcome").get<std::string>();
    record.outcome = *std::find_if(std::begin(outcomes), std::end(outcomes) - 1, [&](Outcome o) { return word == word_of(o); });
    record.reason = json.at("reason");
    record.time_limit = json.at("time_limit");
    record.wall_seconds = json.at("wall_seconds").get<std::vector<double>>();
    record.particles = json.at("particles");
    record.steps = json.at("steps");
    record.simulated_seconds = json.at("simulated_seconds");
    record.peak_memory = json.at("peak_memory_bytes");
    if (json.at("instructions").is_number()) record.instructions = json.at("instructions");
    record.instructions_by = json.at("instructions_by");
    record.machine = json.at("machine");
    return record;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

void write_record(const Record& record, const std::filesystem::path& path) {
  nlohmann::ordered_json json{{"format", format},
                              {"outcome", word_of(record.outcome)},
                              {"reason", record.reason},
                              {"time_limit", record.time_limit},
                              {"wall_seconds", record.wall_seconds},
                              {"particles", record.particles},
                              {"steps", record.steps},
                              {"simulated_seconds", record.simulated_seconds},
                              {"peak_memory_bytes", record.peak_memory},
                              {"instructions", nullptr},
                              {"instructions_by", record.instructions_by},
                              {"machine", record.machine}};
  if (record.instructions) json["instructions"] = *record.instructions;
  output::AtomicFile file(path);
  file.stream() << json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
  file.commit();
}

std::string this_machine() {
  std::string processor = "unknown processor";
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) {
      processor = line.substr(line.find(':') + 2);
      break;
    }
  utsname system{};
  uname(&system);
  const double memory = double(sysconf(_SC_PHYS_PAGES)) * double(sysconf(_SC_PAGESIZE));
  const std::string release = system.release;
  return fmt::format("{}, {} processors, {:.1f} GiB, {} {}", processor, sysconf(_SC_NPROCESSORS_ONLN), memory / 1073741824.0,
                     system.sysname, release.substr(0, release.find('-')));
}

}  // namespace cleave::study
