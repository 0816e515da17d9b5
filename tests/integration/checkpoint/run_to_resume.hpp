#pragma once

#include "program.hpp"

#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include <fcntl.h>
#include <algorithm>
#include <chrono>
#include <thread>

namespace cleave::test {

/// Runs that are ended and gone on with, and what they leave behind.
class RunToResume : public Program {
 protected:
  /// Starts the program and returns its process.
  pid_t start(const std::vector<std::string>& arguments) const {
    const pid_t child = fork();
    if (child != 0) return child;
    std::vector<char*> list = {const_cast<char*>(CLEAVE_PROGRAM)};
    for (const auto& a : arguments) list.push_back(const_cast<char*>(a.c_str()));
    list.push_back(nullptr);
    const int errors = open((directory / "stderr.txt").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    const int nothing = open("/dev/null", O_RDWR);
    if (chdir(directory.c_str()) != 0 || dup2(nothing, 0) < 0 || dup2(nothing, 1) < 0 || dup2(errors, 2) < 0) _exit(126);
    execv(CLEAVE_PROGRAM, list.data());
    _exit(127);
  }

  static constexpr int still_running = -1;
  /// The exit status, or the signal that ended it and 128; waits for so long.
  static int wait_for(pid_t child, std::chrono::microseconds patience) {
    const auto end = std::chrono::steady_clock::now() + patience;
    for (;;) {
      int status = 0;
      if (waitpid(child, &status, WNOHANG) == child) return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      if (std::chrono::steady_clock::now() >= end) return still_running;
      std::this_thread::sleep_for(std::chrono::microseconds(500));
    }
  }
  int finish(const std::vector<std::string>& arguments) const { return wait_for(start(arguments), std::chrono::minutes(5)); }
  std::string errors() const { return contents(directory / "stderr.txt"); }

  /// Contents of all frames and indices of a run, frames.csv without wall time.
  std::map<std::string, std::string> results(const std::string& run) const {
    std::map<std::string, std::string> all;
    for (const auto& entry : fs::recursive_directory_iterator(directory / run)) {
      const std::string name = fs::relative(entry.path(), directory / run).string();
      if (!entry.is_regular_file() || name.starts_with("checkpoints") || name == "summary.json") continue;
      all[name] = name == "frames.csv" ? without_wall_time(contents(entry.path())) : contents(entry.path());
    }
    return all;
  }
  /// All columns but wall_seconds.
  static std::string without_wall_time(const std::string& table) {
    std::stringstream lines(table);
    std::string line, text;
    std::ptrdiff_t wall = -1;
    while (std::getline(lines, line)) {
      std::vector<std::string> cells;
      std::stringstream row(line);
      for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
      if (wall < 0) wall = std::find(cells.begin(), cells.end(), "wall_seconds") - cells.begin();
      if (wall < std::ptrdiff_t(cells.size())) cells.erase(cells.begin() + wall);
      for (const std::string& cell : cells) text += cell + ",";
      text += "\n";
    }
    return text;
  }
  /// Names of results that are not the same.
  std::vector<std::string> differences(const std::string& a, const std::string& b) const {
    const auto x = results(a), y = results(b);
    std::vector<std::string> names;
    for (const auto& [name, text] : x)
      if (!y.contains(name) || y.at(name) != text) names.push_back(name);
    for (const auto& [name, text] : y)
      if (!x.contains(name)) names.push_back(name + " (only in " + b + ")");
    return names;
  }
  std::vector<fs::path> checkpoints(const std::string& run) const {
    std::vector<fs::path> found;
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(directory / run / "checkpoints", none)) found.push_back(entry.path());
    std::sort(found.begin(), found.end());
    return found;
  }
};

}  // namespace cleave::test
