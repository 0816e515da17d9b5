#pragma once

#include "study/plan.hpp"
#include "study/record.hpp"

#include <functional>

namespace cleave::study {

/// Directory of a run: scene.toml, what `cleave run` wrote, log.txt, and record.json once it has ended.
std::filesystem::path directory_of(const std::filesystem::path& study, const Run&);
std::filesystem::path record_of(const std::filesystem::path& study, const Run&);
/// `cleave run` of it, as a person would type it.
std::string command_of(const Study&, const std::filesystem::path& study, const Run&);

struct ExecuteOptions {
  std::filesystem::path out;
  int jobs = 1;
  std::vector<std::size_t> runs;                             ///< indices, in this order
  std::function<void(std::size_t, const Record&)> finished;  ///< told once of each run that was not finished before
};

enum class Executed { all, interrupted };

/// Runs what is not yet finished, each as a process of this program, so that whatever ends it is a result. SIGINT and SIGTERM
/// end the processes; what was not finished begins anew next time. [main-thread]
Executed execute(const Study&, const Plan&, const ExecuteOptions&);

/// What a run that ended is: by its exit status or signal, and what it wrote.
Record judge(int wait_status, const std::filesystem::path& directory);

}  // namespace cleave::study
