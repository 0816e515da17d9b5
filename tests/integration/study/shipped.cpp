// The studies in configs/studies.

#include "program.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace cleave::test {
namespace {

const fs::path studies = fs::path(CLEAVE_SOURCE_DIR) / "configs/studies";

class ShippedStudy : public Program, public testing::WithParamInterface<std::string> {};

TEST_P(ShippedStudy, HasRunsWhoseScenesAreRead) {
  const Outcome list = cleave("study '" + (studies / (GetParam() + ".toml")).string() + "' --dry-run");
  EXPECT_EQ(list.status, 0) << list.err;
  EXPECT_NE(list.out.find(" points, "), std::string::npos) << list.out;
  EXPECT_EQ(list.out.find("(the scene is refused)"), std::string::npos) << list.out;
}

std::vector<std::string> names() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(studies))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}
INSTANTIATE_TEST_SUITE_P(All, ShippedStudy, testing::ValuesIn(names()), [](const auto& info) { return info.param; });

class ElasticBarStudy : public Program {};

/// An author's law joins a study in one line: as a further value on the command line, as a line of its file would be.
TEST_F(ElasticBarStudy, TakesAFurtherLawInOneLine) {
  const std::string law = "{ plugin = \"energy-only\", youngs_modulus = 1e5, poissons_ratio = 0 }";
  const std::string plugins = "CLEAVE_PLUGIN_PATH='" CLEAVE_SOUND_PLUGINS "'";
  const std::string study = "study '" + (studies / "elastic_bar.toml").string() + "'";
  const std::string wanted = "law energy-only, cell size 0.05 m";
  const Outcome list = cleave(study + " --value law='" + law + "' --dry-run", plugins);
  ASSERT_EQ(list.status, 0) << list.err;
  const auto at = list.out.find(wanted);
  ASSERT_NE(at, std::string::npos) << list.out;
  EXPECT_EQ(list.out.find("refused"), std::string::npos) << list.out;
  const auto line = list.out.rfind('\n', at) + 1;
  const std::string number = std::to_string(std::stoi(list.out.substr(line)));
  ASSERT_EQ(cleave(study + " --value law='" + law + "' --out out --run " + number, plugins).status, 0);
  ASSERT_EQ(cleave(study + " --value law='" + law + "' --out out --collect", plugins).status, 0);
  const auto json = nlohmann::json::parse(contents(directory / "out/results.json"));
  const auto& points = json.at("points");
  const auto point = std::find_if(points.begin(), points.end(), [](const auto& p) { return p.at("outcome") == "done"; });
  ASSERT_NE(point, points.end());
  EXPECT_EQ(point->at("at").at("law"), "energy-only");
  EXPECT_LT(point->at("error").get<double>(), 0.06);
}

}  // namespace
}  // namespace cleave::test
