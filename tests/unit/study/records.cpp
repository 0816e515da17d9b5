// What is kept of a run, and when it has to be run again.

#include "output/vtp.hpp"
#include "study/record.hpp"
#include "study/run_results.hpp"
#include "study_testing.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace cleave::study {
namespace {

Record finished(int repetitions) {
  Record record;
  record.wall_seconds.assign(std::size_t(repetitions), 0.5);
  record.time_limit = 10;
  return record;
}

TEST(StudyRecord, IsReadAsItWasWritten) {
  const test::StudyFiles files;
  Record record = finished(2);
  record.outcome = Outcome::timed_out;
  record.reason = "not \"finished\"\nat all";
  record.particles = 123456789012;
  record.steps = 7;
  record.peak_memory = 3e9;
  record.instructions = 1e12;
  record.instructions_by = "perf";
  record.machine = "a machine";
  write_record(record, files.directory / "record.json");
  const auto read = read_record(files.directory / "record.json");
  ASSERT_TRUE(read);
  EXPECT_EQ(read->outcome, record.outcome);
  EXPECT_EQ(read->reason, record.reason);
  EXPECT_EQ(read->wall_seconds, record.wall_seconds);
  EXPECT_EQ(read->particles, record.particles);
  EXPECT_EQ(read->steps, record.steps);
  EXPECT_EQ(read->peak_memory, record.peak_memory);
  EXPECT_EQ(read->instructions, record.instructions);
  EXPECT_EQ(read->machine, record.machine);
}

TEST(StudyRecord, ThatIsCutShortIsNone) {
  const test::StudyFiles files;
  EXPECT_FALSE(read_record(files.directory / "record.json"));
  files.write("record.json", "{ \"format\": \"cleave study run 1\", \"outcome\": \"done\"");
  EXPECT_FALSE(read_record(files.directory / "record.json"));
  files.write("record.json", "{ \"format\": \"cleave study run 1\", \"outcome\": \"done\" }");
  EXPECT_FALSE(read_record(files.directory / "record.json"));
}

TEST(StudyRecord, IsCompleteOnceEverythingAskedForIsThere) {
  EXPECT_TRUE(finished(3).complete(3, 10, false));
  EXPECT_TRUE(finished(3).complete(2, 10, false));
  EXPECT_FALSE(finished(3).complete(4, 10, false));
  EXPECT_FALSE(finished(3).complete(3, 10, true)) << "instructions were not counted yet";
  Record counted = finished(3);
  counted.instructions_by = "not counted: there is no counter";
  EXPECT_TRUE(counted.complete(3, 10, true));
  Record slow = finished(0);
  slow.outcome = Outcome::timed_out;
  EXPECT_TRUE(slow.complete(3, 10, false));
  EXPECT_TRUE(slow.complete(3, 5, false));
  EXPECT_FALSE(slow.complete(3, 20, false)) << "it may end within a longer time";
  Record refused = finished(0);
  refused.outcome = Outcome::refused;
  EXPECT_TRUE(refused.complete(3, 20, true));
}

TEST(StudyRecord, HasTheMedianOfItsTimes) {
  Record record;
  record.wall_seconds = {5, 1, 2};
  EXPECT_EQ(record.wall(), 2);
  record.wall_seconds = {5, 1, 2, 3};
  EXPECT_EQ(record.wall(), 2.5);
}

TEST(RunResults, ReadFramesWithNumbersThatAreNotFinite) {
  const test::StudyFiles files;
  const FrameTable frames = read_frames(
      files.write("frames.csv", "frame,time,limited_by,mass,kinetic_energy\n0,0,frame,2,1\n1,0.5,\"a, b\",nan,inf\n"));
  ASSERT_EQ(frames.rows.size(), 2u);
  EXPECT_EQ(frames.column("t")[1], 0.5);
  EXPECT_EQ(frames.column("mass")[0], 2);
  EXPECT_TRUE(std::isnan(frames.column("mass")[1]));
  EXPECT_EQ(frames.column("kinetic_energy")[1], std::numeric_limits<double>::infinity());
}

TEST(RunResults, ReadParticlesAsTheyWereWritten) {
  const test::StudyFiles files;
  std::filesystem::create_directory(files.directory / "vtp");
  output::ParticleFrame frame;
  frame.cell_size = 0.1;
  frame.bodies = {"body"};
  frame.body_ends = {2};
  frame.positions = {Vector3(0.1, 0.2, 0.3), Vector3(1. / 3, -5, 7)};
  frame.velocities = {Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(4, 5, 6)};
  frame.volumes = {1, 1};
  frame.attributes = {{"damage", 1, "1", {0.25f, 0.75f}}, {"F", 9, "1", std::vector<float>(18, 0.5f)}};
  write_vtp(files.directory / "vtp/frame_0000.vtp", frame);
  frame.positions[1].x() = 9;
  write_vtp(files.directory / "vtp/frame_0010.vtp", frame);
  const Particles particles = read_last_particles(files.directory);
  const auto value = [&](const std::string& name, std::size_t i) {
    const auto at = std::find(particles.names.begin(), particles.names.end(), name) - particles.names.begin();
    return particles.values.at(std::size_t(at)).at(i);
  };
  EXPECT_EQ(particles.count(), 2u);
  EXPECT_EQ(value("x", 1), 9);
  EXPECT_EQ(value("X", 1), 1. / 3) << "to the last bit";
  EXPECT_EQ(value("z", 1), 7);
  EXPECT_EQ(value("vy", 1), 5);
  EXPECT_EQ(value("damage", 0), 0.25);
  EXPECT_EQ(value("F_yx", 1), 0.5);
}

}  // namespace
}  // namespace cleave::study
