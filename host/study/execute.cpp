#include "study/execute.hpp"

#include "common/error.hpp"
#include "common/interrupts.hpp"
#include "output/atomic_file.hpp"
#include "study/child.hpp"

#include <fmt/format.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <deque>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

namespace cleave::study {
namespace {

namespace fs = std::filesystem;

volatile std::sig_atomic_t interrupted = 0;
void on_interrupt(int) { interrupted = 1; }

struct InterruptGuard {
  InterruptGuard() { interrupted = 0; }
  Interrupts interrupts{&on_interrupt};
};

std::string contents(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

void write_text(const fs::path& path, const std::string& text) {
  output::AtomicFile file(path);
  file.stream() << text;
  file.commit();
}

/// What a program said of its end: the first line that is an error, without the place of a scene nobody wrote; else the last.
std::string last_words(const std::string& log) {
  std::istringstream lines(log);
  std::string last;
  for (std::string line; std::getline(lines, line);) {
    if (line.empty()) continue;
    last = line;
    if (const auto error = line.find("error: "); error != std::string::npos) return line.substr(error + 7);
  }
  return last;
}

std::vector<std::string> run_command(const Study& study, const fs::path& directory, const char* out) {
  return {fs::read_symlink("/proc/self/exe").string(),
          "run",
          (directory / "scene.toml").string(),
          "--out",
          (directory / out).string(),
          "--threads",
          std::to_string(study.threads),
          "--quiet"};
}

/// Instructions of a program, counted by the processor where the system lets us, else by valgrind.
class Counter {
 public:
  explicit Counter(const fs::path& directory) {
    const fs::path log = directory / "counter.txt";
    if (try_program({"perf", "stat", "-x", ",", "-e", "instructions:u", "true"}, log) && perf_count(contents(log)))
      by_ = "perf";
    else if (const auto status = try_program({"valgrind", "--version"}, log); status == 0)
      by_ = "valgrind";
    else
      by_ = "not counted: neither perf nor valgrind can be used";
    fs::remove(log);
  }

  const std::string& by() const { return by_; }
  bool usable() const { return by_ == "perf" || by_ == "valgrind"; }

  std::vector<std::string> command(const std::vector<std::string>& program) const {
    std::vector<std::string> words{"perf", "stat", "-x", ",", "-e", "instructions:u"};
    // valgrind knows no AVX-512
    if (by_ == "valgrind")
      words = {"env", "CLEAVE_ISA=x86-64-v3", "valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"};
    words.insert(words.end(), program.begin(), program.end());
    return words;
  }

  std::optional<double> count(const std::string& log) const { return by_ == "perf" ? perf_count(log) : valgrind_count(log); }

 private:
  /// "12345,,instructions:u,..."
  static std::optional<double> perf_count(const std::string& log) {
    std::istringstream lines(log);
    for (std::string line; std::getline(lines, line);)
      if (line.find("instructions") != std::string::npos && !line.empty() && line[0] >= '0' && line[0] <= '9')
        return std::strtod(line.c_str(), nullptr);
    return std::nullopt;
  }
  /// "==123== Collected : 12345"
  static std::optional<double> valgrind_count(const std::string& log) {
    const auto at = log.find("Collected : ");
    if (at == std::string::npos) return std::nullopt;
    return std::strtod(log.c_str() + at + 12, nullptr);
  }

  std::string by_;
};

/// A run that is being worked on.
struct Active {
  std::size_t index;
  Record record;
  bool counting = false;  ///< instructions, not time
  std::unique_ptr<Child> child;
};

class Executor {
 public:
  Executor(const Study& study, const Plan& plan, const ExecuteOptions& options)
      : study_(study), plan_(plan), options_(options), machine_(this_machine()) {}

  Executed work() {
    std::deque<std::size_t> waiting(options_.runs.begin(), options_.runs.end());
    std::vector<Active> active;
    while (!waiting.empty() || !active.empty()) {
      while (!waiting.empty() && int(active.size()) < options_.jobs) {
        if (auto next = begin(waiting.front())) active.push_back(std::move(*next));
        waiting.pop_front();
      }
      if (interrupted) return Executed::interrupted;
      for (std::size_t i = 0; i < active.size();) {
        if (advance(active[i])) {
          ++i;
        } else {
          options_.finished(active[i].index, active[i].record);
          active.erase(active.begin() + std::ptrdiff_t(i));
        }
      }
      if (!active.empty()) ::usleep(2000);
    }
    return Executed::all;
  }

 private:
  fs::path directory(const Active& a) const { return directory_of(options_.out, plan_.runs[a.index]); }
  fs::path record(const Active& a) const { return record_of(options_.out, plan_.runs[a.index]); }

  /// Nothing if the run is finished already, or its scene is refused.
  std::optional<Active> begin(std::size_t index) {
    const Run& run = plan_.runs[index];
    Active a{index, {}, false, nullptr};
    if (auto kept = read_record(record(a))) {
      if (kept->complete(study_.repetitions, study_.time_limit, study_.instructions)) return std::nullopt;
      if (kept->outcome == Outcome::done) a.record = std::move(*kept);
    }
    fs::create_directories(directory(a));
    a.record.time_limit = study_.time_limit;
    a.record.machine = machine_;
    if (run.scene.empty()) {
      a.record.outcome = Outcome::refused;
      a.record.reason = last_words(run.refusal);
      write_record(a.record, record(a));
      options_.finished(index, a.record);
      return std::nullopt;
    }
    write_text(directory(a) / "scene.toml", run.scene);
    start(a);
    return a;
  }

  void start(Active& a) {
    a.counting = int(a.record.wall_seconds.size()) >= study_.repetitions;
    const char* out = a.counting ? "counted" : "run";
    fs::remove_all(directory(a) / out);
    auto command = run_command(study_, directory(a), out);
    if (a.counting) {
      if (!counter_) counter_.emplace(options_.out);
      a.record.instructions_by = counter_->by();
      if (!counter_->usable()) return;
      command = counter_->command(command);
    }
    a.child = std::make_unique<Child>(command, directory(a) / (a.counting ? "counting.txt" : "log.txt"));
  }

  /// False once the run has ended for good.
  bool advance(Active& a) {
    if (a.child) {
      // a program under valgrind takes some fifty times as long
      const double limit = study_.time_limit * (a.counting ? 100 : 1);
      const auto status = a.child->ended();
      if (!status && a.child->seconds() < limit) return true;
      if (a.counting) {
        if (status) a.record.instructions = counter_->count(contents(directory(a) / "counting.txt"));
        if (!a.record.instructions) a.record.instructions_by = "not counted: " + a.record.instructions_by + " gave no number";
      } else if (!status) {
        a.child->kill();
        a.record.outcome = Outcome::timed_out;
        a.record.reason = fmt::format("not finished after {:g} s", study_.time_limit);
      } else {
        add(a, judge(*status, directory(a)));
      }
      a.child.reset();
    }
    write_record(a.record, record(a));
    if (a.record.complete(study_.repetitions, study_.time_limit, study_.instructions)) return false;
    start(a);
    return true;
  }

  /// Another repetition: all but its time is as before.
  void add(Active& a, Record result) {
    result.wall_seconds.insert(result.wall_seconds.begin(), a.record.wall_seconds.begin(), a.record.wall_seconds.end());
    result.peak_memory = std::max(result.peak_memory, a.record.peak_memory);
    result.time_limit = study_.time_limit;
    result.machine = machine_;
    a.record = std::move(result);
  }

  const Study& study_;
  const Plan& plan_;
  const ExecuteOptions& options_;
  std::string machine_;
  std::optional<Counter> counter_;
};

}  // namespace

fs::path directory_of(const fs::path& study, const Run& run) { return study / "runs" / run.key; }
fs::path record_of(const fs::path& study, const Run& run) { return directory_of(study, run) / "record.json"; }

std::string command_of(const Study& study, const fs::path& out, const Run& run) {
  if (!run.scene.empty())
    return fmt::format("cleave run {} --threads {}", (directory_of(out, run) / "scene.toml").string(), study.threads);
  std::string command = "cleave run " + study.scene.string();
  for (const auto& given : run.overrides) command += fmt::format(" --set '{}={}'", given.path, given.value);
  return command;
}

Record judge(int status, const fs::path& directory) {
  Record record;
  const auto json = nlohmann::json::parse(contents(directory / "run/summary.json"), nullptr, false);
  const auto number = [&](const char* name) {
    const auto member = json.is_object() ? json.find(name) : json.end();
    return member != json.end() && member->is_number() ? member->get<double>() : 0.0;
  };
  const std::string log = contents(directory / "log.txt");
  if (WIFSIGNALED(status)) {
    record.outcome = Outcome::failed;
    record.reason = fmt::format("the program was ended by signal {} ({})", WTERMSIG(status), strsignal(WTERMSIG(status)));
    return record;
  }
  record.particles = std::int64_t(number("particles"));
  record.steps = std::int64_t(number("steps"));
  record.simulated_seconds = number("simulated_seconds");
  record.peak_memory = number("peak_memory_bytes");
  const double speed = number("particle_steps_per_second");
  if (speed > 0) record.wall_seconds = {record.particle_steps() / speed};
  switch (WEXITSTATUS(status)) {
    case 0:
      if (record.wall_seconds.empty()) record.wall_seconds = {0};
      return record;
    case 2:
      record.outcome = Outcome::refused;
      record.reason = last_words(log);
      return record;
    case 3: {
      record.outcome = Outcome::failed;
      const std::string failure = contents(directory / "run/failure.txt");
      record.reason = failure.substr(0, failure.find('\n'));
      if (record.reason.empty()) record.reason = last_words(log);
      return record;
    }
    default:
      record.outcome = Outcome::failed;
      record.reason = fmt::format("exit status {}: {}", WEXITSTATUS(status), last_words(log));
      return record;
  }
}

Executed execute(const Study& study, const Plan& plan, const ExecuteOptions& options) {
  const InterruptGuard guard;
  fs::create_directories(options.out / "runs");
  return Executor(study, plan, options).work();
}

}  // namespace cleave::study
