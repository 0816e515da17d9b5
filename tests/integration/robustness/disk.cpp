#include "robust.hpp"

#include <sys/mount.h>

namespace cleave::test {
namespace {

class Disk : public Robust {
 protected:
  void SetUp() override {
    disk = directory / "disk";
    fs::create_directory(disk);
    write("scene.toml", sound_scene + "checkpoint = { frames = 1 }\n");
  }
  void TearDown() override {
    if (mounted) ::umount2(disk.c_str(), MNT_DETACH);
  }
  bool mount(const char* options) {
    mounted = ::mount("none", disk.c_str(), "tmpfs", 0, options) == 0;
    return mounted;
  }

  fs::path disk;
  bool mounted = false;
};

TEST_F(Disk, ThatIsFull) {
  if (!mount("size=256k")) GTEST_SKIP() << "only root may mount a small disk";
  const Outcome run = cleave("run scene.toml --out disk/run --set simulation.frame_rate=10000 --threads 2");
  EXPECT_EQ(run.status, 2) << run.err;
  EXPECT_NE(run.err.find("No space left on device"), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("disk/run/"), std::string::npos) << run.err;
  for (const auto& entry : fs::recursive_directory_iterator(disk))
    EXPECT_FALSE(entry.path().extension() == ".partial") << entry;
}

TEST_F(Disk, ThatIsReadOnly) {
  if (!mount("size=256k")) GTEST_SKIP() << "only root may mount a disk";
  ASSERT_EQ(::mount("none", disk.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, "size=256k"), 0);
  expect_command("run scene.toml --out disk/run", 2, "disk/run: Read-only file system");
}

TEST_F(Disk, WhereNothingMayBeWritten) {
  if (geteuid() == 0 && std::system("setpriv --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "setpriv is not there";
  fs::permissions(directory, fs::perms::all);
  fs::permissions(disk, fs::perms::owner_read | fs::perms::owner_exec | fs::perms::others_read | fs::perms::others_exec);
  expect_command("run scene.toml --out disk/run", 2, "disk/run: Permission denied",
                 geteuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups" : "");
}

TEST_F(Disk, OutputThatIsAFile) {
  write("run", "text");
  expect_command("run scene.toml --out run", 2, "run/checkpoints: Not a directory");
  expect_command("run scene.toml --out /dev/null/run", 2, "/dev/null/run");
}

TEST_F(Disk, StandardOutputThatIsFull) {
  const std::string command =
      "cd '" + directory.string() + "' && '" CLEAVE_PROGRAM "' run scene.toml --out run >/dev/full 2>err";
  const int status = std::system(command.c_str());
  EXPECT_TRUE(WIFEXITED(status)) << "what a run prints is not what it is for";
  EXPECT_TRUE(fs::exists(directory / "run/summary.json"));
}

TEST_F(Disk, ReaderThatGoesAway) {
  const std::string command =
      "cd '" + directory.string() + "' && '" CLEAVE_PROGRAM "' plugins --json 2>err | head -c 10 >/dev/null";
  EXPECT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(contents(directory / "err"), "");
}

}  // namespace
}  // namespace cleave::test
