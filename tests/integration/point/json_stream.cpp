#include "point/json_stream.hpp"
#include "point_testing.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <sstream>

namespace cleave::testing {
namespace {

using Json = nlohmann::json;

class JsonStream : public PointTest {
 protected:
  /// The answers to the lines, after the announcement, which goes to `hello`.
  std::vector<Json> ask(const app::PointOptions& options, const std::string& lines) {
    plugins::Registry registry({std::filesystem::path(CLEAVE_BINARY_DIR) / "lib/cleave/plugins", CLEAVE_POINT_PLUGINS});
    std::vector<std::string> warnings;
    const point::Laws laws = point::make_laws(options.laws, registry, warnings);
    std::istringstream in(lines);
    std::ostringstream out;
    point::serve_json(laws, in, out);
    std::istringstream written(out.str());
    std::vector<Json> answers;
    for (std::string line; std::getline(written, line);) answers.push_back(Json::parse(line));
    hello = answers.front();
    answers.erase(answers.begin());
    return answers;
  }
  static app::PointOptions with(app::PointOptions options, const std::string& plasticity, const std::string& damage,
                                const std::vector<std::string>& sets) {
    if (!plasticity.empty()) options.laws.plasticity = plasticity;
    if (!damage.empty()) options.laws.damage = damage;
    options.laws.sets.insert(options.laws.sets.end(), sets.begin(), sets.end());
    return options;
  }
  static std::string request(const Json& id, const Matrix3& F) {
    Json numbers;
    for (int i = 0; i < 9; ++i) numbers.push_back(F(i / 3, i % 3));
    return Json{{"id", id}, {"F", numbers}}.dump() + "\n";
  }
  static Matrix3 stretched(double stretch) {
    Matrix3 F = Matrix3::Identity();
    F(0, 0) = stretch;
    F(0, 1) = 0.1;
    return F;
  }

  Json hello;
};

const std::string rest = R"("F":[1,0,0,0,1,0,0,0,1])";

TEST_F(JsonStream, AnswersWithTheNumbersOfATable) {
  for (const char* precision : {"double", "single"}) {
    app::PointOptions options = with(neo_hookean(), "point-von-mises", "point-tensile-energy",
                                     {"plasticity.yield_stress=1e4", "damage.critical_energy=100"});
    options.laws.precision = precision;
    const Result table = evaluate(options, header + "\n1.3,0.1,0,0,1,0,0,0,1\n1.001,0.1,0,0,1,0,0,0,1\n");
    ASSERT_EQ(table.status, 0) << table.err;
    const auto answers = ask(options, request(1, stretched(1.3)) + request("second", stretched(1.001)));
    ASSERT_EQ(answers.size(), 2u);
    EXPECT_EQ(answers[1]["id"], "second");
    for (std::size_t row = 0; row < 2; ++row) {
      const Table expected = table.table();
      for (const char* name : {"psi", "psi_plus", "J", "D", "yielded"})
        EXPECT_EQ(answers[row][name].get<double>(), expected.number(row, name)) << name;
      for (const std::string name : {"P", "tau", "Fe"})
        for (int i = 0; i < 9; ++i)
          EXPECT_EQ(answers[row][name][std::size_t(i)].get<double>(), expected.matrix(row, name)(i / 3, i % 3)) << name << i;
      for (const auto& variable : hello["state"]) {
        const std::string name = variable["name"];
        if (variable["components"] == 1)
          EXPECT_EQ(answers[row]["state"][name].get<double>(), expected.number(row, name + "_out"));
        else
          for (std::size_t i = 0; i < variable["components"]; ++i)
            EXPECT_EQ(answers[row]["state"][name][i].get<double>(), expected.number(row, name + std::to_string(i) + "_out"));
      }
      EXPECT_EQ(answers[row]["status"], "ok");
    }
    EXPECT_EQ(answers[0]["yielded"], 1);
  }
}

TEST_F(JsonStream, AnnouncesLawsAndTheStateAPointStartsWith) {
  ask(with(neo_hookean(), "nacc", "",
           {"plasticity.friction_slope=1.85", "plasticity.cohesion=0.5", "plasticity.hardening_factor=1",
            "plasticity.alpha0=-0.25"}),
      "");
  EXPECT_EQ(hello["protocol"], 1);
  ASSERT_EQ(hello["laws"].size(), 2u);
  EXPECT_EQ(hello["laws"][0]["id"], "elasticity/split-neo-hookean");
  EXPECT_EQ(hello["laws"][1]["id"], "plasticity/nacc");
  ASSERT_EQ(hello["state"].size(), 1u);
  EXPECT_EQ(hello["state"][0]["initial"], -0.25);
  EXPECT_EQ(hello["request"][0], (Json{{"name", "F"}, {"unit", "1"}, {"components", 9}}));
}

TEST_F(JsonStream, TheStateOfAnAnswerGoesIntoTheNextRequest) {
  const auto options = with(neo_hookean(), "point-von-mises", "", {"plasticity.yield_stress=1e4"});
  const Json first = ask(options, request(0, stretched(1.3)))[0];
  Json next = Json::parse(request(1, Matrix3::Identity()));
  EXPECT_NE(ask(options, next.dump() + "\n")[0]["state"], first["state"]);
  next["state"] = first["state"];
  EXPECT_EQ(ask(options, next.dump() + "\n")[0]["state"], first["state"]) << "at rest a point keeps the state it is given";
}

TEST_F(JsonStream, APointOfABatchIsThePointByItself) {
  std::string lines;
  Json batch{{"id", nullptr}, {"points", Json::array()}};
  for (int k = 0; k < 70; ++k) {
    lines += request(k, stretched(1 + 0.01 * k));
    Json point = Json::parse(request(0, stretched(1 + 0.01 * k)));
    point.erase("id");
    batch["points"].push_back(point);
  }
  auto answers = ask(neo_hookean(), lines + batch.dump() + "\n{\"points\": []}\n");
  ASSERT_EQ(answers.size(), 72u);
  ASSERT_EQ(answers[70]["points"].size(), 70u);
  for (std::size_t k = 0; k < 70; ++k) {
    EXPECT_EQ(answers[k]["id"], k);
    answers[k].erase("id");
    EXPECT_EQ(answers[70]["points"][k], answers[k]);
  }
  EXPECT_EQ(answers[71]["points"], Json::array());
}

TEST_F(JsonStream, TimePassesForDamage) {
  const auto options = with(neo_hookean(), "", "point-tensile-energy", {"damage.critical_energy=100"});
  const Result table = evaluate(options, header + ",d,dt\n1.3,0,0,0,1,0,0,0,1,0.1,0.01\n");
  const Json answer = ask(options, R"({"F":[1.3,0,0,0,1,0,0,0,1],"d":0.1,"dt":0.01})"
                                   "\n")[0];
  EXPECT_EQ(answer["d"].get<double>(), table.table().number(0, "d_out"));
  EXPECT_GT(answer["d"].get<double>(), 0.1);
}

TEST_F(JsonStream, NumbersThatAreNoneAreWords) {
  const Json answer = ask(neo_hookean(), R"({"F":[-1,0,0,0,1,0,0,0,1]})"
                                         "\n")[0];
  EXPECT_EQ(answer["status"], "fatal");
  EXPECT_EQ(answer["psi"], "nan");
  EXPECT_EQ(answer["tau"][8], "nan");
}

TEST_F(JsonStream, WhatCannotBeUsedIsSaidAndTheStreamGoesOn) {
  const auto options = with(neo_hookean(), "point-von-mises", "", {"plasticity.yield_stress=1e4"});
  const auto error = [&](const std::string& line) {
    const auto answers = ask(options, line + "\n{\"id\": 2, " + rest + "}\n");
    EXPECT_EQ(answers.size(), 2u) << line;
    EXPECT_EQ(answers[1]["status"], "ok") << line;
    EXPECT_TRUE(answers[0].contains("id")) << line;
    return answers[0].value("error", "");
  };
  EXPECT_EQ(error(R"({"F":[1,2]})"), "F must be a list of 9 numbers, is a list of 2");
  EXPECT_EQ(error(R"({"F":[1,0,0,0,"x",0,0,0,1]})"), "F[4] must be a number, is \"x\"");
  EXPECT_EQ(error(R"({"id":7})"), "F is missing: the deformation gradient, nine numbers row by row");
  EXPECT_EQ(error("{" + rest + R"(,"d":1.5})"), "d must be in [0, 1], is 1.5");
  EXPECT_EQ(error("{" + rest + R"(,"f":1})"), "unknown key \"f\" in a request; it may have: F, d, state, id, points");
  EXPECT_EQ(error("{" + rest + R"(,"stat":{}})"), "unknown key \"stat\" in a request, did you mean \"state\"?");
  EXPECT_EQ(error("{" + rest + R"(,"dt":1})").substr(0, 31), "unknown key \"dt\" in a request; ");
  EXPECT_EQ(error(R"({"points":[{)" + rest + R"(},{"F":3}]})"), "points[1].F must be a list of 9 numbers, is 3");
  EXPECT_EQ(error("[1]"), "a request must be an object, is a list of 1");
  EXPECT_EQ(error("{\"F\":").substr(0, 28), "the request is not JSON: par");
  EXPECT_EQ(error("\xff\xfe").substr(0, 24), "the request is not JSON:");
  EXPECT_EQ(error(R"({"F":[1e999,0,0,0,1,0,0,0,1]})").substr(0, 24), "the request is not JSON:");
  EXPECT_EQ(error(std::string(100000, '[')), "the request is nested too deeply");
  EXPECT_EQ(ask(options, R"({"id":{"a":[1]},"F":0})"
                         "\n")[0]["id"],
            (Json{{"a", {1}}}))
      << "an error names its request";
}

TEST_F(JsonStream, EmptyLinesArePassedOver) { EXPECT_TRUE(ask(neo_hookean(), "\n  \n\r\n").empty()); }

TEST_F(JsonStream, OptionsThatDoNotGoWithIt) {
  auto options = neo_hookean();
  options.json = true;
  options.output = "out.csv";
  EXPECT_EQ(run(options).err, "--output: error: does not go with --json, which answers on the standard output");
  options.path = "hydrostatic";
  EXPECT_EQ(run(options).err, "--json: error: cannot be given together with --path");
}

}  // namespace
}  // namespace cleave::testing
