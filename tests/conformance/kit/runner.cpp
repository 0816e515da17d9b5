// What becomes of a run: verdicts, reproduction, reports, and the page generated from the checks.
#include <cleave/testkit/runner.hpp>

#include "../../sanitized.hpp"
#include "kit/broken.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace cleave::testkit {
namespace {

using testing::HasSubstr;
using testing::Not;

Options fixture(const std::string& name) {
  Options options;
  options.library = std::string(CLEAVE_CONFORMANCE_FIXTURES) + "/" + name + ".so";
  return options;
}

TEST(ConformanceRun, SaysHowAPluginEnded) {
  EXPECT_THAT(run_checks(fixture("exits"), {"call.deterministic"}).results.at(0).reason,
              HasSubstr("ended the process with exit status 0"));
  EXPECT_THAT(run_checks(fixture("writes_input"), {"call.inputs-unchanged"}).results.at(0).reason,
              HasSubstr(test::sanitized ? "ended the process with exit status 1, given inputs in read-only memory"
                                        : "Segmentation fault, given inputs in read-only memory"));
  setenv(CLEAVE_DEFECT_VARIABLE, "throws", 1);
  EXPECT_THAT(run_checks(fixture("broken_elasticity"), {"call.deterministic"}).results.at(0).reason,
              HasSubstr("an exception left the plugin: a hundred are too many"));
  unsetenv(CLEAVE_DEFECT_VARIABLE);
  Options hanging = fixture("hangs");
  hanging.time_limit = 0.3;
  EXPECT_THAT(run_checks(hanging, {"abi.unknown-names"}).results.at(0).reason, HasSubstr("did not end within 0.3 s"));
}

TEST(ConformanceRun, FailingRandomCaseRunsAgainByItsNumber) {
  const Result first = run_checks(fixture("rare_crash"), {"call.fuzz"}).results.at(0);
  ASSERT_EQ(first.verdict, Verdict::failed);
  const auto at = first.reproduction.find(" --reproduce ");
  ASSERT_NE(at, std::string::npos) << first.reproduction;
  EXPECT_THAT(first.reproduction, HasSubstr("cleave check "));
  EXPECT_THAT(first.reproduction, HasSubstr("rare_crash.so --only call.fuzz"));
  Options again = fixture("rare_crash");
  again.reproduce = std::stoull(first.reproduction.substr(at + 13));
  again.seed = 99;  // plays no part
  const Result second = run_checks(again, {"call.fuzz"}).results.at(0);
  EXPECT_EQ(second.reason, first.reason);
  EXPECT_EQ(second.reproduction, first.reproduction);
  again.library = fixture("whole").library;
  EXPECT_EQ(run_checks(again, {"call.fuzz"}).results.at(0).verdict, Verdict::passed);
}

TEST(ConformanceRun, SetFixesAParameter) {
  Options stiff = fixture("silent_not_a_number");
  EXPECT_EQ(run_checks(stiff, {"call.deterministic"}).results.at(0).verdict, Verdict::passed);
  stiff.set = {{"stiffness", "1e8"}};
  const Result bad = run_checks(stiff, {"call.requested-outputs"}).results.at(0);
  EXPECT_EQ(bad.verdict, Verdict::failed);
  EXPECT_THAT(bad.reason, HasSubstr("stiffness=1e+08"));
  stiff.set = {{"softness", "1"}};
  EXPECT_THAT(run_checks(stiff, {"call.deterministic"}).results.at(0).reason, HasSubstr("no parameter \"softness\""));
}

TEST(ConformanceRun, LibraryThatCannotBeLoadedFailsOnceAndSkipsTheRest) {
  const Report report = run_checks(fixture("crashes_in_entry"));
  for (const Result& result : report.results)
    EXPECT_EQ(result.verdict, std::string(result.check->id) == "abi.loads" ? Verdict::failed : Verdict::skipped);
}

TEST(ConformanceRun, UnknownCheckIsRefused) {
  EXPECT_THROW(run_checks(fixture("whole"), {"call.nothing"}), std::invalid_argument);
}

TEST(ConformanceReport, FormatsAgreeOnTheVerdicts) {
  const std::vector<Report> reports{
      run_checks(fixture("no_unit"), {"metadata.described", "metadata.defaults", "metadata.state-size"})};
  EXPECT_THAT(to_table(reports[0]), HasSubstr("1 passed, 1 failed, 1 skipped"));
  EXPECT_THAT(to_json(reports), HasSubstr("{\"id\": \"metadata.described\", \"verdict\": \"failed\""));
  EXPECT_THAT(to_json(reports), HasSubstr("has no unit (\\\"1\\\" if dimensionless)"));
  EXPECT_THAT(to_junit(reports), HasSubstr("<testsuite name=\"elasticity/fixture\" tests=\"3\" failures=\"1\" skipped=\"1\">"));
  EXPECT_THAT(to_junit(reports), HasSubstr("has no unit (&quot;1&quot; if dimensionless)"));
}

TEST(ConformanceReport, TellsWhatALawCostsAndWarnsBeyondItsBudget) {
  const std::vector<Report> reports{run_checks(fixture("whole"), {"speed.budget"})};
  EXPECT_THAT(to_table(reports[0]), HasSubstr("passed: f64 of F "));
  EXPECT_THAT(to_json(reports), HasSubstr("\"remark\": \"f64 of F "));
  EXPECT_THAT(to_junit(reports), HasSubstr("<system-out>f64 of F "));
  EXPECT_THAT(to_table(reports[0]), Not(HasSubstr("WARNING")));

  setenv(CLEAVE_DEFECT_VARIABLE, "over_budget", 1);
  const Result slow = run_checks(fixture("broken_damage"), {"speed.budget"}).results.at(0);
  unsetenv(CLEAVE_DEFECT_VARIABLE);
  EXPECT_EQ(slow.verdict, Verdict::passed);
  EXPECT_THAT(slow.remark, HasSubstr("WARNING: more than the 20 ns of about.budget_ns"));
}

std::string page() {
  std::ifstream in(CLEAVE_SOURCE_DIR "/docs/conformance.md");
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// CLEAVE_UPDATE_DOCS=1 writes the table.
TEST(ConformancePage, TableIsThatOfTheChecks) {
  const std::string begin = "<!-- checks -->\n", end = "<!-- end of checks -->\n";
  std::string text = page();
  const auto first = text.find(begin), last = text.find(end);
  ASSERT_TRUE(first != std::string::npos && last != std::string::npos);
  const auto start = first + begin.size();
  if (std::getenv("CLEAVE_UPDATE_DOCS")) {
    text.replace(start, last - start, checks_markdown());
    std::ofstream(CLEAVE_SOURCE_DIR "/docs/conformance.md") << text;
    return;
  }
  EXPECT_EQ(text.substr(start, last - start), checks_markdown())
      << "docs/conformance.md is out of date: run with CLEAVE_UPDATE_DOCS=1";
}

}  // namespace
}  // namespace cleave::testkit
