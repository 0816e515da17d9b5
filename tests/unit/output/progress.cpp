#include "output/progress.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <sstream>

namespace cleave::output {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class ProgressLine : public testing::Test {
 protected:
  Progress progress(Progress::Mode mode, int width = 120) {
    return Progress(
        2.0, 1000000, mode, out, [this] { return now; }, width);
  }
  /// What has been written since the last look.
  std::string written() {
    std::string text = out.str();
    out.str("");
    return text;
  }
  static FrameRecord record(int frame, double time, std::int64_t steps) {
    FrameRecord record;
    record.frame = frame;
    record.time = time;
    record.steps = steps;
    record.time_step = 1.25e-4;
    record.limited_by = "elastic wave";
    return record;
  }
  std::ostringstream out;
  double now = 1000;
};

TEST_F(ProgressLine, BarShowsShareFrameStepsRateAndTimeLeft) {
  Progress bar = progress(Progress::Mode::bar);
  now += 10;
  bar.step(0.5, 200, 12);  // 200 steps of a million particles in 10 s; three quarters are left
  const std::string line = written();
  EXPECT_THAT(line, AllOf(HasSubstr("[#####"), HasSubstr("25%"), HasSubstr("frame 12"), HasSubstr("step 200"),
                          HasSubstr("20.0 Mp/s"), HasSubstr("0:30 left"), Not(HasSubstr("\n"))));
  EXPECT_EQ(line.front(), '\r');
}

TEST_F(ProgressLine, BarRateFollowsTheLastSecond) {
  Progress bar = progress(Progress::Mode::bar);
  now += 10;
  bar.step(0.5, 200, 1);
  now += 2;
  bar.step(0.6, 280, 1);
  EXPECT_THAT(out.str(), HasSubstr("40.0 Mp/s"));
}

TEST_F(ProgressLine, BarIsDrawnTenTimesASecondHoweverOftenItIsCalled) {
  Progress bar = progress(Progress::Mode::bar);
  for (int i = 1; i <= 10000; ++i) {
    now += 1e-3;
    bar.step(1e-4 * i, i, 0);
  }
  const std::string text = written();
  const auto drawings = std::count(text.begin(), text.end(), '\r');
  EXPECT_GE(drawings, 95);
  EXPECT_LE(drawings, 101);
}

TEST_F(ProgressLine, BarFitsTheTerminal) {
  for (const int width : {1, 20, 40, 60, 80, 200}) {
    Progress bar = progress(Progress::Mode::bar, width);
    bar.step(0.5, 123456, 12);
    std::string line = written();
    line = line.substr(1, line.find("\x1b[K") - 1);
    EXPECT_LT(line.size(), static_cast<std::size_t>(width));
  }
}

TEST_F(ProgressLine, FinishTakesTheBarAway) {
  Progress bar = progress(Progress::Mode::bar);
  bar.step(0.5, 1, 1);
  written();
  bar.finish("done");
  EXPECT_EQ(written(), "\r\x1b[Kdone\n");
}

TEST_F(ProgressLine, ABarThatIsAbandonedLeavesACleanLine) {
  {
    Progress bar = progress(Progress::Mode::bar);
    bar.step(0.5, 1, 1);
  }
  EXPECT_TRUE(written().ends_with("\r\x1b[K"));
}

TEST_F(ProgressLine, LinesAreOnePerFrameWithoutControlCharacters) {
  Progress lines = progress(Progress::Mode::lines);
  lines.frame(record(0, 0, 0));
  EXPECT_EQ(written(), "frame 0  time 0 s  0%\n");
  now += 10;
  lines.step(0.5, 200, 1);
  EXPECT_EQ(written(), "");
  lines.frame(record(1, 0.5, 200));
  EXPECT_EQ(written(), "frame 1  time 0.5 s  25%  200 steps, last 0.000125 s (elastic wave)  20.0 Mp/s  0:30 left\n");
  now += 5;
  lines.frame(record(2, 1, 200));
  EXPECT_THAT(written(), AllOf(HasSubstr("50%"), HasSubstr("40.0 Mp/s"), HasSubstr("0:15 left")));
  lines.finish("done");
  EXPECT_EQ(written(), "done\n");
}

TEST_F(ProgressLine, QuietIsQuiet) {
  {
    Progress quiet = progress(Progress::Mode::quiet);
    now += 10;
    quiet.step(0.5, 200, 12);
    quiet.frame(record(1, 0.5, 200));
    quiet.finish("done");
  }
  EXPECT_EQ(written(), "");
}

TEST_F(ProgressLine, NonsenseTimesDoNotReachTheScreen) {
  Progress bar(
      0, 0, Progress::Mode::bar, out, [this] { return now; }, 120);
  bar.step(std::numeric_limits<double>::quiet_NaN(), 0, 0);
  EXPECT_THAT(written(), AllOf(HasSubstr("  0%"), HasSubstr("-:-- left"), Not(HasSubstr("nan"))));
}

TEST_F(ProgressLine, LongWaitsAreTold) {
  Progress bar = progress(Progress::Mode::bar);
  now += 3600;
  bar.step(1, 10, 1);
  EXPECT_THAT(written(), HasSubstr("1:00:00 left"));
}

TEST(ProgressMode, IsLinesWhereThereIsNoTerminal) { EXPECT_EQ(Progress::mode_for(-1), Progress::Mode::lines); }

}  // namespace
}  // namespace cleave::output
