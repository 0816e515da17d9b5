// A law that fails in a run leaves the points it failed on, and does the same with them outside the run.

#include "program.hpp"

#include <nlohmann/json.hpp>

#include <Eigen/LU>
#include <algorithm>
#include <csignal>

namespace cleave::test {
namespace {

using Json = nlohmann::json;

class FailedBatch : public Program {
 protected:
  static constexpr const char* plugins = "CLEAVE_PLUGIN_PATH='" CLEAVE_FAILING_PLUGINS "'";

  /// A block that hits the ground.
  fs::path scene(int dimension, const std::string& precision, const std::string& laws) const {
    const bool flat = dimension == 2;
    return write("scene.toml",
                 "[simulation]\ndimension = " + std::string(flat ? "2" : "3") + "\nprecision = \"" + precision +
                     "\"\ncell_size = 0.1\nend_time = 0.5\nframe_rate = 20\ntime_step = 5e-4\n" +
                     "[[material]]\nname = \"clay\"\ndensity = 1000\n" + laws +
                     "[[body]]\nname = \"block\"\nmaterial = \"clay\"\nshape = { type = \"box\", center = " +
                     (flat ? "[0, 0.4]" : "[0, 0.4, 0]") + ", size = " + (flat ? "[0.6, 0.6]" : "[0.6, 0.6, 0.4]") +
                     " }\nvelocity = " + (flat ? "[0, -3]" : "[0, -3, 0]") +
                     "\n[[collider]]\nshape = { type = \"half-space\", point = " + (flat ? "[0, 0]" : "[0, 0, 0]") +
                     ", normal = " + (flat ? "[0, 1]" : "[0, 1, 0]") + " }\n[output]\nformats = [\"ply\"]\n");
  }
  Outcome run(const std::string& more = "") const { return cleave("run scene.toml --out run --quiet " + more, plugins); }
  Outcome replay(const std::string& file = "run/failed_batch.json") const {
    return cleave("point --replay " + file + " --output again.csv", plugins);
  }
  Json batch() const { return Json::parse(contents(directory / "run/failed_batch.json")); }

  /// Replays, and compares with what the run wrote: the status of every point, and every number of the field.
  void expect_the_same_again(const std::string& field, const std::vector<std::string>& columns) const {
    const Outcome again = replay();
    EXPECT_EQ(again.status, 3) << again.err;
    EXPECT_NE(again.err.find("those of the run, to the bit"), std::string::npos) << again.err;
    const Json then = batch();
    const bool single = then["precision"] == "single";
    const auto now = table(directory / "again.csv");
    EXPECT_EQ(now.at("status"), then["status"].get<std::vector<std::string>>());
    for (std::size_t c = 0; c < columns.size(); c++) {
      const auto values = numbers(now.at(columns[c]));
      for (std::size_t k = 0; k < values.size(); k++) {
        const Json& value = then["outputs"][field][c][k];
        if (value.is_string())
          EXPECT_FALSE(std::isfinite(values[k])) << columns[c];
        else
          EXPECT_EQ(single ? float(values[k]) : values[k], single ? value.get<float>() : value.get<double>())
              << columns[c] << " of point " << k;
      }
    }
  }
};

const std::string neo_hookean = "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }\n";
const std::string flow = neo_hookean + "plasticity = { plugin = \"failing-flow\", limit = 0.006 }\n";

class FailingFlow : public FailedBatch, public testing::WithParamInterface<std::pair<int, const char*>> {};

TEST_P(FailingFlow, IsShownItsTrialStatesAgainThoughTheyAreOverwritten) {
  const auto [dimension, precision] = GetParam();
  scene(dimension, precision, flow);
  const Outcome failed = run();
  ASSERT_EQ(failed.status, 3) << failed.err;
  EXPECT_NE(failed.err.find("plasticity/failing-flow"), std::string::npos) << failed.err;
  EXPECT_NE(failed.err.find("cleave point --replay run/failed_batch.json"), std::string::npos) << failed.err;
  const Json then = batch();
  EXPECT_EQ(then["failed"], "plasticity/failing-flow");
  EXPECT_EQ(then["laws"][1]["parameters"], (Json{{"limit", 0.006}}));
  EXPECT_EQ(then["time_step"], 5e-4);
  // the status says of each point whether the strain that is kept is beyond the limit: it is the trial state, not the result
  const auto& b = then["inputs"]["b"];
  const std::size_t points = then["points"];
  ASSERT_EQ(then["particles"].size(), points);
  int beyond = 0;
  for (std::size_t k = 0; k < points; k++) {
    double mean = 0, norm = 0;
    for (int i = 0; i < 3; i++) mean += b[i][k].get<double>() / 3;
    for (int i = 0; i < 6; i++) norm += (i < 3 ? 1 : 2) * std::pow(b[i][k].get<double>() - (i < 3 ? mean : 0), 2);
    EXPECT_EQ(then["status"][k], std::sqrt(norm) > 0.006 ? "retry" : "ok") << "point " << k;
    beyond += std::sqrt(norm) > 0.006;
    EXPECT_EQ(then["outputs"]["state_out"][0][k].get<double>(), then["inputs"]["state"][0][k].get<double>() + 1);
  }
  EXPECT_GT(beyond, 0);
  const std::string particle =
      "particle " +
      std::to_string(
          then["particles"][static_cast<std::size_t>(std::find(then["status"].begin(), then["status"].end(), "retry") -
                                                     then["status"].begin())]
              .get<int>());
  EXPECT_NE(failed.err.find(particle + " "), std::string::npos) << "the point the run names is among them: " << failed.err;
  expect_the_same_again("b_out", {"b_out_xx", "b_out_yy", "b_out_zz", "b_out_xy", "b_out_xz", "b_out_yz"});
}
INSTANTIATE_TEST_SUITE_P(All, FailingFlow,
                         testing::Values(std::pair(2, "single"), std::pair(2, "double"), std::pair(3, "single"),
                                         std::pair(3, "double")),
                         [](const auto& info) {
                           return std::to_string(info.param.first) + "d_" + std::string(info.param.second);
                         });

TEST_F(FailedBatch, IsTheSameWithAnyNumberOfThreads) {
  scene(3, "single", flow);
  ASSERT_EQ(run("--threads 1").status, 3);
  const std::string one = contents(directory / "run/failed_batch.json");
  ASSERT_NE(one, "");
  fs::remove_all(directory / "run");
  ASSERT_EQ(run("--threads 4").status, 3);
  EXPECT_EQ(contents(directory / "run/failed_batch.json"), one);
}

TEST_F(FailedBatch, OfADamageLawHasTheHistoryBeforeTheCall) {
  scene(2, "double", neo_hookean + "damage = { plugin = \"failing-damage\", threshold = 200 }\n");
  const Outcome failed = run();
  ASSERT_EQ(failed.status, 3) << failed.err;
  const Json then = batch();
  EXPECT_EQ(then["failed"], "damage/failing-damage");
  const auto& D = then["outputs"]["driving_force"][0];
  for (std::size_t k = 0; k < then["points"]; k++) {
    const double energy = then["inputs"]["tensile_energy"][0][k], history = then["inputs"]["state"][0][k];
    EXPECT_LT(history, 1) << "beyond, the law would have failed before";
    const double wanted = std::max(history, energy / 200);
    EXPECT_EQ(then["status"][k], wanted < 1 ? "ok" : "fatal");
    if (wanted < 1) {
      EXPECT_NEAR(D[k].get<double>(), wanted, 1e-15 * wanted);
    }
  }
  expect_the_same_again("driving_force", {"driving_force"});
}

TEST_F(FailedBatch, OfALawThatGivesNoNumbersAndSaysNothing) {
  scene(2, "double", "elasticity = { plugin = \"careless\", stiffness = 1e5, limit = 0.01 }\n");
  const Outcome failed = run();
  ASSERT_EQ(failed.status, 3) << failed.err;
  EXPECT_NE(failed.err.find("elasticity/careless 1.0.0 gives numbers that are not finite"), std::string::npos) << failed.err;
  const Json then = batch();
  for (std::size_t k = 0; k < then["points"]; k++) {
    double trace = 0;
    for (int i = 0; i < 3; i++) trace += then["inputs"]["b"][i][k].get<double>();
    EXPECT_EQ(then["status"][k], trace > 3.01 ? "fatal" : "ok");
    EXPECT_EQ(then["outputs"]["tau"][0][k].is_string(), trace > 3.01);
  }
  expect_the_same_again("tau", {"tau_xx", "tau_yy", "tau_zz", "tau_xy"});
}

TEST_F(FailedBatch, OfALawThatCrashes) {
  scene(3, "single", neo_hookean + "plasticity = { plugin = \"failing-flow\", limit = 0.006, failure = \"abort\" }\n");
  const Outcome crashed = run();
  EXPECT_EQ(crashed.status, 128 + SIGABRT) << crashed.err;
  EXPECT_NE(crashed.err.find("cleave point --replay run/failed_batch.json"), std::string::npos) << crashed.err;
  const Json then = batch();
  EXPECT_EQ(then["reason"], "SIGABRT");
  EXPECT_FALSE(then.contains("status"));
  EXPECT_EQ(then["inputs"]["b"].size(), 6u);
  EXPECT_EQ(replay().status, 128 + SIGABRT) << "the same points crash it again";
  // what the points do to the law when it only says so
  std::string text = contents(directory / "run/failed_batch.json");
  text.replace(text.find("\"abort\""), 7, "\"retry\"");
  write("mended.json", text);
  EXPECT_EQ(replay("mended.json").status, 3);
  const auto status = table(directory / "again.csv").at("status");
  EXPECT_GT(std::count(status.begin(), status.end(), "retry"), 0);
}

/// A block so fast that the ground turns it inside out wherever an implicit step starts from.
TEST_F(FailedBatch, OfAnImplicitStepHasTheStrainsThatWereTried) {
  for (const int dimension : {2, 3}) {
    scene(dimension, dimension == 2 ? "single" : "double", neo_hookean);
    const Outcome failed =
        run("--set simulation.integrator=implicit --set simulation.time_step=0.04 --set " +
            std::string(dimension == 2 ? "'body.block.velocity=[0, -1e4]'" : "'body.block.velocity=[0, -1e4, 0]'"));
    ASSERT_EQ(failed.status, 3) << failed.err;
    EXPECT_NE(failed.err.find("implicit step: no velocities to start from"), std::string::npos) << failed.err;
    EXPECT_NE(failed.err.find("cleave point --replay run/failed_batch.json"), std::string::npos) << failed.err;
    const Json then = batch();
    EXPECT_EQ(then["failed"], "elasticity/split-neo-hookean");
    const auto& F = then["inputs"]["F"];
    int inside_out = 0;
    for (std::size_t k = 0; k < then["points"]; k++) {
      Eigen::Matrix3d tried;
      for (int i = 0; i < 9; i++) tried(i / 3, i % 3) = F[std::size_t(i)][k].get<double>();
      EXPECT_EQ(then["status"][k], tried.determinant() > 0 ? "ok" : "fatal") << "point " << k;
      inside_out += tried.determinant() <= 0;
    }
    EXPECT_GT(inside_out, 0);
    expect_the_same_again("P", {"P00", "P01", "P02", "P10", "P11", "P12", "P20", "P21", "P22"});
    fs::remove_all(directory / "run");
  }
}

TEST_F(FailedBatch, SaysWhatHasChangedSinceTheRun) {
  scene(2, "double", flow);
  ASSERT_EQ(run().status, 3);
  const std::string text = contents(directory / "run/failed_batch.json");
  const auto changed = [&](const std::string& what, const std::string& with) {
    std::string other = text;
    const auto at = other.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    other.replace(at, what.size(), with);
    write("changed.json", other);
    return replay("changed.json");
  };
  const std::string version = batch()["laws"][1]["version"];
  const Outcome other_version = changed("\"id\": \"plasticity/failing-flow\",\n      \"version\": \"" + version,
                                        "\"id\": \"plasticity/failing-flow\",\n      \"version\": \"0.0.7");
  EXPECT_NE(other_version.err.find("is version " + version + " here, and was 0.0.7 in the run"), std::string::npos)
      << other_version.err;
  const Outcome mended = changed("\"limit\": 0.006", "\"limit\": 5.0");
  EXPECT_EQ(mended.status, 0) << "with another parameter it does not fail";
  EXPECT_NE(mended.err.find("points fails; status or results differ from those of the run"), std::string::npos) << mended.err;
}

TEST_F(FailedBatch, DoesNotOutliveTheRunItIsOf) {
  scene(2, "double", flow);
  ASSERT_EQ(run().status, 3);
  ASSERT_TRUE(fs::exists(directory / "run/failed_batch.json"));
  // a step so large that the block turns inside out, which no law fails at
  scene(2, "double", neo_hookean);
  const Outcome failed = run("--set simulation.time_step=0.04");
  ASSERT_EQ(failed.status, 3) << failed.err;
  EXPECT_EQ(failed.err.find("--replay"), std::string::npos) << failed.err;
  EXPECT_TRUE(fs::exists(directory / "run/failed_state.csv"));
  EXPECT_FALSE(fs::exists(directory / "run/failed_batch.json"));
}

TEST_F(FailedBatch, ThatCannotBeReadIsRefused) {
  EXPECT_EQ(cleave("point --replay none.json").err, "none.json: error: cannot be read; is there such a file?\n");
  write("other.json", "{}");
  const Outcome other = cleave("point --replay other.json");
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("other.json: error: is not the batch of a law that failed"), std::string::npos) << other.err;
  EXPECT_EQ(cleave("point --replay other.json --elasticity qr").status, 2);
}

}  // namespace
}  // namespace cleave::test
