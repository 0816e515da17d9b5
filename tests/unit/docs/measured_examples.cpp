// What docs/theory.md and docs/deviations.md say they measured is what the program prints. Their ```console blocks hold
// commands
// ("$ ", continued with "> ") and the output of all of them; the ```sh blocks of deviations.md define the functions they use.

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

std::string without_trailing_spaces(std::string line) {
  line.erase(line.find_last_not_of(" \r") + 1);
  return line;
}

struct Block {
  int line;  ///< where it starts in the page
  std::string commands, output;
};

std::ifstream page(const std::string& name) {
  std::ifstream in(fs::path(CLEAVE_SOURCE_DIR) / "docs" / name);
  EXPECT_TRUE(in) << name;
  return in;
}

/// The contents of the page's blocks in this language.
std::vector<std::pair<int, std::vector<std::string>>> blocks(const std::string& name, const std::string& language) {
  std::vector<std::pair<int, std::vector<std::string>>> found;
  auto in = page(name);
  bool inside = false;
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (line.starts_with("```")) {
      inside = line == "```" + language;
      if (inside) found.push_back({number, {}});
    } else if (inside) {
      found.back().second.push_back(line);
    }
  }
  return found;
}

std::vector<Block> console_blocks(const std::string& name) {
  std::vector<Block> result;
  for (const auto& [line, text] : blocks(name, "console")) {
    Block block{line, "", ""};
    for (const auto& l : text) {
      if (l.starts_with("$ ") || l.starts_with("> "))
        block.commands += l.substr(2) + "\n";
      else
        block.output += without_trailing_spaces(l) + "\n";
    }
    result.push_back(block);
  }
  return result;
}

std::string functions() {
  std::string script = "set -o pipefail\ncleave() { '" CLEAVE_PROGRAM "' \"$@\"; }\n";
  for (const auto& [line, text] : blocks("deviations.md", "sh"))
    for (const auto& l : text) script += l + "\n";
  return script;
}

/// Standard output of bash.
std::string run(const fs::path& script) {
  FILE* pipe = popen(("bash '" + script.string() + "' 2>/dev/null </dev/null").c_str(), "r");
  std::string output, line;
  for (int c; (c = std::fgetc(pipe)) != EOF;) {
    if (c == '\n') {
      output += without_trailing_spaces(line) + "\n";
      line.clear();
    } else {
      line += char(c);
    }
  }
  EXPECT_EQ(pclose(pipe) & 0x7f, 0) << "bash did not end by itself";
  return output + line;
}

class MeasuredExamples : public testing::TestWithParam<const char*> {};

TEST_P(MeasuredExamples, AreWhatTheProgramPrints) {
  const auto examples = console_blocks(GetParam());
  ASSERT_GE(examples.size(), 5u);
  std::string name = (fs::temp_directory_path() / "cleave-docs-XXXXXX").string();
  const fs::path directory = mkdtemp(name.data()), script = directory / "example.sh";
  for (const Block& example : examples) {
    ASSERT_NE(example.output, "") << "line " << example.line;
    std::ofstream(script) << functions() << example.commands;
    EXPECT_EQ(run(script), example.output) << "docs/" << GetParam() << ":" << example.line << "\n" << example.commands;
  }
  fs::remove_all(directory);
}

INSTANTIATE_TEST_SUITE_P(Pages, MeasuredExamples, testing::Values("theory.md", "deviations.md"), [](const auto& instance) {
  return std::string(instance.param, std::string(instance.param).find('.'));
});

}  // namespace
}  // namespace cleave::test
