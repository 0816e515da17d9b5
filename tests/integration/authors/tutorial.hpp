/// A page of Markdown that can be done.
///
/// A block whose info string names a file (```cpp file=my_law.cpp) is that file. In a ```console block, lines that begin with
/// "$ " are commands, "> " continues one, and what follows is all that it prints on both streams; `...` stands for anything,
/// alone on a line for any number of lines. A command ends with status 0, or with what the info string says
/// (```console status=2). What a block needs beyond what every reader has it names (```console needs=blender,xvfb-run).
#pragma once

#include <set>
#include <string>
#include <variant>
#include <vector>

namespace cleave::test {

struct File {
  std::string name, text;
};
struct Command {
  int line;  ///< of the page
  int status;
  std::string text;
  std::vector<std::string> output;
  std::vector<std::string> needs;  ///< programs
};
using Step = std::variant<File, Command>;

/// Files and commands in the order of the page.
std::vector<Step> steps_of(const std::string& page);

/// Takes out the commands that need a program which is not there, and returns the names of these programs.
std::set<std::string> leave_out(std::vector<Step>&, bool (*is_there)(const std::string& program));

/// Does all of it with bash in the directory, `environment` being run first. Returns what did not come out as it is written.
std::string do_steps(const std::vector<Step>&, const std::string& directory, const std::string& environment);

/// True if the lines are those expected.
bool matches(const std::vector<std::string>& expected, const std::vector<std::string>& lines);

}  // namespace cleave::test
