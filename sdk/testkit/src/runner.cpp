#include <cleave/testkit/context.hpp>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <stdexcept>

namespace cleave::testkit {
namespace {

using Clock = std::chrono::steady_clock;

template <std::size_t N>
void copy(char (&destination)[N], const std::string& text) {
  const std::size_t length = std::min(text.size(), N - 1);
  std::memcpy(destination, text.data(), length);
  destination[length] = '\0';
}

void finish(Shared& shared, Verdict verdict, const std::string& reason) {
  shared.verdict = verdict;
  copy(shared.reason, reason);
  __sync_synchronize();
  shared.finished = 1;
}

/// What is to be done in the child: returns if it went well.
using Action = std::function<void(Shared&)>;

void child(const Action& action, Shared& shared, const Options& options) {
  setpgid(0, 0);
  // Whatever a plugin prints is no part of the report. To see why a case fails it is: what sanitizers find, say.
  const int nowhere = open("/dev/null", O_RDWR);
  for (int stream : {0, 1}) dup2(nowhere, stream);
  if (!options.reproduce) dup2(nowhere, 2);
  try {
    action(shared);
    finish(shared, Verdict::passed, "");
  } catch (const Failed& failed) {
    finish(shared, Verdict::failed, failed.reason);
  } catch (const Skipped& skipped) {
    shared.reproduction[0] = '\0';
    finish(shared, Verdict::skipped, skipped.reason);
  } catch (const std::exception& error) {
    finish(shared, Verdict::failed, std::string("an exception: ") + error.what());
  } catch (...) {
    finish(shared, Verdict::failed, "an exception left the plugin");
  }
  _exit(0);
}

/// Status of the child, or nothing if the time limit passed.
std::optional<int> wait_for(pid_t process, double time_limit) {
  const auto end = Clock::now() + std::chrono::duration<double>(time_limit);
  for (;;) {
    int status = 0;
    const pid_t ended = waitpid(process, &status, WNOHANG);
    if (ended == process) return status;
    if (ended < 0 && errno != EINTR) throw std::runtime_error("waitpid failed");
    if (Clock::now() > end) return std::nullopt;
    const timespec nap{0, 500000};
    nanosleep(&nap, nullptr);
  }
}

std::string seconds_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%g s", seconds);
  return text;
}

/// Runs the action in a child of its own; `shared` holds the verdict whatever became of the child.
void isolated(const Action& action, Shared& shared, const Options& options) {
  std::fflush(nullptr);
  const pid_t process = fork();
  if (process < 0) throw std::runtime_error("cannot start a process for the check");
  if (process == 0) child(action, shared, options);
  const std::optional<int> status = wait_for(process, options.time_limit);
  kill(-process, SIGKILL);  // and processes it may have started
  if (!status) {
    kill(process, SIGKILL);
    waitpid(process, nullptr, 0);
  }
  if (shared.finished) return;
  shared.doing[sizeof shared.doing - 1] = '\0';
  std::string what;
  if (!status)
    what = "did not end within " + seconds_text(options.time_limit);
  else if (WIFSIGNALED(*status))
    what = std::string("crashed: ") + strsignal(WTERMSIG(*status));
  else
    what = "the plugin ended the process with exit status " + std::to_string(WEXITSTATUS(*status));
  finish(shared, Verdict::failed, what + (shared.doing[0] ? std::string(", ") + shared.doing : ""));
}

class SharedMemory {
 public:
  SharedMemory() {
    void* memory = mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) throw std::runtime_error("no memory for the check");
    shared_ = static_cast<Shared*>(memory);
  }
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  ~SharedMemory() { munmap(shared_, sizeof(Shared)); }
  Shared& operator*() const { return *shared_; }

 private:
  Shared* shared_;
};

std::string quoted(const std::string& word) {
  if (word.find_first_of(" '\"$`\\*[]{}();&|<>") == std::string::npos) return word;
  std::string result = "'";
  for (char c : word) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

std::string command(const Options& options, const char* check, std::uint64_t number) {
  std::string text = "cleave check " + quoted(options.library.string()) + " --only " + check;
  for (const auto& [key, value] : options.set) text += " --set " + quoted(key + "=" + value);
  return text + " --reproduce " + std::to_string(number);
}

/// What the other checks take for granted.
constexpr const char* loading_check = "abi.loads";

}  // namespace

const Plugin& Context::plugin() {
  if (!plugin_) plugin_ = std::make_unique<Plugin>(options_.library);
  return *plugin_;
}

void Context::doing(const std::string& what) { copy(shared_.doing, what); }

void Context::remark(const std::string& what) { copy(shared_.remark, what); }

void Context::fail_at_once(const char* reason) const {
  shared_.verdict = Verdict::failed;
  // No allocation: this is called where the plugin may be inside of the allocator.
  std::strncpy(shared_.reason, reason, sizeof shared_.reason - 1);
  __sync_synchronize();
  shared_.finished = 1;
  _exit(0);
}

bool Context::accepts(const Settings& settings, std::string* words) {
  try {
    Instance instance(plugin(), settings);
    return true;
  } catch (const Failed& failed) {
    if (words) *words = failed.reason;
    return false;
  }
}

const std::vector<Settings>& Context::settings() {
  if (!settings_.empty()) return settings_;
  const cleave_schema& schema = plugin().schema();
  const Settings fixed = read_settings(schema, options_.set);
  const double stress = plugin().kind() == elasticity_kind ? 0 : 0.01 * Material::youngs_modulus;
  std::string words = "no set of parameters to try";
  for (const auto& keys : required_keys(schema))
    for (double place : {0.5, 0.3, 0.7, 0.1, 0.9}) {
      Settings candidate = fixed;
      for (const auto& key : keys)
        if (const auto* parameter = find(schema, key)) candidate.try_emplace(key, typical_value(*parameter, place, stress));
      if (!accepts(candidate, &words)) continue;
      settings_.push_back(candidate);
      break;
    }
  if (settings_.empty()) skip("no parameters found that the law accepts, give them with --set (" + words + ")");
  const Settings first = settings_.front();
  for (const auto& [key, value] : switches(schema)) {
    Settings candidate = first;
    if (candidate.try_emplace(key, value).second && accepts(candidate, nullptr)) settings_.push_back(candidate);
  }
  return settings_;
}

std::optional<Settings> Context::settings_at(double place) {
  const Settings fixed = read_settings(plugin().schema(), options_.set);
  const double stress = plugin().kind() == elasticity_kind ? 0 : 0.01 * Material::youngs_modulus;
  Settings candidate = settings().front();
  for (auto& [key, value] : candidate)
    if (!fixed.contains(key)) value = typical_value(*find(plugin().schema(), key), place, stress);
  if (!accepts(candidate, nullptr)) return std::nullopt;
  return candidate;
}

void Context::random_cases(int count, const std::function<void(Random&)>& body) {
  const auto run = [&](std::uint64_t number) {
    copy(shared_.reproduction, command(options_, check_->id, number));
    Random random(number);
    body(random);
  };
  if (options_.reproduce) {
    run(*options_.reproduce);
  } else {
    Random numbers(options_.seed);
    // Short numbers are easier to copy; 2^40 of them are enough.
    for (int i = 0; i < count; ++i) run(numbers.bits() >> 24);
  }
  shared_.reproduction[0] = '\0';
}

bool Report::passed() const {
  return std::none_of(results.begin(), results.end(), [](const Result& r) { return r.verdict == Verdict::failed; });
}

namespace {
/// Verdict, ID and kind of the library.
void probe(const Options& options, Shared& probed) {
  isolated(
      [&](Shared& shared) {
        const Plugin plugin(options.library);
        copy(shared.id, plugin.id());
        shared.kind = plugin.kind();
      },
      probed, options);
}
}  // namespace

std::vector<const char*> applicable_checks(const Options& options) {
  SharedMemory probed;
  probe(options, *probed);
  std::vector<const char*> ids;
  for (const Check& check : all_checks())
    if ((*probed).verdict != Verdict::passed || (check.kinds & (*probed).kind)) ids.push_back(check.id);
  return ids;
}

Report run_checks(const Options& options, const std::vector<std::string>& ids) {
  std::vector<const Check*> chosen;
  for (const Check& check : all_checks())
    if (ids.empty() || std::find(ids.begin(), ids.end(), check.id) != ids.end()) chosen.push_back(&check);
  for (const auto& id : ids)
    if (std::none_of(chosen.begin(), chosen.end(), [&](const Check* check) { return id == check->id; }))
      throw std::invalid_argument("there is no check \"" + id + "\"; see cleave check --list");

  Report report;
  report.library = options.library;
  SharedMemory probed;
  probe(options, *probed);
  report.id = (*probed).id;

  for (const Check* check : chosen) {
    const bool applies = (*probed).verdict != Verdict::passed || (check->kinds & (*probed).kind);
    if (!applies && ids.empty()) continue;
    Result result{check, Verdict::skipped, "", "", "", 0};
    const auto begin = Clock::now();
    if ((*probed).verdict == Verdict::failed && std::strcmp(check->id, loading_check) != 0) {
      result.reason = "the plugin cannot be loaded, see " + std::string(loading_check);
    } else if (!applies) {
      result.reason = "for " + kinds_text(check->kinds) + " only";
    } else {
      SharedMemory memory;
      isolated(
          [&](Shared& shared) {
            // Outlives the end of the process: destructors of a plugin that failed are not asked for more.
            auto* context = new Context(options, check, shared);
            check->run(*context);
          },
          *memory, options);
      result.verdict = (*memory).verdict;
      result.reason = (*memory).reason;
      result.reproduction = (*memory).reproduction;
      if (result.verdict == Verdict::passed) result.remark = (*memory).remark;
    }
    result.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    report.results.push_back(result);
  }
  return report;
}

}  // namespace cleave::testkit
