#include "program.hpp"

#include <gmock/gmock.h>

namespace cleave::test {
namespace {

using testing::AllOf;
using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;

/// The commands of a page, as its reader would copy them: the text of all ```sh blocks.
std::string commands_in(const std::string& page) {
  std::string commands;
  bool inside = false;
  std::istringstream lines(page);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("```"))
      inside = line == "```sh";
    else if (inside)
      commands += line + "\n";
  }
  return commands;
}

class NewPlugin : public Program {
 protected:
  void SetUp() override { ASSERT_TRUE(fs::exists(CLEAVE_PROGRAM)) << "ctest -R NewPlugin installs it first: " CLEAVE_PROGRAM; }

  /// Runs a script in `where`; the program, and nothing else of Cleave, is to be found.
  Outcome shell(const fs::path& where, const std::string& script) const {
    write("script.sh", script);
    const std::string command = "cd '" + where.string() +
                                "' && env -u CLEAVE_PLUGIN_PATH -u CMAKE_PREFIX_PATH CTEST_PARALLEL_LEVEL=2"
                                " PATH='" CLEAVE_PREFIX "/bin':\"$PATH\" sh -ex '" +
                                (directory / "script.sh").string() + "' >'" + (directory / "stdout.txt").string() + "' 2>'" +
                                (directory / "stderr.txt").string() + "' </dev/null";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), contents(directory / "stdout.txt"),
            contents(directory / "stderr.txt")};
  }
};

class NewPluginOf : public NewPlugin, public testing::WithParamInterface<const char*> {};

TEST_P(NewPluginOf, IsBuiltTestedRunAndInstalledAsItsReadmeSays) {
  const std::string kind = GetParam(), id = kind + "/my-law2";
  const Outcome generated = cleave("new-plugin " + kind + " my-law2");
  ASSERT_EQ(generated.status, 0) << generated.err;
  const fs::path project = directory / "my-law2";
  for (const char* file : {".gitignore", "CMakeLists.txt", "README.md", "my_law2.cpp", "scene.toml", "test.cpp"}) {
    EXPECT_THAT(generated.out, HasSubstr(std::string("  ") + file + "\n"));
    EXPECT_THAT(contents(project / file), Not(testing::IsEmpty())) << file;
    for (const char* token : {"{{id}}", "{{Type}}", "{{file}}", "{{kind}}", "{{of this kind}}"})
      EXPECT_THAT(contents(project / file), Not(HasSubstr(token))) << file;
  }

  const std::string commands = commands_in(contents(project / "README.md"));
  for (const char* expected :
       {"cmake -S . -B build\n", "ctest ", "cleave check ", "cleave run scene.toml\n", "cmake --install "})
    ASSERT_THAT(commands, HasSubstr(expected));
  const Outcome outcome = shell(project, commands);
  ASSERT_EQ(outcome.status, 0) << outcome.out << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("100% tests passed"), HasSubstr(id)));

  const auto frames = table(project / "out/scene/frames.csv");
  const auto times = numbers(frames.at("time"));
  ASSERT_GT(times.size(), 5u);
  char last[32];
  std::snprintf(last, sizeof last, "frame_%04zu.vtp", times.size() - 1);
  EXPECT_TRUE(fs::exists(project / "out/scene/vtp" / last)) << last;
  if (kind == "damage" || kind == "discretization") {
    EXPECT_GT(numbers(frames.at("damaged_fraction")).back(), 0) << "nothing breaks in the scene";
  }

  const Outcome installed = shell(project, "CLEAVE_PLUGIN_PATH=install/lib/cleave/plugins cleave plugins --explain " + id);
  EXPECT_EQ(installed.status, 0) << installed.err;
}

INSTANTIATE_TEST_SUITE_P(Kinds, NewPluginOf,
                         testing::Values("elasticity", "plasticity", "damage", "constraint", "discretization"),
                         [](const auto& info) { return std::string(info.param); });

TEST_F(NewPlugin, GoesIntoTheDirectoryNamed) {
  fs::create_directory(directory / "empty");
  EXPECT_EQ(cleave("new-plugin damage tear --dir empty").status, 0);
  EXPECT_TRUE(fs::exists(directory / "empty/tear.cpp"));
  EXPECT_EQ(cleave("new-plugin damage tear --dir deep/er").status, 0);
  EXPECT_THAT(contents(directory / "deep/er/tear.cpp"), AllOf(HasSubstr("\"damage/tear\""), HasSubstr("struct Tear {")));
}

TEST_F(NewPlugin, KeepsWhatIsThere) {
  write("notes", "mine");
  EXPECT_EQ(cleave("new-plugin damage tear").status, 0);
  write("tear/tear.cpp", "changed");
  const Outcome again = cleave("new-plugin damage tear");
  EXPECT_EQ(again.status, 2);
  EXPECT_THAT(again.err, HasSubstr("tear is not empty: name a new or empty directory with --dir"));
  EXPECT_EQ(contents(directory / "tear/tear.cpp"), "changed");

  const Outcome file = cleave("new-plugin damage tear --dir notes");
  EXPECT_EQ(file.status, 2);
  EXPECT_THAT(file.err, HasSubstr("notes is a file"));
  EXPECT_EQ(contents(directory / "notes"), "mine");
}

TEST_F(NewPlugin, NamesWhatWouldBeRight) {
  struct Case {
    const char *arguments, *message;
  };
  for (const Case& c : {
           Case{"elastisity my-law", "no kind of plugin \"elastisity\", did you mean \"elasticity\"?"},
           Case{"common my-law", "the kinds are constraint, damage, discretization, elasticity, plasticity"},
           Case{"elasticity MyLaw", "\"MyLaw\" cannot be the name of a plugin: use lower case letters and digits"},
           Case{"elasticity my_law2", "for example \"my-law2\""},
           Case{"elasticity HTTPServer", "for example \"httpserver\""},
           Case{"elasticity 'Soft  tissue!'", "for example \"soft-tissue\""},
           Case{"elasticity 3d-law", "for example \"d-law\""},
           Case{"elasticity law-", "for example \"law\""},
           Case{"elasticity ../law", "for example \"law\""},
           Case{"elasticity ''", "for example \"my-law\""},
           Case{"elasticity test",
                "\"test\" has a meaning of its own in the project of a plugin; choose another name, for example"
                " \"test-law\""},
           Case{"elasticity energy-split", "for example \"energy-split-law\""},
           Case{"elasticity", "name is required"},
       }) {
    const Outcome outcome = cleave(std::string("new-plugin ") + c.arguments);
    EXPECT_EQ(outcome.status, 2) << c.arguments;
    EXPECT_THAT(outcome.err, HasSubstr(c.message)) << c.arguments;
    EXPECT_EQ(outcome.out, "") << c.arguments;
  }
  const Outcome unwritable = cleave("new-plugin elasticity my-law --dir /dev/null/law");
  EXPECT_EQ(unwritable.status, 2);
  EXPECT_THAT(unwritable.err, HasSubstr("/dev/null/law"));
  for (const auto& entry : fs::directory_iterator(directory))
    EXPECT_THAT(entry.path().filename().string(), EndsWith(".txt"));  // the program's own output
}

}  // namespace
}  // namespace cleave::test
