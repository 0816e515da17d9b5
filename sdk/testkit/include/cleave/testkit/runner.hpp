/// Runs checks on a plugin library, each in a child process with a time limit: a crash, a hang, an abort or an exit of the
/// plugin is the failure of one check.
#ifndef CLEAVE_TESTKIT_RUNNER_HPP
#define CLEAVE_TESTKIT_RUNNER_HPP

#include <cleave/testkit/check.hpp>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cleave::testkit {

struct Options {
  std::filesystem::path library;
  std::uint64_t seed = 1;
  /// Run only the random case of this number (as a failure printed it).
  std::optional<std::uint64_t> reproduce = std::nullopt;
  /// Parameters that are fixed, as texts: "1e5", "true", "exact", "[1, 2]". Others are found from the schema.
  std::map<std::string, std::string> set = {};
  double time_limit = 60;  ///< s, of one check
};

enum class Verdict { passed, failed, skipped };

struct Result {
  const Check* check;
  Verdict verdict;
  std::string reason;        ///< why it failed or was skipped
  std::string remark;        ///< what a check that passed has to say, as a measurement; mostly empty
  std::string reproduction;  ///< command that runs the failing case again; empty if the check has no random cases
  double seconds;
};

struct Report {
  std::filesystem::path library;
  std::string id;  ///< of the plugin; empty if it cannot be loaded
  std::vector<Result> results;

  bool passed() const;
};

/// Checks of these IDs, all that apply to the kind if empty. Throws std::invalid_argument for an unknown ID. Call from a
/// process that has no other threads running, for it forks.
Report run_checks(const Options&, const std::vector<std::string>& ids = {});

/// IDs of the checks for the library's kind; all if it cannot be loaded.
std::vector<const char*> applicable_checks(const Options&);

/// One line per check.
std::string to_table(const Report&);
std::string to_json(const std::vector<Report>&);
std::string to_junit(const std::vector<Report>&);
/// The checks with their sentences, for a terminal and as a Markdown table.
std::string list_checks();
std::string checks_markdown();

}  // namespace cleave::testkit

#endif
