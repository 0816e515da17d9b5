#pragma once

#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace cleave::test {

struct Outcome {
  int status;
  std::string output;  ///< both streams
};

inline Outcome shell(const std::string& command) {
  Outcome outcome{-1, {}};
  FILE* pipe = popen(("{ " + command + "\n} 2>&1").c_str(), "r");
  if (!pipe) return outcome;
  char buffer[4096];
  while (const std::size_t bytes = std::fread(buffer, 1, sizeof buffer, pipe)) outcome.output.append(buffer, bytes);
  const int status = pclose(pipe);
  outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return outcome;
}

inline bool have(const std::string& program) { return shell("command -v " + program).status == 0; }

}  // namespace cleave::test
