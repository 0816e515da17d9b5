#include "output/background.hpp"

#include "common/error.hpp"
#include "run_directory.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

namespace cleave::output {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using namespace std::chrono_literals;

struct Background : RunDirectory {
  FrameRecord row(int frame) const {
    FrameRecord record;
    record.frame = frame;
    return record;
  }
  long rows() const {
    const std::string table = contents("frames.csv");
    return std::count(table.begin(), table.end(), '\n') - 1;
  }
  /// A pipe where a file is to be written: nothing goes on until somebody reads.
  std::string hold(int frame) const {
    const std::string name = (directory / ("ply/frame_000" + std::to_string(frame) + ".ply.partial")).string();
    EXPECT_EQ(::mkfifo(name.c_str(), 0600), 0);
    return name;
  }
  static std::string read(const std::string& pipe) {
    std::ifstream file(pipe, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  static double clock() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }
};

TEST_F(Background, WritesWhatTheForegroundWrites) {
  const std::vector<std::string> formats{"vdb", "vtp", "ply"};
  std::map<std::string, std::string> bytes;
  for (const int threads : {0, 1, 2}) {
    Writer writer(directory, formats, true);
    BackgroundWriter frames(writer, threads, [] { return 1.0; });
    for (int i = 0; i < 3; ++i) frames.write(random_frame(300, 3, i), row(i));
    frames.wait();
    EXPECT_EQ(frames.frames(), 3);
    for (const std::string& name : files()) {
      std::string written = contents(name);
      if (name.ends_with(".vdb")) written.erase(21, 36);  // an identifier that is another one in each file
      EXPECT_TRUE(bytes.try_emplace(name, written).first->second == written) << name << ", threads " << threads;
    }
  }
  EXPECT_EQ(bytes.size(), 3u * 4 + 2);
}

TEST_F(Background, GoesOnBesideItsCallerAndARowFollowsItsFiles) {
  Writer writer(directory, {"ply"}, false);
  std::string whole;
  {
    BackgroundWriter frames(writer, 0, clock);
    frames.write(random_frame(2000, 3, 0), row(0));
    whole = contents("ply/frame_0000.ply");
  }
  BackgroundWriter frames(writer, 1, clock);
  const std::string pipe = hold(0);
  frames.write(random_frame(2000, 3, 0), row(0));  // returns, although nobody reads
  frames.check();
  std::this_thread::sleep_for(20ms);
  EXPECT_EQ(rows(), 1) << "no row before the frame is complete";
  EXPECT_EQ(frames.frames(), 0);
  EXPECT_EQ(read(pipe), whole);
  frames.wait();
  EXPECT_EQ(rows(), 2);
  EXPECT_EQ(frames.frames(), 1);
  EXPECT_GT(frames.seconds(), 0);
}

TEST_F(Background, ASecondFrameWaitsForTheFirst) {
  Writer writer(directory, {"ply"}, false);
  BackgroundWriter frames(writer, 1, clock);
  const std::string pipe = hold(0);
  frames.write(random_frame(20, 3, 0), row(0));
  std::atomic<bool> handed_over = false;
  std::thread caller([&] {
    frames.write(random_frame(20, 3, 1), row(1));
    handed_over = true;
  });
  std::this_thread::sleep_for(50ms);
  EXPECT_FALSE(handed_over);
  EXPECT_FALSE(std::filesystem::exists(directory / "ply/frame_0001.ply"));
  read(pipe);
  caller.join();
  frames.wait();
  EXPECT_TRUE(std::filesystem::exists(directory / "ply/frame_0001.ply"));
  EXPECT_THAT(contents("frames.csv"), HasSubstr("\n0,0,0,"));
  EXPECT_LT(contents("frames.csv").find("\n0,0,0,"), contents("frames.csv").find("\n1,0,0,"));
}

TEST_F(Background, WhatWritingThrowsReachesTheCallerOnce) {
  Writer writer(directory, {"ply"}, false);
  const auto expected = AllOf(HasSubstr("ply/frame_0007.ply"), HasSubstr("No such file or directory"));
  for (const int threads : {0, 1}) {
    BackgroundWriter frames(writer, threads, clock);
    std::filesystem::remove_all(directory / "ply");
    const auto write = [&] { frames.write(random_frame(5), row(7)); };
    if (threads == 0) {
      EXPECT_THAT(error_of(write), expected);
      continue;
    }
    write();
    EXPECT_THAT(error_of([&] { frames.wait(); }), expected);
    write();
    std::string found;  // without waiting, as soon as it is known
    for (int i = 0; i < 2000 && found.empty(); ++i) {
      found = error_of([&] { frames.check(); });
      std::this_thread::sleep_for(1ms);
    }
    EXPECT_THAT(found, expected);
    write();
    EXPECT_THAT(error_of(write), expected) << "at the latest with the next frame";
    EXPECT_EQ(error_of([&] { frames.wait(); }), "");
    EXPECT_EQ(frames.frames(), 0);
  }
  EXPECT_EQ(rows(), 0) << "no rows of frames that are not there";
}

TEST_F(Background, EndsWithItsLastFrameComplete) {
  Writer writer(directory, {"ply"}, false);
  const std::string pipe = hold(0);
  std::thread reader;
  {
    BackgroundWriter frames(writer, 1, clock);
    frames.write(random_frame(20, 3, 0), row(0));
    reader = std::thread([&] {
      std::this_thread::sleep_for(20ms);
      read(pipe);
    });
  }
  EXPECT_EQ(rows(), 1);
  reader.join();
}

}  // namespace
}  // namespace cleave::output
