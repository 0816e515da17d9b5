#include "checkpoint/run_directory.hpp"
#include "common/error.hpp"

#include <gmock/gmock.h>

#include <set>

namespace cleave::checkpoint {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class RunDirectory : public testing::Test {
 protected:
  RunDirectory() {
    std::string name = (fs::temp_directory_path() / "cleave-checkpoint-XXXXXX").string();
    directory = mkdtemp(name.data());
  }
  ~RunDirectory() override { fs::remove_all(directory); }

  fs::path save(std::int64_t steps) const {
    return RunCheckpoints(directory).save(
        steps, [&](StateWriter& writer) { writer.text("state", "of step " + std::to_string(steps)); },
        [&] {
          checkpoint::Run run;
          run.program = "1.2.3";
          run.isa = "baseline";
          run.threads = 2;
          run.plugins = {{"elasticity/a", "1.0.0", "/lib/a.so", 0xdeadbeef}};
          run.scene = "[simulation]\n";
          run.files = {{"body.a.shape.file", 42}};
          run.frames = int(steps / 10);
          run.table = "frame,time\n0,0\n";
          run.steps = steps;
          run.time = 0.1 * double(steps);
          run.wall_seconds = 1.5;
          return run;
        });
  }
  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(directory / "checkpoints")) names.insert(entry.path().filename().string());
    return names;
  }
  static void damage(const fs::path& file) {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(46);  // in the contents of the first section
    stream.put('\x7f');
  }

  fs::path directory;
};

TEST_F(RunDirectory, SaysOfARunWhatItWasTold) {
  save(70);
  std::vector<std::string> problems;
  auto opened = RunCheckpoints(directory).newest(problems);
  ASSERT_TRUE(opened);
  EXPECT_TRUE(problems.empty());
  EXPECT_EQ(opened->file, directory / "checkpoints/step_000000000070.checkpoint");
  const checkpoint::Run& run = opened->run;
  EXPECT_EQ(run.program, "1.2.3");
  EXPECT_EQ(run.isa, "baseline");
  EXPECT_EQ(run.threads, 2);
  ASSERT_EQ(run.plugins.size(), 1u);
  EXPECT_EQ(run.plugins[0].crc, 0xdeadbeef);
  EXPECT_EQ(run.files, (std::map<std::string, std::uint32_t>{{"body.a.shape.file", 42}}));
  EXPECT_EQ(run.frames, 7);
  EXPECT_EQ(run.time, 0.1 * 70);
  EXPECT_EQ(run.table, "frame,time\n0,0\n");
  EXPECT_EQ(opened->state().text("state"), "of step 70");
}

TEST_F(RunDirectory, KeepsTheNewestTwo) {
  for (const std::int64_t steps : {10, 20, 30}) save(steps);
  EXPECT_EQ(files(), (std::set<std::string>{"step_000000000020.checkpoint", "step_000000000030.checkpoint"}));
}

TEST_F(RunDirectory, ACheckpointOfAnEarlierStepRemovesThoseThatCameAfterIt) {
  for (const std::int64_t steps : {10, 20, 15}) save(steps);
  EXPECT_EQ(files(), (std::set<std::string>{"step_000000000010.checkpoint", "step_000000000015.checkpoint"}));
}

TEST_F(RunDirectory, ADamagedCheckpointIsNamedAndTheOneBeforeIsTaken) {
  save(10);
  damage(save(20));
  std::vector<std::string> problems;
  auto opened = RunCheckpoints(directory).newest(problems);
  ASSERT_TRUE(opened);
  EXPECT_EQ(opened->run.steps, 10);
  EXPECT_THAT(problems,
              testing::ElementsAre(testing::AllOf(HasSubstr("step_000000000020.checkpoint"), HasSubstr("is damaged"))));
}

TEST_F(RunDirectory, ARenamedCheckpointIsRefused) {
  fs::rename(save(10), directory / "checkpoints/step_000000000011.checkpoint");
  std::vector<std::string> problems;
  EXPECT_FALSE(RunCheckpoints(directory).newest(problems));
  EXPECT_THAT(problems, testing::ElementsAre(HasSubstr("is of another step")));
}

TEST_F(RunDirectory, AFailedSaveLeavesWhatThereWas) {
  save(10);
  const RunCheckpoints checkpoints(directory);
  EXPECT_THROW(
      checkpoints.save(
          20, [](StateWriter& writer) { writer.text("state", "half"); }, []() -> checkpoint::Run { throw InputError("no"); }),
      InputError);
  EXPECT_EQ(files(), std::set<std::string>{"step_000000000010.checkpoint"});
}

TEST_F(RunDirectory, WithoutCheckpointsThereIsNone) {
  std::vector<std::string> problems;
  EXPECT_FALSE(RunCheckpoints(directory / "nowhere").newest(problems));
  EXPECT_TRUE(problems.empty());
}

TEST_F(RunDirectory, ClearsCheckpointsAndNothingElse) {
  save(10);
  for (const char* name : {"step_000000000020.checkpoint.partial", "notes.txt", "step_best.checkpoint"})
    std::ofstream(directory / "checkpoints" / name) << "mine";
  RunCheckpoints(directory).clear();
  EXPECT_EQ(files(), (std::set<std::string>{"notes.txt", "step_best.checkpoint"}));
}

}  // namespace
}  // namespace cleave::checkpoint
