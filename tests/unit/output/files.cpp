#include "common/error.hpp"
#include "output/frame.hpp"
#include "run_directory.hpp"

#include <gmock/gmock.h>
#include <sys/mount.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <stdexcept>

namespace cleave::output {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// No file grows beyond this: the write that would fails as on a full disk, part of it done.
class SizeLimit {
 public:
  explicit SizeLimit(rlim_t bytes) {
    handler_ = std::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~SizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  SizeLimit(const SizeLimit&) = delete;
  SizeLimit& operator=(const SizeLimit&) = delete;

 private:
  rlimit before_{};
  void (*handler_)(int) = nullptr;
};

/// Permissions do not bind the superuser.
class OrdinaryUser {
 public:
  OrdinaryUser() : user_(::geteuid()) { effective_ = user_ != 0 || ::seteuid(65534) == 0; }
  ~OrdinaryUser() {
    if (::seteuid(user_) != 0) std::abort();
  }
  OrdinaryUser(const OrdinaryUser&) = delete;
  OrdinaryUser& operator=(const OrdinaryUser&) = delete;
  bool effective() const { return effective_; }

 private:
  uid_t user_;
  bool effective_ = false;
};

using Files = RunDirectory;

TEST_F(Files, AreWhereTheInterfaceSaysAndNothingElseIsLeft) {
  Writer writer(directory / "new" / "run", {"vdb", "vtp", "ply", "vdb"}, true);
  writer.frame(random_frame(50, 3, 0));
  writer.frame(random_frame(60, 3, 1));
  writer.record({});
  writer.summary({});
  writer.text("scene.toml", "");
  std::set<std::string> expected{"new/run/frames.csv", "new/run/particles.pvd", "new/run/summary.json", "new/run/scene.toml"};
  for (const char* frame : {"frame_0000", "frame_0001"})
    for (const auto& [folder, extension] :
         {std::pair{"points/", ".vdb"}, {"surface/", ".vdb"}, {"vtp/", ".vtp"}, {"ply/", ".ply"}})
      expected.insert(std::string("new/run/") + folder + frame + extension);
  EXPECT_EQ(files(), expected);
  for (const std::filesystem::path& path : writer.written()) EXPECT_TRUE(std::filesystem::exists(path)) << path;
  EXPECT_EQ(writer.written().size(), 4u + 4);
}

TEST_F(Files, OfAnEarlierRunDoNotMixWithThisOne) {
  {
    Writer earlier(directory, {"vtp", "ply"}, false);
    for (int i = 0; i < 4; ++i) earlier.frame(random_frame(5, 3, i));
    earlier.record({});
    earlier.summary({});
  }
  for (const char* name : {"notes.txt", "vtp/frame_0001.vtp.bak", "vtp/frame_best.vtp", "ply/bunny.ply", "ply/frame_0001.vtp",
                           "vtp/frame_12.vtp", "vtp/frame_0009.vtp.partial"})
    std::ofstream(directory / name) << "mine";
  Writer(directory, {"vtp"}, false).frame(random_frame(5, 3, 0));
  EXPECT_EQ(files(), (std::set<std::string>{"notes.txt", "vtp/frame_0001.vtp.bak", "vtp/frame_best.vtp", "ply/bunny.ply",
                                            "ply/frame_0001.vtp", "vtp/frame_12.vtp", "vtp/frame_0000.vtp", "particles.pvd",
                                            "frames.csv"}));
}

TEST_F(Files, AFormatNobodyKnowsIsRefused) {
  EXPECT_THAT(error_of([&] {
                Writer(directory, {"vdb", "abc"}, false);
              }),
              AllOf(HasSubstr("'abc'"), HasSubstr("vdb, vtp, ply and usd")));
}

TEST_F(Files, ADirectoryThatCannotBeMadeIsNamed) {
  std::ofstream(directory / "file") << "not a directory";
  EXPECT_THAT(error_of([&] { Writer(directory / "file" / "run", {}, false); }),
              AllOf(HasSubstr((directory / "file" / "run").string()), HasSubstr("Not a directory")));
  EXPECT_THAT(error_of([&] { Writer(directory / "file", {}, false); }), HasSubstr("Not a directory"));
}

TEST_F(Files, ADirectoryWithoutPermissionIsNamed) {
  std::filesystem::permissions(directory, std::filesystem::perms::others_read | std::filesystem::perms::others_exec |
                                              std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  const OrdinaryUser user;
  if (!user.effective()) GTEST_SKIP() << "cannot give up the superuser's rights";
  EXPECT_THAT(error_of([&] { Writer(directory, {}, false); }),
              AllOf(HasSubstr((directory / "frames.csv").string()), HasSubstr("Permission denied")));
  EXPECT_THAT(error_of([&] { Writer(directory / "run", {}, false); }),
              AllOf(HasSubstr((directory / "run").string()), HasSubstr("Permission denied")));
}

TEST_F(Files, AFolderThatVanishesDuringTheRunIsAnErrorWithTheFilesName) {
  Writer writer(directory, {"vdb"}, false);
  std::filesystem::remove_all(directory / "points");
  EXPECT_THAT(error_of([&] { writer.frame(random_frame(5)); }),
              AllOf(HasSubstr("points/frame_0007.vdb"), HasSubstr("No such file or directory")));
}

struct Format {
  const char* name;
  const char* file;
  friend std::ostream& operator<<(std::ostream& out, const Format& format) { return out << format.name; }
};

class FullDisk : public RunDirectory, public testing::WithParamInterface<Format> {};

TEST_P(FullDisk, LeavesTheOlderFileAndNamesTheNewOne) {
  const bool surface = GetParam().name == std::string("surface");
  const ParticleFrame small = random_frame(20), large = random_frame(surface ? 200 : 3000);
  Writer writer(directory, surface ? std::vector<std::string>{} : std::vector<std::string>{GetParam().name}, surface);
  writer.frame(small);
  const std::string before = contents(GetParam().file);
  const std::set<std::string> files_before = files();
  for (const rlim_t bytes : {0, 1, 100, 4096, 20000}) {
    const SizeLimit limit(bytes);
    EXPECT_THAT(error_of([&] { writer.frame(large); }), AllOf(HasSubstr(GetParam().file), HasSubstr("File too large")))
        << bytes;
  }
  EXPECT_EQ(contents(GetParam().file), before);
  EXPECT_EQ(files(), files_before);
  EXPECT_EQ(error_of([&] { writer.frame(large); }), "");
  EXPECT_NE(contents(GetParam().file), before);
}

INSTANTIATE_TEST_SUITE_P(Formats, FullDisk,
                         testing::Values(Format{"vdb", "points/frame_0007.vdb"}, Format{"surface", "surface/frame_0007.vdb"},
                                         Format{"vtp", "vtp/frame_0007.vtp"}, Format{"ply", "ply/frame_0007.ply"}),
                         [](const auto& test) { return std::string(test.param.name); });

TEST_F(Files, ARowThatDoesNotFitIsTakenBackWhole) {
  Writer writer(directory, {}, false);
  writer.record({});
  const std::string before = contents("frames.csv");
  {
    const SizeLimit limit(before.size() + 7);
    EXPECT_THAT(error_of([&] { writer.record({}); }), AllOf(HasSubstr("frames.csv"), HasSubstr("File too large")));
  }
  EXPECT_EQ(contents("frames.csv"), before);
  writer.record({});
  EXPECT_GT(contents("frames.csv").size(), before.size());
}

TEST_F(Files, ASummaryThatDoesNotFitLeavesTheOlderOne) {
  Writer writer(directory, {}, false);
  writer.summary({});
  const std::string before = contents("summary.json");
  {
    const SizeLimit limit(10);
    EXPECT_THAT(error_of([&] { writer.summary({}); }), HasSubstr("summary.json"));
    EXPECT_THAT(error_of([&] { writer.text("scene.toml", "twelve bytes"); }), HasSubstr("scene.toml"));
  }
  EXPECT_EQ(contents("summary.json"), before);
  EXPECT_EQ(files(), (std::set<std::string>{"frames.csv", "summary.json"}));
}

TEST_F(Files, AFullFileSystemIsCalledByItsName) {
  const std::filesystem::path small = directory / "small";
  std::filesystem::create_directory(small);
  if (::mount("tmpfs", small.c_str(), "tmpfs", 0, "size=64k") != 0) GTEST_SKIP() << "cannot mount a small file system";
  const std::string message = error_of([&] {
    Writer writer(small, {"vdb", "vtp"}, false);
    writer.frame(random_frame(3000));
  });
  ::umount2(small.c_str(), MNT_DETACH);
  EXPECT_THAT(message, AllOf(HasSubstr("frame_0007"), HasSubstr("No space left on device")));
}

TEST_F(Files, ArraysThatDoNotFitTogetherAreAProgrammersError) {
  Writer writer(directory, {"ply"}, false);
  ParticleFrame frame = random_frame(4);
  frame.attributes[2].values.pop_back();
  EXPECT_THROW(writer.frame(frame), std::invalid_argument);
  frame = random_frame(4);
  for (const std::vector<std::size_t>& ends : {std::vector<std::size_t>{4}, {5, 4}, {2, 3}}) {
    frame.body_ends = ends;
    EXPECT_THROW(writer.frame(frame), std::invalid_argument);
  }
}

}  // namespace
}  // namespace cleave::output
