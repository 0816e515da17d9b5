#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::study {

/// A program that runs beside this one, in a process group of its own that ends with this program.
class Child {
 public:
  /// stdout and stderr go to `log`. Throws InputError if there can be no further process.
  Child(const std::vector<std::string>& command, const std::filesystem::path& log);
  ~Child();  ///< ends it
  Child(Child&&) noexcept;
  Child& operator=(Child&&) = delete;

  double seconds() const;  ///< since its start
  /// How it ended, as waitpid() says it; empty while it runs.
  std::optional<int> ended();
  void kill();  ///< and all that it has started

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
  std::chrono::steady_clock::time_point start_;
};

/// Status of a program that was found in PATH and has ended; nothing if there is none.
std::optional<int> try_program(const std::vector<std::string>& command, const std::filesystem::path& log);

}  // namespace cleave::study
