// What a study file says, and what is wrong with it.

#include "common/error.hpp"
#include "study/expression.hpp"
#include "study_testing.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace cleave::test {
namespace {

using study::Study;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

std::string problem_of(const StudyFiles& files, const std::string& text, const std::vector<std::string>& added = {}) {
  try {
    files.study(text, added);
  } catch (const InputError& problem) {
    return problem.what();
  }
  return "no error";
}

std::vector<std::string> labels(const study::Axis& axis) {
  std::vector<std::string> labels;
  for (const auto& value : axis.values) labels.push_back(value.label);
  return labels;
}

TEST(StudyPoints, AreTheProductOfTheAxesTheFirstOneOutermost) {
  const StudyFiles files;
  const Study study = files.study(
      "[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nvalues = [0.2, 0.4]\n"
      "[[axis]]\nname = \"b\"\npath = \"simulation.transfer\"\nvalues = [\"apic\", \"pic\", \"flip\"]\n" +
      error_table);
  EXPECT_THAT(study::product(study.axes), ElementsAre(ElementsAre(0, 0), ElementsAre(0, 1), ElementsAre(0, 2),
                                                      ElementsAre(1, 0), ElementsAre(1, 1), ElementsAre(1, 2)));
  EXPECT_EQ(study::name_of(study, {1, 2}), "a 0.4, b flip");
  EXPECT_TRUE(study.axes[0].numeric());
  EXPECT_FALSE(study.axes[1].numeric());
  EXPECT_EQ(study.along, std::optional<std::size_t>(0)) << "lines follow the first axis of numbers";
}

TEST(StudyAxes, ChangeSeveralPathsTogether) {
  const StudyFiles files;
  const Study study = files.study(
      "[[axis]]\nname = \"resolution\"\npaths = [\"simulation.cell_size\", \"simulation.time_step\"]\n"
      "values = [[0.1, 1e-3], [0.05, 5e-4]]\nunit = \"m\"\n" +
      error_table);
  const auto& overrides = study.axes[0].values[1].overrides;
  ASSERT_EQ(overrides.size(), 2u);
  EXPECT_EQ(overrides[0].path + "=" + overrides[0].value, "simulation.cell_size=0.05");
  EXPECT_EQ(overrides[1].path + "=" + overrides[1].value, "simulation.time_step=5e-04");
  EXPECT_EQ(study.axes[0].values[1].number, 0.05);
}

TEST(StudyAxes, NameLawsByTheirPluginAndWhatTellsThemApart) {
  const StudyFiles files;
  const Study study = files.study(
      "[[axis]]\nname = \"law\"\npath = \"material.rubber.elasticity\"\nvalues = [\n"
      "  { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 },\n"
      "  { plugin = \"qr\", youngs_modulus = 1e5, poissons_ratio = 0.3, fiber_scale = 1 },\n"
      "  { plugin = \"qr\", youngs_modulus = 1e5, poissons_ratio = 0.3, fiber_scale = 2 },\n]\n" +
          error_table,
      {"law={ plugin = \"my-law\" }"});
  EXPECT_THAT(labels(study.axes[0]), ElementsAre("split-neo-hookean", "qr, fiber_scale 1", "qr, fiber_scale 2", "my-law"));
}

TEST(StudyAxes, SpreadRangesByDistanceOrByRatio) {
  const StudyFiles files;
  const auto numbers = [&](const std::string& range) {
    std::vector<double> numbers;
    const Study study = files.study("[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nrange = " + range + "\n" + error_table);
    for (const auto& value : study.axes[0].values) numbers.push_back(*value.number);
    return numbers;
  };
  EXPECT_THAT(numbers("{ from = 0.1, to = 0.4, count = 4 }"), ElementsAre(0.1, 0.2, 0.3, 0.4));
  EXPECT_THAT(numbers("{ from = 0.001, to = 0.1, count = 3, scale = \"logarithmic\" }"), ElementsAre(0.001, 0.01, 0.1));
}

TEST(StudyConstants, MayBeMadeOfAxesAndOfEachOtherInAnyOrder) {
  const StudyFiles files;
  const Study study = files.study(
      "[constants]\na = \"2 * b\"\nb = \"E + 1\"\n"
      "[[axis]]\nname = \"E\"\npath = \"material.rubber.elasticity.youngs_modulus\"\nvalues = [3, 5]\n" +
      error_table);
  const auto names = study.names();
  const auto values = study::constants_of(study, {5});
  ASSERT_EQ(names.size(), values.size());
  for (std::size_t i = 0; i < names.size(); ++i) EXPECT_EQ(values[i], names[i] == "a" ? 12 : names[i] == "b" ? 6 : 5);
}

TEST(StudyFile, SaysWhereItIsWrongAndWhatWouldBeRight) {
  const StudyFiles files;
  const std::string axis = "[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nvalues = [0.2, 0.4]\n";
  EXPECT_EQ(problem_of(files, axis + error_table), "no error");
  // line 1 is that of the scene
  EXPECT_THAT(problem_of(files, "repetition = 3\n" + axis + error_table),
              HasSubstr("study.toml:2:1: error: unknown key 'repetition' in the study, did you mean 'repetitions'?"));
  EXPECT_THAT(problem_of(files, axis), HasSubstr("the study needs 'error'"));
  EXPECT_THAT(problem_of(files, axis + "[error]\nvalue = \"momentm_x\"\nformula = \"0\"\n"),
              HasSubstr("study.toml:7:9: error: 'momentm_x': there is no 'momentm_x' here, did you mean 'momentum_x'?"));
  EXPECT_THAT(problem_of(files, axis + "[error]\nvalue = \"mass * (1\"\nformula = \"0\"\n"),
              HasSubstr("study.toml:7:9: error: 'mass * (1': "));
  EXPECT_THAT(problem_of(files, axis + "[error]\nvalue = \"mass\"\n"),
              HasSubstr("needs one of 'formula', 'reference' and 'file', has 0"));
  EXPECT_THAT(problem_of(files, axis + "[error]\nvalue = \"mass\"\n[error.reference]\nat = { a = 0.3 }\n"),
              HasSubstr("axis 'a' has no value '0.3'"));
  EXPECT_THAT(problem_of(files, axis + axis + error_table), HasSubstr("there already is an axis 'a'"));
  EXPECT_THAT(problem_of(files, "kind = \"stability\"\n" + axis + "[stability]\nenergy = \"kinetic_energy\"\n"),
              HasSubstr("a stability map has two axes, this one has 1"));
  EXPECT_THAT(problem_of(files, "[constants]\np = \"q\"\nq = \"p\"\n" + axis + error_table), HasSubstr("is made of itself"));
  EXPECT_THAT(problem_of(files, axis + error_table, {"b=1"}), HasSubstr("--value b=1: error: the study has no axis 'b'"));
  EXPECT_THAT(
      problem_of(files, "[[axis]]\nname = \"a\"\npaths = [\"simulation.cfl\", \"simulation.cell_size\"]\nvalues = [1]\n" +
                            error_table),
      HasSubstr("study.toml:5:11: error: each of 'values' must be a list of 2, one for each path, is 1"));
}

/// The key of a run stands for everything its results depend on.
TEST(StudyRuns, HaveAKeyOfTheirContents) {
  const StudyFiles files;
  const auto keys = [&](const std::string& text) {
    std::vector<std::string> keys;
    for (const auto& run : study::make_plan(files.study(text + error_table), files.registry).runs) keys.push_back(run.key);
    return keys;
  };
  const std::string axis = "[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nvalues = [0.2, 0.4]\n";
  const auto first = keys(axis);
  ASSERT_EQ(first.size(), 2u);
  EXPECT_NE(first[0], first[1]);
  EXPECT_EQ(keys(axis), first);
  EXPECT_EQ(keys("title = \"Another\"\nrepetitions = 5\ntime_limit = 3\n" + axis), first) << "what is measured, and how often";
  EXPECT_EQ(keys("[set]\nsimulation.transfer = \"apic\"\n" + axis), first) << "a default written out is the same scene";
  for (const std::string& other : {"threads = 2\n" + axis, "[set]\nsimulation.transfer = \"pic\"\n" + axis,
                                   "[set]\nmaterial.rubber.elasticity.plugin = \"fixed-corotated\"\n" + axis})
    EXPECT_THAT(keys(other), testing::Each(Not(testing::AnyOf(first[0], first[1])))) << other;
}

TEST(StudyRuns, HaveAnotherKeyOnceAFileOfTheSceneHasChanged) {
  const StudyFiles files;
  const std::string text =
      "[set.body.block]\nparticles = \"points.csv\"\n"
      "[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nvalues = [0.2]\n" +
      error_table;
  files.write("scene.toml", StudyFiles::block_of_nothing);
  const auto key = [&](const std::string& points) {
    files.write("points.csv", points);
    const auto plan = study::make_plan(files.study(text), files.registry);
    EXPECT_EQ(plan.runs[0].refusal, "");
    return plan.runs[0].key;
  };
  const std::string before = key("x,y\n0,0\n");
  EXPECT_EQ(key("x,y\n0,0\n"), before);
  EXPECT_NE(key("x,y\n0,0.01\n"), before);
}

TEST(StudyRuns, AreSharedByPointsAndReferences) {
  const StudyFiles files;
  const Study study = files.study(
      "[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nvalues = [0.4, 0.2, 0.1]\n"
      "[error]\nvalue = \"momentum_x\"\n[error.reference]\nat = { a = 0.1 }\n");
  const auto plan = study::make_plan(study, files.registry);
  EXPECT_EQ(plan.runs.size(), 3u);
  for (const auto& point : plan.points) EXPECT_EQ(point.reference, std::optional<std::size_t>(2));
}

TEST(StudyRuns, KeepScenesThatAreRefusedAsResults) {
  const StudyFiles files;
  const auto plan = study::make_plan(
      files.study("[[axis]]\nname = \"a\"\npath = \"simulation.cfl\"\nvalues = [0.4, 7]\n" + error_table), files.registry);
  ASSERT_EQ(plan.runs.size(), 2u);
  EXPECT_EQ(plan.runs[0].refusal, "");
  EXPECT_THAT(plan.runs[1].refusal, HasSubstr("'cfl' must be"));
  EXPECT_TRUE(plan.runs[1].scene.empty());
}

}  // namespace
}  // namespace cleave::test
