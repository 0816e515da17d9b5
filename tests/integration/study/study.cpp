// `cleave study` from outside: tables and charts, every way a point can end, and going on after an interruption.

#include "program.hpp"

#include <signal.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include <chrono>
#include <cmath>
#include <thread>

namespace cleave::test {
namespace {

constexpr const char* scene = R"toml(
[simulation]
dimension = 2
cell_size = 0.1
end_time = 0.2
frame_rate = 50
gravity = [0, -10]
precision = "double"
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "rubber"
velocity = [1, 0]
sampling = "regular"
shape = { type = "box", size = [0.4, 0.4] }
)toml";

/// Free flight: the velocity is that of the closed form but for rounding, whatever the axes.
constexpr const char* study = R"toml(
title = "Free flight"
scene = "scene.toml"
repetitions = 2
[[axis]]
name = "transfer"
path = "simulation.transfer"
values = ["apic", "pic"]
[[axis]]
name = "step"
path = "simulation.maximum_time_step"
unit = "s"
values = [1e-3, 2e-3, 4e-3]
[error]
title = "velocity"
value = ["momentum_x / mass", "momentum_y / mass"]
formula = ["1 + 1e-3 * step", "-10 * t"]
norm = "maximum"
)toml";

class StudyCommand : public Program {
 protected:
  StudyCommand() {
    write("scene.toml", scene);
    write("study.toml", study);
  }

  nlohmann::json results(const std::string& out = "out") const {
    return nlohmann::json::parse(contents(directory / out / "results.json"));
  }

  /// When the records of runs with both repetitions were written.
  std::map<std::string, fs::file_time_type> records() const {
    std::map<std::string, fs::file_time_type> times;
    if (!fs::is_directory(directory / "out/runs")) return times;
    for (const auto& run : fs::directory_iterator(directory / "out/runs")) {
      const fs::path record = run.path() / "record.json";
      if (fs::exists(record) && nlohmann::json::parse(contents(record)).at("wall_seconds").size() == 2)
        times[run.path().filename().string()] = fs::last_write_time(record);
    }
    return times;
  }
};

bool has_gnuplot() { return std::system("command -v gnuplot >/dev/null 2>&1") == 0; }

TEST_F(StudyCommand, WritesTablesAndAPage) {
  const Outcome run = cleave("study study.toml --out out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto csv = table(directory / "out/results.csv");
  EXPECT_EQ(csv.at("transfer"), (std::vector<std::string>{"apic", "apic", "apic", "pic", "pic", "pic"}));
  EXPECT_EQ(csv.at("step (s)"), (std::vector<std::string>{"0.001", "0.002", "0.004", "0.001", "0.002", "0.004"}));
  EXPECT_EQ(csv.at("repetitions"), std::vector<std::string>(6, "2"));
  const auto errors = numbers(csv.at("error")), steps = numbers(csv.at("steps"));
  for (std::size_t i = 0; i < 6; ++i) {
    // the formula is off by a thousandth of the step; the largest velocity is (1, -2)
    EXPECT_NEAR(errors[i], 1e-3 * std::stod(csv.at("step (s)")[i]) / std::sqrt(5.), 1e-10);
    EXPECT_GE(steps[i], 0.2 / std::stod(csv.at("step (s)")[i]));
  }
  const auto json = results();
  EXPECT_EQ(json.at("points").size(), 6u);
  EXPECT_NEAR(json.at("orders").at("apic").get<double>(), 1, 1e-4);
  EXPECT_FALSE(json.at("machines").empty());
  // on the front is what no other point beats
  for (const auto& a : json.at("points")) {
    const auto median = [](const nlohmann::json& p) {
      return (p.at("wall_seconds")[0].get<double>() + p.at("wall_seconds")[1].get<double>()) / 2;
    };
    bool beaten = false;
    for (const auto& b : json.at("points"))
      beaten = beaten || (median(b) < median(a) && b.at("error").get<double>() <= 1.005 * a.at("error").get<double>());
    EXPECT_EQ(a.at("pareto").get<bool>(), !beaten) << a;
  }
  // the command of a point runs it again
  const std::string command = json.at("points")[0].at("command");
  ASSERT_EQ(command.find("cleave run "), 0u);
  EXPECT_EQ(cleave(command.substr(7) + " --out again --quiet").status, 0);
  const std::string page = contents(directory / "out/report.html");
  for (const char* expected : {"Free flight", "wall time", "cleave run", "transfer"})
    EXPECT_NE(page.find(expected), std::string::npos) << expected;
  for (const char* outside : {"src=", "<link", "href=\"http"}) EXPECT_EQ(page.find(outside), std::string::npos) << outside;
}

TEST_F(StudyCommand, DrawsChartsThatSayWhatTheyShow) {
  if (!has_gnuplot()) GTEST_SKIP() << "gnuplot is not installed";
  ASSERT_EQ(cleave("study study.toml --out out --charts charts").status, 0);
  const std::string svg = contents(directory / "out/speed_accuracy.svg");
  for (const char* expected :
       {"Free flight", "Pareto front", "wall time of the steps (s)", "velocity (largest, relative)", "apic"})
    EXPECT_NE(svg.find(expected), std::string::npos) << expected;
  EXPECT_NE(contents(directory / "out/convergence.svg").find("step (s)"), std::string::npos);
  EXPECT_EQ(contents(directory / "out/speed_accuracy.png").substr(1, 3), "PNG");
  EXPECT_EQ(contents(directory / "charts/study_speed_accuracy.svg"), svg);
  EXPECT_NE(contents(directory / "out/report.html").find("<svg"), std::string::npos);
}

TEST_F(StudyCommand, DoesWithoutGnuplotAndSaysSo) {
  fs::create_directory(directory / "no_programs");
  const Outcome run = cleave("study study.toml --out out", "PATH='" + (directory / "no_programs").string() + "'");
  EXPECT_EQ(run.status, 0) << run.err;
  EXPECT_NE(run.err.find("apt install gnuplot"), std::string::npos) << run.err;
  EXPECT_TRUE(fs::exists(directory / "out/report.html"));
  EXPECT_FALSE(fs::exists(directory / "out/speed_accuracy.svg"));
}

TEST_F(StudyCommand, GoesOnWhereItWasInterrupted) {
  // one point that takes its time, behind others that do not
  write("slow.toml", std::string(study) + "[set]\nsimulation.end_time = 0.2\n");
  std::string text = contents(directory / "slow.toml");
  text.replace(text.find("4e-3]"), 5, "2e-7]");
  write("slow.toml", text);
  const pid_t child = fork();
  if (child == 0) {
    if (chdir(directory.c_str()) != 0 || !freopen("log.txt", "w", stdout)) _exit(1);
    execl(CLEAVE_PROGRAM, CLEAVE_PROGRAM, "study", "slow.toml", "--out", "out", nullptr);
    _exit(1);
  }
  while (records().size() < 2 && kill(child, 0) == 0) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  kill(child, SIGTERM);
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 130);
  const auto before = records();
  ASSERT_LT(before.size(), 6u);
  EXPECT_FALSE(fs::exists(directory / "out/results.csv"));

  // with the points of the other study the directory serves that one, too: what they share is not run again
  const Outcome run = cleave("study study.toml --out out");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_NE(run.out.find(std::to_string(before.size()) + " runs are finished already"), std::string::npos) << run.out;
  const auto after = records();
  EXPECT_EQ(after.size(), 6u);
  for (const auto& [key, time] : before) EXPECT_EQ(after.at(key), time) << "not written again";

  const std::string csv = contents(directory / "out/results.csv");
  const Outcome again = cleave("study study.toml --out out --jobs 2");
  EXPECT_NE(again.out.find("6 runs are finished already"), std::string::npos) << again.out;
  EXPECT_EQ(contents(directory / "out/results.csv"), csv);
  EXPECT_EQ(records(), after);

  // another directory, in which nothing was interrupted: the same but for times
  ASSERT_EQ(cleave("study study.toml --out whole --jobs 2").status, 0);
  const auto whole = table(directory / "whole/results.csv"), resumed = table(directory / "out/results.csv");
  for (const char* column : {"point", "transfer", "step (s)", "outcome", "error", "particles", "steps", "reason"})
    EXPECT_EQ(whole.at(column), resumed.at(column)) << column;
}

TEST_F(StudyCommand, RunsPointsOneByOneAndCollectsThem) {
  EXPECT_EQ(cleave("study study.toml --out out --run 2:3").status, 0);
  EXPECT_EQ(records().size(), 2u);
  EXPECT_FALSE(fs::exists(directory / "out/results.csv"));
  EXPECT_EQ(cleave("study study.toml --out out --collect").status, 0);
  EXPECT_EQ(records().size(), 2u);
  EXPECT_EQ(table(directory / "out/results.csv").at("outcome"),
            (std::vector<std::string>{"not run", "done", "done", "not run", "not run", "not run"}));
  const Outcome list = cleave("study study.toml --out out --dry-run");
  EXPECT_NE(list.out.find("2  transfer apic, step 0.002 s  (done)\n"), std::string::npos) << list.out;
  EXPECT_NE(list.out.find("6  transfer pic, step 0.004 s\n"), std::string::npos) << list.out;
  const Outcome beyond = cleave("study study.toml --out out --run 7");
  EXPECT_EQ(beyond.status, 2);
  EXPECT_NE(beyond.err.find("this study has the runs 1 to 6"), std::string::npos) << beyond.err;
}

TEST_F(StudyCommand, HandsItsRunsToGnuParallelAndCollectsThem) {
  if (std::system("command -v parallel >/dev/null 2>&1") != 0) GTEST_SKIP() << "GNU parallel is not installed";
  ASSERT_EQ(cleave("study study.toml --out out --run 2").status, 0);
  const auto before = records();
  const Outcome run = cleave("study study.toml --out out --jobs parallel");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_EQ(records().size(), 6u);
  for (const auto& [key, time] : before) EXPECT_EQ(records().at(key), time) << "was finished already";
  EXPECT_NE(contents(directory / "out/parallel.sh").find("::: 1 3 4 5 6\n"), std::string::npos);
  EXPECT_EQ(table(directory / "out/results.csv").at("outcome"), std::vector<std::string>(6, "done"));

  // machines of a file; ":" is this one without ssh
  write("machines", "1/:\n");
  ASSERT_EQ(cleave("study study.toml --out other --value step=8e-3 --jobs parallel --sshlogin machines").status, 0);
  EXPECT_EQ(table(directory / "other/results.csv").at("outcome"), std::vector<std::string>(8, "done"));
}

TEST_F(StudyCommand, HandsItsRunsToSlurmAsAnArrayAndCollectsThem) {
  // what sbatch --wait does, one task after the other
  fs::create_directory(directory / "bin");
  write("bin/sbatch", R"sh(#!/bin/bash
[ "$1" = --wait ] && cd "${2#--chdir=}" || exit 9
array=$(sed -n 's/^#SBATCH --array=//p' "$3")
bash -n "$3" || exit 8
for part in ${array//,/ }; do
  for task in $(seq "${part%-*}" "${part#*-}"); do SLURM_ARRAY_TASK_ID=$task sh "$3" > "slurm_$task.txt" || exit 1; done
done
)sh");
  fs::permissions(directory / "bin/sbatch", fs::perms::owner_all);
  const std::string path = "PATH=" + (directory / "bin").string() + ":$PATH ";
  ASSERT_EQ(cleave("study study.toml --out out --run 4").status, 0);
  const Outcome run = cleave("study study.toml --out out --jobs slurm", path);
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_NE(run.out.find("5 runs go to slurm"), std::string::npos) << run.out;
  EXPECT_NE(contents(directory / "out/slurm.sh").find("#SBATCH --array=1-3,5-6\n"), std::string::npos);
  EXPECT_EQ(table(directory / "out/results.csv").at("outcome"), std::vector<std::string>(6, "done"));

  write("bin/sbatch", "#!/bin/sh\necho 'sbatch: error: invalid partition specified'\nexit 1\n");
  const Outcome refused = cleave("study study.toml --out other --jobs slurm", path);
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(refused.err.find("invalid partition specified"), std::string::npos) << refused.err;
  EXPECT_EQ(cleave("study study.toml --out other --jobs condor").status, 2);
  EXPECT_EQ(cleave("study study.toml --out other --jobs slurm --run 2").status, 2);
}

TEST_F(StudyCommand, ComparesColumnsThatOnlySomeRunsWrite) {
  std::string text = contents(directory / "study.toml");
  text.replace(text.find("value = ["), std::string("value = [\"momentum_x / mass\", \"momentum_y / mass\"]").size(),
               "value = \"pieces\"");
  text.replace(text.find("formula = ["), text.find("norm") - text.find("formula = ["), "formula = \"1 + 0 * t\"\n");
  write("pieces.toml", text);
  const Outcome none = cleave("study pieces.toml --out out");
  EXPECT_EQ(none.status, 2);
  EXPECT_NE(none.err.find("has no column 'pieces'"), std::string::npos) << none.err;
  write("scene.toml", std::string(scene).replace(std::string(scene).find("[[body]]"), 0,
                                                 "damage = { plugin = \"rankine\", failure_stress = 1e9, softening = 0.1 }\n"));
  const Outcome whole = cleave("study pieces.toml --out whole");
  ASSERT_EQ(whole.status, 0) << whole.err;
  const auto results = table(directory / "whole/results.csv");
  for (const std::string& error : results.at("error")) EXPECT_EQ(std::stod(error), 0);
}

TEST_F(StudyCommand, TakesEveryEndOfAPointAsAResult) {
  write("ends.toml", R"toml(
scene = "scene.toml"
time_limit = 20
[[axis]]
name = "case"
paths = ["material.rubber.plasticity", "simulation.maximum_time_step", "body.block.spin"]
values = [
  [{ plugin = "failing-flow", limit = 1e3 }, 0, { angular_velocity = 100 }],
  [{ plugin = "failing-flow", limit = 1e-9 }, 0, { angular_velocity = 100 }],
  [{ plugin = "failing-flow", limit = 1e-9, failure = "abort" }, 0, { angular_velocity = 100 }],
  [{ plugin = "failing-flow", limit = -1 }, 0, { angular_velocity = 100 }],
]
labels = ["sound", "gives up", "aborts", "refused"]
[error]
value = "momentum_x / mass"
formula = "1"
)toml");
  const Outcome run = cleave("study ends.toml --out out", "CLEAVE_PLUGIN_PATH='" CLEAVE_FAILING_PLUGINS "'");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto points = results().at("points");
  EXPECT_EQ(points[0].at("outcome"), "done");
  EXPECT_LT(points[0].at("error").get<double>(), 1e-9);
  EXPECT_EQ(points[1].at("outcome"), "failed");
  EXPECT_NE(points[1].at("reason").get<std::string>().find("failing-flow"), std::string::npos) << points[1];
  EXPECT_EQ(points[2].at("outcome"), "failed");
  EXPECT_NE(points[2].at("reason").get<std::string>().find("signal 6"), std::string::npos) << points[2];
  EXPECT_EQ(points[3].at("outcome"), "refused");
  EXPECT_NE(points[3].at("reason").get<std::string>().find("limit"), std::string::npos) << points[3];
  for (int i : {1, 2, 3}) EXPECT_TRUE(points[i].at("error").is_null());
}

TEST_F(StudyCommand, StopsAPointAtItsTimeLimit) {
  write("slow.toml", R"toml(
scene = "scene.toml"
time_limit = 0.3
[[axis]]
name = "step"
path = "simulation.maximum_time_step"
values = [1e-8]
[error]
value = "momentum_x / mass"
formula = "1"
)toml");
  const Outcome run = cleave("study slow.toml --out out");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_EQ(results().at("points")[0].at("outcome"), "timed out");
  EXPECT_EQ(results().at("points")[0].at("reason"), "not finished after 0.3 s");
  EXPECT_NE(cleave("study slow.toml --out out").out.find("1 runs are finished already"), std::string::npos);
}

TEST_F(StudyCommand, ComparesWithAnotherRunParticleByParticleAndAlongProfiles) {
  const std::string axes =
      "scene = \"scene.toml\"\n[[axis]]\nname = \"step\"\npath = \"simulation.maximum_time_step\"\n"
      "values = [2e-3, 1e-3, 5e-4]\n";
  // at t, y = -g t^2/2 (1 + dt/t): symplectic Euler is ahead of the parabola by g t dt/2
  const auto ahead = [](const nlohmann::json& point) { return 10 * 0.2 * 0.2 / point.at("steps").get<double>() / 2; };
  write("points.toml", axes +
                           "[error]\nparticles = true\nvalue = [\"x\", \"y\"]\nrelative = false\nunit = \"m\"\n"
                           "[error.reference]\nat = { step = 5e-4 }\n");
  ASSERT_EQ(cleave("study points.toml --out points").status, 0);
  auto points = results("points").at("points");
  for (int i : {0, 1}) EXPECT_NEAR(points[i].at("error").get<double>(), ahead(points[i]) - ahead(points[2]), 1e-9);
  EXPECT_TRUE(points[2].at("reference").get<bool>());
  EXPECT_TRUE(points[2].at("error").is_null());
  // bodies of other particles can be compared by bins
  write("profile.toml", axes +
                            "[error]\nparticles = true\nvalue = \"y - Y\"\nrelative = false\n"
                            "profile = { along = \"X\", from = -0.2, to = 0.2, bins = 4 }\n"
                            "[error.reference]\nset.simulation.cell_size = 0.05\nset.simulation.maximum_time_step = 5e-4\n");
  ASSERT_EQ(cleave("study profile.toml --out profile").status, 0);
  points = results("profile").at("points");
  for (int i : {0, 1, 2}) EXPECT_NEAR(points[i].at("error").get<double>(), ahead(points[i]) - ahead(points[2]), 1e-9);
  // and with a file
  std::string parabola = "seconds,height\n";
  for (int i = 0; i <= 100; ++i)
    parabola += std::to_string(i * 0.002) + "," + std::to_string(-5e0 * (i * 0.002) * (i * 0.002)) + "\n";
  write("parabola.csv", parabola);
  write("file.toml", axes +
                         "[error]\nvalue = \"center_of_mass_y\"\nfile = \"parabola.csv\"\nfile_at = \"seconds\"\n"
                         "file_columns = \"height\"\nnorm = \"final\"\nrelative = false\n");
  const Outcome file = cleave("study file.toml --out file");
  ASSERT_EQ(file.status, 0) << file.err;
  points = results("file").at("points");
  for (int i : {0, 1, 2}) EXPECT_NEAR(points[i].at("error").get<double>(), ahead(points[i]), 2e-6);
}

TEST_F(StudyCommand, MapsWhereRunsAreStable) {
  // a block that spins is stretched: beyond the time a wave takes through a cell it blows up
  write("map.toml", R"toml(
kind = "stability"
title = "Fixed steps"
scene = "scene.toml"
[set]
simulation.gravity = [0, 0]
simulation.frame_rate = 20
body.block.spin.angular_velocity = 400
[constants]
c = "sqrt(E * 0.7 / (1.3 * 0.4) / 1000)"
[[axis]]
name = "E"
unit = "Pa"
path = "material.rubber.elasticity.youngs_modulus"
values = [1e4, 1e6]
[[axis]]
name = "step"
unit = "s"
path = "simulation.time_step"
range = { from = 5e-4, to = 0.05, count = 9, scale = "logarithmic" }
[stability]
energy = "kinetic_energy + elastic_energy"
tolerance = 0.05
[stability.bound]
value = "0.1 / c"
title = "a cell per wave"
)toml");
  const Outcome run = cleave("study map.toml --out out");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto json = results();
  ASSERT_EQ(json.at("points").size(), 18u);
  EXPECT_EQ(json.at("points")[0].at("outcome"), "stable");
  EXPECT_NE(json.at("points")[17].at("outcome"), "stable");
  EXPECT_FALSE(json.at("points")[17].at("reason").get<std::string>().empty());
  const auto& boundaries = json.at("boundaries");
  ASSERT_EQ(boundaries.size(), 2u);
  EXPECT_NEAR(boundaries[0].at("predicted").get<double>() / boundaries[1].at("predicted").get<double>(), 10, 1e-9);
  EXPECT_EQ(boundaries[1].at("verdict"), "holds") << boundaries;
  if (has_gnuplot()) {
    EXPECT_NE(contents(directory / "out/map.svg").find("a cell per wave"), std::string::npos);
  }

  // the bound that the program itself keeps to
  std::string text = contents(directory / "map.toml");
  text.replace(text.find("value = \"0.1 / c\""), 17,
               "value = \"time_step\"\nset.simulation.time_step = \"auto\"\nset.simulation.cfl = 1");
  write("map.toml", text);
  ASSERT_EQ(cleave("study map.toml --out out").status, 0);
  const auto reported = results().at("boundaries");
  EXPECT_NEAR(reported[1].at("predicted").get<double>(), boundaries[1].at("predicted").get<double>(),
              0.3 * boundaries[1].at("predicted").get<double>());
}

TEST_F(StudyCommand, RefusesNamesThatMeanTwoThings) {
  write("twice.toml", std::string(study) + "[constants]\nmass = 2\n");
  const Outcome column = cleave("study twice.toml --out out");
  EXPECT_EQ(column.status, 2);
  EXPECT_NE(column.err.find("'momentum_x / mass': 'mass' is both an axis or a constant of the study and what a run writes"),
            std::string::npos)
      << column.err;
  EXPECT_FALSE(fs::exists(directory / "out")) << "before anything is run";
  write("unused.toml", std::string(study) + "[constants]\nkinetic_energy = 2\n");
  EXPECT_EQ(cleave("study unused.toml --dry-run").status, 0) << "no formula uses it";
}

TEST_F(StudyCommand, ReportsWhatIsWrongWithItsFile) {
  write("wrong.toml", "scene = \"scene.toml\"\n[[axis]]\nname = \"a\"\nvalues = [1]\n");
  const Outcome run = cleave("study wrong.toml --out out");
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.err.find("wrong.toml:2:1: error: axis 'a' needs 'path'"), std::string::npos) << run.err;
  EXPECT_FALSE(fs::exists(directory / "out"));
}

}  // namespace
}  // namespace cleave::test
