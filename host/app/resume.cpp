#include "app/resume.hpp"

#include "checkpoint/scene_changes.hpp"
#include "common/error.hpp"
#include "plugins/isa.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <fstream>
#include <iterator>
#include <vector>

namespace cleave::app {

namespace {
std::string lines(const std::vector<std::string>& items) { return fmt::format("  {}", fmt::join(items, "\n  ")); }
}  // namespace

checkpoint::Run describe_run(const std::string& scene, int threads) {
  checkpoint::Run run;
  run.program = CLEAVE_VERSION;
  run.threads = threads;
  run.scene = scene;
  run.files = checkpoint::files_of(scene);
  return run;
}

void add_program(checkpoint::Run& run, const mpm::Simulation& simulation) {
  const auto program = std::filesystem::read_symlink("/proc/self/exe");
  run.program_crc = checkpoint::checksum_of_file(program);
  run.isa = simulation.isa();
  if (run.isa == "none") {  // plugins alone
    const auto names = plugins::preferred_isa_directories();
    run.isa = names.empty() ? "baseline" : names.front();
  } else {
    const auto kernels = program.parent_path().parent_path() / "lib/cleave/kernels" / (run.isa + ".so");
    run.program_crc = checkpoint::checksum_of_file(kernels, run.program_crc);
  }
  for (const auto& p : simulation.plugins())
    run.plugins.push_back({p.id, p.version, p.path, checkpoint::checksum_of_file(p.path)});
}

std::optional<checkpoint::Opened> find_start(const checkpoint::RunCheckpoints& checkpoints, const std::filesystem::path& out,
                                             const checkpoint::Run& now) {
  std::vector<std::string> problems;
  auto start = checkpoints.newest(problems);
  if (!start && !problems.empty())
    throw InputError(
        fmt::format("error: no checkpoint can be resumed from:\n{}\nwithout --resume the run begins anew", lines(problems)));
  for (const auto& problem : problems) fmt::print(stderr, "warning: {}\n", problem);
  checkpoint::Run before;
  if (start) {
    before = start->run;
    if (!problems.empty()) fmt::print(stderr, "going back to {}\n", start->file.string());
  } else {
    std::ifstream file(out / "scene.toml");
    before.scene.assign(std::istreambuf_iterator<char>(file), {});
    if (!before.scene.empty()) before.files = checkpoint::files_of(before.scene);
  }
  if (before.scene.empty()) return start;
  if (const auto changed = checkpoint::changed_physics(before, now); !changed.empty())
    throw InputError(
        fmt::format("error: {} is of another simulation:\n{}\nonly simulation.end_time and [output] may change; "
                    "without --resume the run begins anew",
                    start ? start->file.string() : (out / "scene.toml").string(), lines(changed)));
  return start;
}

void compare_programs(const checkpoint::Opened& start, const checkpoint::Run& now, bool anyway) {
  const auto changes = checkpoint::changes(start.run, now);
  if (!changes.program.empty()) {
    if (!anyway)
      throw InputError(
          fmt::format("error: {} was written by another program:\n{}\n--resume-anyway goes on from it, with "
                      "other bits than those of a run that never ended",
                      start.file.string(), lines(changes.program)));
    fmt::print(stderr, "warning: resumed with another program; the bits are not those of a run that never ended:\n{}\n",
               lines(changes.program));
  }
  if (!changes.notes.empty())
    fmt::print(stderr, "warning: bits may differ from those of a run that never ended:\n{}\n", lines(changes.notes));
}

}  // namespace cleave::app
