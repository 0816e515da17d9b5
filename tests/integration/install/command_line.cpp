// What a shell and a reader of manuals get of the command line: it follows from the commands themselves, so these tests compare
// it with what the program accepts and with what `--help` says.
#include "shell.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <sstream>

namespace cleave::test {
namespace {

using ::testing::HasSubstr;

const std::string program = CLEAVE_PROGRAM;

/// The words that bash offers for the last of these.
std::vector<std::string> completed(const std::string& words, int last) {
  const Outcome bash =
      shell("PATH=$(dirname " + program + "):$PATH bash -c 'source <(" + program + " completion bash) && COMP_WORDS=(" + words +
            ") && COMP_CWORD=" + std::to_string(last) + " && _cleave && echo ${COMPREPLY[@]}'");
  EXPECT_EQ(bash.status, 0) << bash.output;
  std::istringstream line(bash.output);
  return {std::istream_iterator<std::string>(line), {}};
}

/// All commands, as paths: "run", "bench steps", ...
std::vector<std::string> commands(const std::string& path = "") {
  std::vector<std::string> all;
  std::istringstream help(shell(program + " " + path + " --help").output);
  std::string line;
  while (std::getline(help, line) && line != "Subcommands:") {
  }
  while (std::getline(help, line) && line.starts_with("  ")) {
    std::istringstream words(line);
    std::string name;
    words >> name;
    if (line[2] == ' ' || name.empty()) continue;  // a description that goes on
    const std::string command = path.empty() ? name : path + " " + name;
    const auto below = commands(command);
    if (below.empty()) all.push_back(command);
    all.insert(all.end(), below.begin(), below.end());
  }
  return all;
}

std::vector<std::string> options(const std::string& command) {
  const std::string help = shell(program + " " + command + " --help").output;
  std::vector<std::string> all;
  const std::regex option("\\n  (?:-[a-z],)?(--[a-z][-a-z0-9]*)");
  for (std::sregex_iterator match(help.begin(), help.end(), option), end; match != end; ++match) all.push_back((*match)[1]);
  return all;
}

TEST(Completion, OffersCommandsAndTheirOptions) {
  EXPECT_THAT(completed("cleave ru", 1), ::testing::ElementsAre("run"));
  EXPECT_THAT(completed("cleave bench st", 2), ::testing::ElementsAre("steps"));
  EXPECT_THAT(completed("cleave run --thr", 2), ::testing::ElementsAre("--threads"));
  EXPECT_THAT(completed("cleave run scene.toml --res", 3), ::testing::ElementsAre("--resume", "--resume-anyway"));
  EXPECT_THAT(completed("cleave --isa x86-64-v", 2), ::testing::IsEmpty()) << "has no listed values: file names are bash's own";
  EXPECT_THAT(completed("cleave bench steps --precision s", 4), ::testing::ElementsAre("single"));
  EXPECT_THAT(completed("cleave new-plugin --di", 2), ::testing::ElementsAre("--dir"));
}

TEST(Completion, OffersThePluginsThatAreFound) {
  EXPECT_THAT(completed("cleave plugins elasticity/q", 2), ::testing::ElementsAre("elasticity/qr"));
  EXPECT_THAT(completed("cleave check plasticity/von", 2), ::testing::ElementsAre("plasticity/von-mises"));
}

TEST(Completion, KnowsEveryOptionOfEveryCommand) {
  const auto all = commands();
  ASSERT_GE(all.size(), 9u);
  for (const std::string& command : all) {
    const int words = 1 + int(std::count(command.begin(), command.end(), ' ')) + 1;
    const auto offered = completed("cleave " + command + " --", words);
    const auto wanted = options(command);
    EXPECT_THAT(offered, ::testing::IsSupersetOf(wanted)) << command;
    EXPECT_FALSE(wanted.empty()) << command;
  }
}

TEST(Completion, IsUnderstoodByFishAndZsh) {
  if (!have("fish") || !have("zsh")) GTEST_SKIP() << "fish or zsh is not installed";
  const Outcome fish = shell("fish -c '" + program + " completion fish | source; complete -C \"cleave run --thr\"'");
  EXPECT_THAT(fish.output, HasSubstr("--threads"));
  const Outcome zsh = shell("zsh -f -c 'autoload -U compinit bashcompinit && compinit -u && bashcompinit && source <(" +
                            program + " completion bash) && whence _cleave'");
  EXPECT_EQ(zsh.status, 0) << zsh.output;
}

TEST(Manual, HasEveryCommandAndOption) {
  if (!have("man")) GTEST_SKIP() << "man is not installed";
  const Outcome page =
      shell(program +
            " manual > ${TMPDIR:-/tmp}/cleave-$$.1 && MANWIDTH=200 man --warnings -l ${TMPDIR:-/tmp}/cleave-$$.1 | "
            "col -bx; rm ${TMPDIR:-/tmp}/cleave-$$.1");
  ASSERT_EQ(page.status, 0) << page.output;
  EXPECT_THAT(page.output, ::testing::Not(HasSubstr("warning"))) << page.output.substr(0, 1000);
  for (const std::string& command : commands()) {
    EXPECT_THAT(page.output, HasSubstr("\n   cleave " + command + "\n"));
    for (const std::string& option : options(command)) EXPECT_THAT(page.output, HasSubstr(option)) << command;
  }
  for (const char* section : {"SYNOPSIS", "EXIT STATUS", "ENVIRONMENT", "EXAMPLES"})
    EXPECT_THAT(page.output, HasSubstr(section));
}

TEST(Version, SaysWhatWasBuiltWithWhat) {
  const Outcome version = shell(program + " --version");
  EXPECT_EQ(version.status, 0);
  EXPECT_THAT(version.output,
              ::testing::MatchesRegex("cleave [0-9.]+\nplugin ABI  [0-9]+\\.[0-9]+\ncompiler    (g\\+\\+|clang) .*\nbuild  "
                                      ".*\nkernels .*\nlibraries   Eigen .*OpenVDB [0-9].*\nlicence .*\n"));
}

}  // namespace
}  // namespace cleave::test
