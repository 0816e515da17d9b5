#pragma once

#include "plugins/registry.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace cleave::app {

struct StudyOptions {
  std::vector<std::filesystem::path> studies;
  std::filesystem::path out;        ///< empty: out/<study name>; of several studies, the directory of their directories
  std::filesystem::path charts;     ///< empty: none copied
  std::string jobs = "1";           ///< runs at a time, or "slurm" or "parallel"
  std::filesystem::path machines;   ///< of "parallel": file of its --sshloginfile; empty: this machine
  std::vector<std::string> values;  ///< "axis=value"
  bool dry_run = false;
  std::string runs;  ///< "3" or "3:7": these alone, without charts
  bool collect = false;
};

void add_study_options(CLI::App&, StudyOptions&);

/// `cleave study`. Returns the exit status: 0 done, whatever came of the points; 130 interrupted. Throws InputError.
int study_command(const StudyOptions&, const plugins::Registry&);

}  // namespace cleave::app
