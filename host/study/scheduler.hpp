#pragma once

#include "study/execute.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace cleave::study {

enum class Scheduler {
  slurm,    ///< a job array, by sbatch
  parallel  ///< GNU parallel, on this machine or on several
};

/// Runs that somebody else gives to machines; their directory, `out`, is one that all of these see.
struct HandOver {
  Scheduler scheduler = Scheduler::slurm;
  std::filesystem::path out;
  std::filesystem::path study;      ///< file
  std::vector<std::string> values;  ///< further values of axes, "axis=value"
  int threads = 1;                  ///< of each run
  std::vector<std::size_t> runs;    ///< indices
  std::filesystem::path machines;   ///< of GNU parallel: its --sshloginfile; empty: this machine alone
};

/// The script that does it, a job for each run: `cleave study ... --run K`.
std::filesystem::path script_of(const HandOver&);
std::string script_text(const HandOver&);

/// Writes the script, hands it to the scheduler and waits until all of its jobs have ended. What the scheduler says goes to
/// jobs.txt beside it. Throws InputError if there is no such scheduler, or it refuses. After an interrupt jobs of Slurm go on.
/// [main-thread]
Executed hand_over(const HandOver&);

}  // namespace cleave::study
