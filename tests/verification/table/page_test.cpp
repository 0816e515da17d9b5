// That docs/verification.md says something of every problem, by tests that there are. What it says is compared where it is
// measured: report() does.

#include "page.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <sstream>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

constexpr int problems = 25;

TEST(VerificationPage, HasFiguresOfEveryProblem) {
  std::set<int> rows;
  for (const Line& l : lines_of(verification_page())) rows.insert(l.row);
  for (int row = 1; row <= problems; row++) EXPECT_TRUE(rows.contains(row)) << "problem " << row;
}

TEST(VerificationPage, DescribesEveryProblem) {
  std::ifstream in(verification_page());
  std::stringstream text;
  text << in.rdbuf();
  for (int row = 1; row <= problems; row++)
    EXPECT_NE(text.str().find("\n" + std::to_string(row) + ". **"), std::string::npos) << "problem " << row;
}

TEST(VerificationPage, NamesTestsThatThereAre) {
  std::string sources;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(CLEAVE_SOURCE_DIR) / "tests")) {
    if (entry.path().extension() != ".cpp") continue;
    std::ifstream in(entry.path());
    std::stringstream text;
    text << in.rdbuf();
    sources += text.str();
  }
  for (const Line& l : lines_of(verification_page())) {
    // Suite.Name, or Instantiation/Suite.Name/Parameter
    std::string test = l.command.substr(l.command.find("--gtest_filter=") + 15);
    const std::size_t dot = test.find('.');
    ASSERT_NE(dot, std::string::npos) << l.command;
    std::string suite = test.substr(0, dot), name = test.substr(dot + 1);
    if (const auto slash = suite.rfind('/'); slash != std::string::npos) suite.erase(0, slash + 1);
    if (const auto slash = name.find('/'); slash != std::string::npos) name.erase(slash);
    EXPECT_NE(sources.find("(" + suite + ", " + name + ")"), std::string::npos) << l.command;
  }
}

}  // namespace
}  // namespace cleave::test
