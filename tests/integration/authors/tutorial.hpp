/// A page of Markdown that can be done.
///
/// A block whose info string names a file (```cpp file=my_law.cpp) is that file. In a ```console block, lines that begin with
/// "$ " are commands, "> " continues one, and what follows is all that it prints on both streams; `...` stands for anything,
/// alone on a line for any number of lines. A command ends with status 0, or with what the info string says
/// (```console status=2).
#pragma once

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
};
using Step = std::variant<File, Command>;

/// Files and commands in the order of the page.
std::vector<Step> steps_of(const std::string& page);

/// Does all of it with bash in the directory, `environment` being run first. Returns what did not come out as it is written.
std::string do_steps(const std::vector<Step>&, const std::string& directory, const std::string& environment);

/// True if the lines are those expected.
bool matches(const std::vector<std::string>& expected, const std::vector<std::string>& lines);

}  // namespace cleave::test
