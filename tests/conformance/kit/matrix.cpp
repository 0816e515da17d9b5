// Every check fails for a plugin that breaks its requirement, and for that alone: the matrix of checks and broken plugins.
#include <cleave/testkit/runner.hpp>

#include "../../sanitized.hpp"
#include "kit/broken.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <sstream>
#include <string>

namespace cleave::testkit {
namespace {

struct Defect {
  const char *group, *name, *what, *checks;
};
constexpr Defect defects[] = {
#define DEFECT(name, what, checks) {"generic", #name, what, checks},
#include "generic/defects.def"
#undef DEFECT
#define DEFECT(name, what, checks) {"elasticity", #name, what, checks},
#include "elasticity/defects.def"
#undef DEFECT
#define DEFECT(name, what, checks) {"plasticity", #name, what, checks},
#include "plasticity/defects.def"
#undef DEFECT
#define DEFECT(name, what, checks) {"damage", #name, what, checks},
#include "damage/defects.def"
#undef DEFECT
#define DEFECT(name, what, checks) {"local_damage", #name, what, checks},
#include "local_damage/defects.def"
#undef DEFECT
#define DEFECT(name, what, checks) {"constraint", #name, what, checks},
#include "constraint/defects.def"
#undef DEFECT
#define DEFECT(name, what, checks) {"discretization", #name, what, checks},
#include "discretization/defects.def"
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
  const Defect& defect = GetParam();
  // Memory that is lost is not seen where memory that is given back is kept, too; what is used after that fails all checks.
  const std::string name = defect.name;
  if (test::sanitized && (name == "leaks_instances" || name == "leaks_on_load" || name == "keeps_body_arrays"))
    GTEST_SKIP() << "AddressSanitizer has memory of its own";
  const bool generic = std::string(defect.group) == "generic";
  Options options;
  options.library =
      std::string(CLEAVE_CONFORMANCE_FIXTURES) + (generic ? "/" : "/broken_") + (generic ? defect.name : defect.group) + ".so";
  options.time_limit = std::string(defect.name) == "hangs" ? 0.5 : 60;
  setenv(CLEAVE_DEFECT_VARIABLE, defect.name, 1);
  const Report report = run_checks(options);
  unsetenv(CLEAVE_DEFECT_VARIABLE);
  std::set<std::string> failed;
  for (const Result& result : report.results)
    if (result.verdict == Verdict::failed) failed.insert(result.check->id);
  EXPECT_EQ(failed, words(defect.checks)) << defect.what << "\n" << to_table(report);
}

INSTANTIATE_TEST_SUITE_P(Conformance, BrokenPlugin, testing::ValuesIn(defects),
                         [](const auto& info) { return std::string(info.param.group) + "_" + info.param.name; });

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
