// docs/stability.md names a test for every way in which the methods fail.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

std::string contents(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::set<std::string> tests() {
  const std::regex declaration(R"(\n(?:TYPED_)?TEST(_F|_P)?\(\s*(\w+),\s*(\w+)\))");
  std::set<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(CLEAVE_SOURCE_DIR) / "tests")) {
    if (entry.path().extension() != ".cpp") continue;
    const std::string text = contents(entry.path());
    for (std::sregex_iterator it(text.begin(), text.end(), declaration), end; it != end; ++it)
      names.insert((*it)[2].str() + "." + (*it)[3].str());
  }
  return names;
}

TEST(StabilityPage, NamesTestsThatThereAreInEveryRow) {
  const auto known = tests();
  const std::regex name(R"(`([A-Z]\w+\.[A-Z]\w+)`)");
  std::ifstream page(fs::path(CLEAVE_SOURCE_DIR) / "docs/stability.md");
  bool in_table = false;
  int rows = 0;
  for (std::string line; std::getline(page, line);) {
    if (line.rfind("| trigger ", 0) == 0) in_table = true;
    if (line.empty()) in_table = false;
    if (!in_table || line.rfind("| trigger ", 0) == 0 || line.rfind("|---", 0) == 0) continue;
    rows++;
    int named = 0;
    for (std::sregex_iterator it(line.begin(), line.end(), name), end; it != end; ++it, named++)
      EXPECT_TRUE(known.count((*it)[1].str())) << "there is no test " << (*it)[1] << ": " << line;
    EXPECT_GT(named, 0) << "no test is named: " << line;
  }
  EXPECT_GE(rows, 19) << "rows of the table";
}

}  // namespace
}  // namespace cleave::test
