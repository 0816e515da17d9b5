// Every check fails for a plugin that breaks its requirement, and for that alone: the matrix of checks and broken plugins.
#include <cleave/testkit/runner.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <sstream>
#include <string>

namespace cleave::testkit {
namespace {

struct Defect {
  const char *name, *what, *checks;
};
constexpr Defect defects[] = {
#define DEFECT(name, what, checks) {#name, what, checks},
#include "defects.def"
#undef DEFECT
};

std::set<std::string> words(const char* text) {
  std::istringstream in(text);
  std::set<std::string> all;
  for (std::string word; in >> word;) all.insert(word);
  return all;
}

class BrokenPlugin : public testing::TestWithParam<Defect> {};

TEST_P(BrokenPlugin, FailsTheChecksOfItsDefectAndNoOthers) {
  Options options;
  options.library = std::string(CLEAVE_CONFORMANCE_FIXTURES) + "/" + GetParam().name + ".so";
  options.time_limit = std::string(GetParam().name) == "hangs" ? 0.5 : 60;
  const Report report = run_checks(options);
  std::set<std::string> failed;
  for (const Result& result : report.results)
    if (result.verdict == Verdict::failed) failed.insert(result.check->id);
  EXPECT_EQ(failed, words(GetParam().checks)) << GetParam().what << "\n" << to_table(report);
}

INSTANTIATE_TEST_SUITE_P(Conformance, BrokenPlugin, testing::ValuesIn(defects),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(ConformanceChecks, EachIsFailedBySomeBrokenPlugin) {
  std::set<std::string> caught;
  for (const Defect& defect : defects) caught.merge(words(defect.checks));
  for (const Check& check : all_checks()) EXPECT_TRUE(caught.contains(check.id)) << check.id << " cannot fail";
}

TEST(ConformanceChecks, HaveIdsAndNumbersOfTheirOwn) {
  std::set<std::string> ids;
  std::set<int> numbers;
  for (const Check& check : all_checks()) {
    EXPECT_TRUE(ids.insert(check.id).second) << check.id;
    EXPECT_TRUE(numbers.insert(check.number).second) << check.id;
    EXPECT_EQ(std::string(check.sentence).back(), '.') << check.id;
  }
}

}  // namespace
}  // namespace cleave::testkit
