/// What a check sees of the run it is part of.
#ifndef CLEAVE_TESTKIT_CONTEXT_HPP
#define CLEAVE_TESTKIT_CONTEXT_HPP

#include <cleave/testkit/check.hpp>
#include <cleave/testkit/plugin.hpp>
#include <cleave/testkit/random.hpp>
#include <cleave/testkit/runner.hpp>

#include <functional>
#include <memory>
#include <optional>

namespace cleave::testkit {

/// Memory shared with the parent process, which reads it also if the child did not end by itself.
struct Shared {
  volatile int finished;  ///< nonzero once the verdict stands
  Verdict verdict;
  char reason[4096];
  char reproduction[1024];
  char doing[512];
  char remark[512];
  char id[256];
  std::uint32_t kind;
};

class Context {
 public:
  Context(const Options& options, const Check* check, Shared& shared) : options_(options), check_(check), shared_(shared) {}

  const std::filesystem::path& library() const { return options_.library; }
  std::uint64_t seed() const { return options_.seed; }

  /// Opened at the first call.
  const Plugin& plugin();
  /// Unloads it again; the next call of plugin() opens it anew.
  void close() { plugin_.reset(); }
  /// Parameters the law accepts: one for each choice among alternatives that some typical values satisfy, then the first of
  /// them with each of switches(). Throws Skipped if there are none (which `metadata.parameter-space` reports).
  const std::vector<Settings>& settings();
  /// Further ones with other values of the numbers: `place` as for typical_value(). Empty if the law refuses.
  std::optional<Settings> settings_at(double place);

  /// Named in the failure if the plugin crashes or hangs from here on.
  void doing(const std::string&);

  /// Runs `body` for `count` random cases, or for the one to be reproduced. A failing case is named with the command that
  /// runs it again.
  void random_cases(int count, const std::function<void(Random&)>& body);

  /// Reported with the verdict if the check passes.
  void remark(const std::string&);

  [[noreturn]] void fail(const std::string& reason) const { throw Failed{reason}; }
  [[noreturn]] void skip(const std::string& reason) const { throw Skipped{reason}; }
  /// Ends the process with this failure: for places that cannot throw.
  [[noreturn]] void fail_at_once(const char* reason) const;

 private:
  bool accepts(const Settings&, std::string* words);

  const Options& options_;
  const Check* check_;
  Shared& shared_;
  std::unique_ptr<Plugin> plugin_;
  std::vector<Settings> settings_;
};

}  // namespace cleave::testkit

#endif
