// docs/authors and docs/users, done from the first page to the last.
#include "tutorial.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;

std::string contents(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

bool installed(const std::string& program) { return std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0; }

/// Does the pages with the installed program. The place is the same each time, so that a compiler cache knows what it has seen.
void do_pages(const std::string& folder, const std::vector<std::string>& names) {
  const fs::path place = fs::path(CLEAVE_BINARY_DIR "/tests") / folder, prefix = place / "prefix", directory = place / "work";
  fs::remove_all(place);
  fs::create_directories(directory);
  const std::string install = "'" CLEAVE_CMAKE_COMMAND "' --install '" CLEAVE_BINARY_DIR "' --prefix '" + prefix.string() +
                              "' >'" + (place / "install.txt").string() + "' 2>&1";
  ASSERT_EQ(std::system(install.c_str()), 0) << contents(place / "install.txt");

  const std::string environment = "unset CLEAVE_PLUGIN_PATH CLEAVE_ISA\nexport PATH='" + (prefix / "bin").string() +
                                  "':$PATH CMAKE_GENERATOR=Ninja" +
                                  (installed("ccache") ? " CMAKE_CXX_COMPILER_LAUNCHER=ccache" : "");
  std::set<std::string> absent;
  for (const std::string& name : names) {
    auto steps = steps_of(contents(fs::path(CLEAVE_SOURCE_DIR) / "docs" / folder / name));
    ASSERT_GT(steps.size(), 3u) << name;
    absent.merge(leave_out(steps, installed));
    const std::string problems = do_steps(steps, directory.string(), environment);
    EXPECT_EQ(problems, "") << "docs/" << folder << "/" << name;
    if (!problems.empty()) return;
  }
  fs::remove_all(place);
  if (absent.empty()) return;
  std::string list;
  for (const std::string& program : absent) list += " " + program;
  GTEST_SKIP() << "done but for what needs" << list;
}

TEST(AuthorPages, ComeOutAsTheyAreWritten) {
  for (const char* program : {"c++", "python3"})
    if (!installed(program)) GTEST_SKIP() << program << " is not installed";
  do_pages("authors", {"1_use.md", "2_write.md", "3_prove.md"});
}

TEST(UserPages, ComeOutAsTheyAreWritten) {
  if (!installed("python3")) GTEST_SKIP() << "python3 is not installed";
  do_pages("users", {"1_first_scene.md", "2_own_mesh.md", "3_resume.md", "4_paraview_and_blender.md"});
}

// The reader of the pages can fail.
TEST(AuthorPages, EveryDifferenceIsSeen) {
  const std::string page =
      "```toml file=a/b.toml\nx = 1\n```\n"
      "```console\n$ cat a/b.toml\nx = 1\n$ echo one\ntwo\n$ echo a\n> echo 12 b\na\n... b\n$ true\nprinted\n$ echo "
      "silent\n```\n"
      "```console status=2\n$ false\n```\n```sh\n$ never run\n```\n"
      "```console needs=bash,rare\n$ rare\n```\n```console needs=bash\n$ bash -c true\n```\n";
  auto steps = steps_of(page);
  ASSERT_EQ(steps.size(), 9u);
  EXPECT_EQ(leave_out(steps, [](const std::string& program) { return program != "rare"; }), std::set<std::string>{"rare"});
  ASSERT_EQ(steps.size(), 8u);
  EXPECT_EQ(std::get<File>(steps[0]).name, "a/b.toml");
  std::string name = (fs::temp_directory_path() / "cleave-tutorial-XXXXXX").string();
  const fs::path directory = mkdtemp(name.data());
  const std::string problems = do_steps(steps, directory.string(), "");
  fs::remove_all(directory);
  fs::remove(directory.string() + ".sh");
  EXPECT_EQ(problems,
            "line 7: echo one\n  is said to print\n    two\n  and prints\n    one\n"
            "line 13: true\n  is said to print\n    printed\n  and prints\n"
            "line 15: echo silent\n  is said to print\n  and prints\n    silent\n"
            "line 18: false\n  ended with status 1\n");
  EXPECT_TRUE(matches({"...", "b", "..."}, {"a", "b"}));
  EXPECT_FALSE(matches({"...", "b"}, {"a", "b", "c"}));
  EXPECT_TRUE(matches({"x ... y ... z"}, {"x 1 y 2 z"}));
  EXPECT_FALSE(matches({"x ... y"}, {"x 1 y 2"}));
}

}  // namespace
}  // namespace cleave::test
