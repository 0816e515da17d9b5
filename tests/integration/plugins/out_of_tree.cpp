#include "law_driver.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

namespace cleave::plugins::test {
namespace {

namespace fs = std::filesystem;

struct Outcome {
  int status;
  std::string output;
};

Outcome run(const std::string& command) {
  Outcome outcome{-1, {}};
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (!pipe) return outcome;
  char buffer[4096];
  while (const std::size_t bytes = std::fread(buffer, 1, sizeof buffer, pipe)) outcome.output.append(buffer, bytes);
  outcome.status = pclose(pipe);
  return outcome;
}

/// The installed SDK, and a stranger's plugin built with it, in a directory that is removed at the end.
class OutOfTree : public ::testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / ("cleave-out-of-tree-" + std::to_string(getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  std::string quoted(const fs::path& path) const { return "'" + path.string() + "'"; }
  Outcome cmake(const std::string& arguments) const { return run(quoted(CLEAVE_CMAKE_COMMAND) + " " + arguments); }

  void build_with(const std::string& compiler) {
    const auto install =
        cmake("--install " + quoted(CLEAVE_BINARY_DIR) + " --component sdk --prefix " + quoted(directory_ / "prefix"));
    ASSERT_EQ(install.status, 0) << install.output;
    // The sources are copied away, so that nothing of the repository is found by a relative path.
    fs::copy(CLEAVE_SOURCE_DIR "/tests/fixtures/plugins/out_of_tree", directory_ / "source");
    const auto configure = cmake("-G Ninja -S " + quoted(directory_ / "source") + " -B " + quoted(directory_ / "build") +
                                 " -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=" + compiler + " -DCMAKE_PREFIX_PATH=" +
                                 quoted(directory_ / "prefix") + " -DCMAKE_INSTALL_PREFIX=" + quoted(directory_ / "installed"));
    ASSERT_EQ(configure.status, 0) << configure.output;
    const auto build = cmake("--build " + quoted(directory_ / "build"));
    ASSERT_EQ(build.status, 0) << build.output;
    const auto install_plugin = cmake("--install " + quoted(directory_ / "build"));
    ASSERT_EQ(install_plugin.status, 0) << install_plugin.output;
  }

  /// psi = mu/2 (tr b - 3 - 2 ln J) + lambda/2 (ln J)^2 under a uniaxial stretch, at 33 points in both precisions.
  template <class S>
  void expect_stress(const Instance& law) {
    const double stretch = 1.25, mu = 1000 / 2.6, lambda = 300 / (1.3 * 0.4), log_J = std::log(stretch);
    LawDriver<S> driver;
    driver.input(CLEAVE_FIELD_B, {{stretch * stretch, 1, 1, 0, 0, 0}}).output(CLEAVE_FIELD_TAU, 6);
    ASSERT_EQ(driver.run(evaluate<S>(law), law.handle(), 33), CLEAVE_OK);
    for (std::uint32_t k = 0; k < 33; ++k) {
      EXPECT_NEAR(driver.value(CLEAVE_FIELD_TAU, k)[0], mu * (stretch * stretch - 1) + lambda * log_J,
                  sizeof(S) == 4 ? 1e-3 : 1e-10);
      EXPECT_NEAR(driver.value(CLEAVE_FIELD_TAU, k)[1], lambda * log_J, sizeof(S) == 4 ? 1e-3 : 1e-10);
    }
  }

  fs::path directory_;
};

TEST_F(OutOfTree, PluginOfAnotherCompilerBuiltWithTheInstalledSdkLoadsAndRuns) {
  const std::string host = CLEAVE_HOST_COMPILER_ID;
  const std::string other = host == "GNU" ? "clang++" : "g++";
  if (run("command -v " + other).status != 0) GTEST_SKIP() << other << " is not installed";
  build_with(other);
  for (const fs::path& place : {directory_ / "build/plugins", directory_ / "installed/lib/cleave/plugins"}) {
    Registry registry({place});
    ASSERT_EQ(registry.found().size(), 1u) << place;
    EXPECT_TRUE(registry.found()[0].from_manifest);
    EXPECT_EQ(registry.found()[0].refusal, "");
    ASSERT_NE(registry.find("elasticity/strangers-solid"), nullptr);
    EXPECT_EQ(registry.find("elasticity/strangers-solid")->version, "0.3.1");
    for (const char* isa : {"", "x86-64-v2"}) {
      setenv("CLEAVE_ISA", isa, 1);
      const Instance law(registry.load("elasticity/strangers-solid"), stiff(1000, 0.3), {});
      expect_stress<float>(law);
      expect_stress<double>(law);
    }
    unsetenv("CLEAVE_ISA");
  }
}

TEST_F(OutOfTree, PluginExportsNothingButItsEntry) {
  if (run("command -v nm").status != 0) GTEST_SKIP() << "nm is not installed";
  const auto symbols = run("nm -D --defined-only " + quoted(CLEAVE_BINARY_DIR "/lib/cleave/plugins/fixed_corotated.so"));
  ASSERT_EQ(symbols.status, 0) << symbols.output;
  EXPECT_EQ(std::count(symbols.output.begin(), symbols.output.end(), '\n'), 1) << symbols.output;
  EXPECT_NE(symbols.output.find("cleave_plugin_entry"), std::string::npos);
}

}  // namespace
}  // namespace cleave::plugins::test
