#include "study/scheduler.hpp"

#include "common/error.hpp"
#include "common/interrupts.hpp"
#include "output/atomic_file.hpp"
#include "study/child.hpp"

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>

namespace cleave::study {
namespace {

namespace fs = std::filesystem;

volatile std::sig_atomic_t interrupted = 0;
void on_interrupt(int) { interrupted = 1; }

constexpr int cannot_execute = 127;

/// A word of a shell.
std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

/// Numbers of the runs, counted from 1, as Slurm writes arrays: "1-3,7".
std::string ranges(std::vector<std::size_t> runs) {
  std::sort(runs.begin(), runs.end());
  std::string text;
  for (std::size_t i = 0; i < runs.size();) {
    std::size_t last = i;
    while (last + 1 < runs.size() && runs[last + 1] == runs[last] + 1) ++last;
    text += fmt::format("{}{}", text.empty() ? "" : ",", runs[i] + 1);
    if (last > i) text += fmt::format("-{}", runs[last] + 1);
    i = last + 1;
  }
  return text;
}

std::string command_of(const HandOver& work, const std::string& number) {
  std::string text = fmt::format("{} study {} --out {}", quoted(fs::read_symlink("/proc/self/exe").string()),
                                 quoted(fs::absolute(work.study).string()), quoted(fs::absolute(work.out).string()));
  for (const std::string& value : work.values) text += " --value " + quoted(value);
  return text + " --run " + number;
}

std::string last_line(const fs::path& log) {
  std::ifstream file(log);
  std::string last;
  for (std::string line; std::getline(file, line);)
    if (!line.empty()) last = line;
  return last;
}

}  // namespace

fs::path script_of(const HandOver& work) {
  return work.out / (work.scheduler == Scheduler::slurm ? "slurm.sh" : "parallel.sh");
}

std::string script_text(const HandOver& work) {
  const std::string out = fs::absolute(work.out).string();
  // What the keys of runs hang on has to be the same everywhere.
  std::string environment, remembered;
  for (const char* name : {"CLEAVE_PLUGIN_PATH", "CLEAVE_ISA"})
    if (const char* value = std::getenv(name)) {
      environment += fmt::format("export {}={}\n", name, quoted(value));
      remembered += fmt::format("--env {} ", name);
    }
  if (work.scheduler == Scheduler::slurm)
    return fmt::format(
        "#!/bin/sh\n#SBATCH --job-name=cleave-study\n#SBATCH --array={}\n#SBATCH --ntasks=1\n#SBATCH --cpus-per-task={}\n"
        "#SBATCH --output=slurm_%a.txt\n{}exec {}\n",
        ranges(work.runs), work.threads, environment, command_of(work, "\"$SLURM_ARRAY_TASK_ID\""));
  std::string numbers;
  for (const std::size_t run : work.runs) numbers += fmt::format(" {}", run + 1);
  const std::string machines = work.machines.empty() ? ""
                                                     : fmt::format("--sshloginfile {} --workdir {} ",
                                                                   quoted(fs::absolute(work.machines).string()), quoted(out));
  // of the cores of each machine as many jobs as their threads fill
  return fmt::format("#!/bin/sh\n{}exec parallel --will-cite --jobs {}% {}{}{} :::{}\n", environment,
                     std::max(1, 100 / work.threads), machines, remembered, quoted(command_of(work, "{}")), numbers);
}

Executed hand_over(const HandOver& work) {
  interrupted = 0;
  const Interrupts interrupts(&on_interrupt);
  fs::create_directories(work.out / "runs");
  const fs::path script = script_of(work), log = work.out / "jobs.txt";
  {
    output::AtomicFile file(script);
    file.stream() << script_text(work);
    file.commit();
  }
  const bool slurm = work.scheduler == Scheduler::slurm;
  Child child(slurm ? std::vector<std::string>{"sbatch", "--wait", "--chdir=" + fs::absolute(work.out).string(),
                                               fs::absolute(script).string()}
                    : std::vector<std::string>{"/bin/sh", script.string()},
              log);
  while (!child.ended()) {
    if (interrupted) return Executed::interrupted;
    ::usleep(20000);
  }
  const int status = *child.ended();
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return Executed::all;
  const char* program = slurm ? "sbatch" : "parallel";
  if (WIFEXITED(status) && WEXITSTATUS(status) == cannot_execute)
    throw InputError(fmt::format("--jobs {}: error: there is no {} here{}; the script is {}", slurm ? "slurm" : "parallel",
                                 program, slurm ? "" : " (on Debian: apt install parallel)", script.string()));
  throw InputError(fmt::format(
      "--jobs {}: error: {} ended with {}: {}; all it said is in {}; the same command goes on", slurm ? "slurm" : "parallel",
      program, WIFEXITED(status) ? fmt::format("status {}", WEXITSTATUS(status)) : fmt::format("signal {}", WTERMSIG(status)),
      last_line(log), log.string()));
}

}  // namespace cleave::study
