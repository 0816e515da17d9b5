#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::study {

enum class Outcome { done, refused, failed, timed_out };
const char* word_of(Outcome);

/// What is kept of a run, in <study>/runs/<key>/record.json.
struct Record {
  Outcome outcome = Outcome::done;
  std::string reason;                ///< of all but done
  double time_limit = 0;             ///< s that it was given
  std::vector<double> wall_seconds;  ///< of the steps, one for each repetition
  std::int64_t particles = 0, steps = 0;
  double simulated_seconds = 0;
  double peak_memory = 0;  ///< bytes, the most of any repetition
  std::optional<double> instructions;
  std::string instructions_by;  ///< "perf" or "valgrind"; why there are none if they were asked for
  std::string machine;

  double particle_steps() const { return double(particles) * double(steps); }
  double wall() const;  ///< median, s
  /// No further run is needed for this many repetitions, this limit of time and, if asked, instructions.
  bool complete(int repetitions, double limit, bool count_instructions) const;
};

/// Empty if there is none, or one that cannot be read.
std::optional<Record> read_record(const std::filesystem::path&);
void write_record(const Record&, const std::filesystem::path&);

/// "AMD EPYC 9R14, 2 processors, 7.6 GiB, Linux 6.1".
std::string this_machine();

}  // namespace cleave::study
