// A stranger's machine needs only the package: it is built, unpacked, and used from where it was unpacked.
#include "shell.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

namespace cleave::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class DebianPackage : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    directory_ = fs::temp_directory_path() / ("cleave-package-" + std::to_string(getpid()));
    fs::create_directories(directory_);
    if (!have("dpkg-shlibdeps")) return;
    built_ = shell("cd " + directory_.string() +
                   " && " CLEAVE_CPACK_COMMAND " -G DEB --config " CLEAVE_BINARY_DIR
                   "/CPackConfig.cmake -B . && mv *.deb cleave.deb && dpkg-deb -x cleave.deb root");
  }
  static void TearDownTestSuite() { fs::remove_all(directory_); }
  void SetUp() override {
    if (!have("dpkg-shlibdeps")) GTEST_SKIP() << "dpkg-shlibdeps (Debian: dpkg-dev) is not installed";
    ASSERT_EQ(built_.status, 0) << built_.output;
  }

  static std::string field(const std::string& name) {
    return shell("dpkg-deb -f " + (directory_ / "cleave.deb").string() + " " + name).output;
  }
  /// The unpacked program, without anything of this build or of the environment.
  static Outcome cleave(const std::string& arguments) {
    return shell("cd " + directory_.string() + " && env -i PATH=/usr/bin:/bin HOME=/nonexistent root/usr/bin/cleave " +
                 arguments);
  }

  static inline fs::path directory_;
  static inline Outcome built_;
};

TEST_F(DebianPackage, NamesWhatItNeeds) {
  EXPECT_THAT(field("Depends"), ::testing::AllOf(HasSubstr("libopenvdb10"), HasSubstr("libtbb12"), HasSubstr("libstdc++6")));
  EXPECT_THAT(field("Section"), HasSubstr("science"));
}

TEST_F(DebianPackage, RunsASceneThatItBrings) {
  EXPECT_THAT(cleave("--version").output, HasSubstr("cleave "));
  EXPECT_THAT(cleave("plugins").output, ::testing::AllOf(HasSubstr("elasticity/qr"), HasSubstr("discretization/fem")));
  const Outcome run = cleave("run root/usr/share/cleave/configs/scenes/block_drop.toml --steps 3 --out out");
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_TRUE(fs::exists(directory_ / "out/summary.json"));
}

// Packing strips libraries, whose manifests were written before.
TEST_F(DebianPackage, BringsPluginsThatKeepToTheContract) {
  const Outcome check = cleave("check --all --only abi.manifest");
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_THAT(check.output, HasSubstr("/usr/lib/cleave/plugins/rankine.so"));
}

TEST_F(DebianPackage, BringsManualCompletionAndDocuments) {
  for (const char* file :
       {"share/man/man1/cleave.1.gz", "share/bash-completion/completions/cleave", "share/fish/vendor_completions.d/cleave.fish",
        "share/doc/cleave/copyright", "share/doc/cleave/scene.md", "share/cleave/configs/studies/elastic_bar.toml",
        "include/cleave/abi.h", "lib/cmake/CleaveSDK/CleaveSDKConfig.cmake", "share/cleave/templates"})
    EXPECT_TRUE(fs::exists(directory_ / "root/usr" / file)) << file;
  // programs of other licences are built apart and stay out of the package
  EXPECT_FALSE(fs::exists(directory_ / "root/usr/lib/cleave/meshers/tetgen"));
}

TEST_F(DebianPackage, NamesNoDirectoryOfTheMachineThatBuiltIt) {
  const Outcome found = shell("grep -rlF '" CLEAVE_BINARY_DIR "' " + (directory_ / "root").string());
  EXPECT_EQ(found.output, "");
}

TEST_F(DebianPackage, WritesAPluginProjectThatBuilds) {
  const Outcome made = cleave("new-plugin elasticity package-law --dir law");
  ASSERT_EQ(made.status, 0) << made.output;
  const std::string in = "cd " + directory_.string() + " && ";
  const Outcome built = shell(in + "cmake -S law -B law/build -DCMAKE_PREFIX_PATH=" + (directory_ / "root/usr").string() +
                              " -DBUILD_TESTING=OFF && cmake --build law/build");
  ASSERT_EQ(built.status, 0) << built.output;
  const Outcome listed = shell(
      in +
      "env CLEAVE_PLUGIN_PATH=$(dirname $(find $PWD/law/build -name 'package_law*.so' | head -1)) root/usr/bin/cleave plugins");
  EXPECT_THAT(listed.output, HasSubstr("elasticity/package-law")) << built.output;
}

TEST_F(DebianPackage, HasNoErrorOfLintian) {
  if (!have("lintian")) GTEST_SKIP() << "lintian is not installed";
  const Outcome lint = shell(
      "lintian --allow-root --tag-display-limit 0 --fail-on error "
      "--suppress-tags no-changelog,no-copyright-file,unstripped-static-library,extended-description-is-probably-too-short " +
      (directory_ / "cleave.deb").string());
  EXPECT_EQ(lint.status, 0) << lint.output;
}

}  // namespace
}  // namespace cleave::test
