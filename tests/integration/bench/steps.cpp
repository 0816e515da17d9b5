#include "../../sanitized.hpp"
#include "program.hpp"

#include <numeric>
#include <set>

// `cleave bench steps` and `--isa`, through the program: what is reported and that it is consistent, never how fast it is.

namespace cleave::test {
namespace {

using boost::property_tree::ptree;
using Path = ptree::path_type;

class BenchSteps : public Program {
 protected:
  /// Small and short; the results as JSON.
  ptree measure(const std::string& arguments, int steps = 2) const {
    const Outcome outcome =
        cleave("bench steps --steps " + std::to_string(steps) + " --repeats 3 --json steps.json " + arguments);
    EXPECT_EQ(outcome.status, 0) << arguments << "\n" << outcome.err;
    return outcome.status == 0 ? json(directory / "steps.json") : ptree();
  }

  static std::map<std::string, double> numbers_of(const ptree& tree) {
    std::map<std::string, double> numbers;
    for (const auto& [name, value] : tree) numbers[name] = value.get_value<double>();
    return numbers;
  }

  static std::set<std::string> laws_of(const ptree& result) {
    std::set<std::string> laws;
    for (const auto& law : result.get_child("laws")) laws.insert(law.first);
    return laws;
  }

  fs::path scene(const std::string& material, const std::string& simulation = "") const {
    return write("scene.toml", "[simulation]\ncell_size = 0.1\nend_time = 1\n" + simulation +
                                   "[[material]]\nname = \"m\"\ndensity = 1000\n" + material +
                                   "[[body]]\nname = \"b\"\nmaterial = \"m\"\n"
                                   "shape = { type = \"box\", size = [0.5, 0.5, 0.5] }\n");
  }

  bool processor_has(const std::string& level) const { return cleave("plugins", "CLEAVE_ISA=" + level).status == 0; }
};

constexpr const char* rubber = R"(
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
)";

constexpr const char* flesh = R"(
elasticity = { plugin = "qr", youngs_modulus = 1e5, poissons_ratio = 0.3, fiber_scale = 10.0 }
fibers = { direction = [1, 0, 0] }
)";

TEST_F(BenchSteps, StagesAreWithinTheStepTheyArePartOf) {
  const ptree json = measure("--materials elasticity/split-neo-hookean,plasticity/von-mises --particles 1000 --threads 1,2");
  ASSERT_EQ(json.get_child("results").size(), 6u);
  for (const auto& [key, result] : json.get_child("results")) {
    const double median = result.get<double>("median_ns");
    double stages = 0;
    for (const auto& [name, nanoseconds] : numbers_of(result.get_child("stages_ns"))) {
      EXPECT_GE(nanoseconds, 0) << name;
      stages += nanoseconds;
    }
    EXPECT_GT(result.get<double>("stages_ns.particles to grid"), 0);
    EXPECT_GT(result.get<double>("stages_ns.grid to particles"), 0);
    EXPECT_LE(stages, median);
    EXPECT_LE(result.get<double>("fastest_ns"), median);
    EXPECT_NEAR(result.get<double>("particle_steps_per_second") * median, 1e9, 1);
  }
}

TEST_F(BenchSteps, EveryCombinationThatIsAskedForIsMeasured) {
  const ptree json = measure(
      "--materials elasticity/split-neo-hookean,elasticity/split-neo-hookean+plasticity/von-mises --particles 500,1000 "
      "--threads 1,2 --precision single,double --dimension 2");
  EXPECT_EQ(json.get<int>("dimension"), 2);
  EXPECT_EQ(json.get<int>("steps"), 2);
  EXPECT_EQ(json.get<int>("repeats"), 3);
  EXPECT_FALSE(json.get_optional<double>("peak_memory_bytes")) << "of which of them?";
  std::set<std::string> combinations;
  for (const auto& [key, result] : json.get_child("results")) {
    const auto particles = result.get<double>("particles");
    const double asked = particles < 700 ? 500 : 1000;
    EXPECT_NEAR(particles, asked, 0.1 * asked);
    combinations.insert(result.get<std::string>("material") + " " + std::to_string(int(asked)) + " " +
                        result.get<std::string>("threads") + " " + result.get<std::string>("precision"));
  }
  EXPECT_EQ(json.get_child("results").size(), 24u);
  EXPECT_EQ(combinations.size(), 24u);
  EXPECT_TRUE(combinations.contains("elasticity/split-neo-hookean + plasticity/von-mises 500 2 double"));
}

TEST_F(BenchSteps, ThreeTenthsYieldWhereABlockFlows) {
  const ptree json = measure("--materials plasticity/von-mises --particles 40000 --precision single,double --threads 2");
  int flowing = 0;
  for (const auto& [key, result] : json.get_child("results")) {
    const auto yielding = result.get_optional<double>("yielding_fraction");
    ASSERT_EQ(yielding.has_value(), result.get<std::string>("material").ends_with(", yielding"));
    if (!yielding) continue;
    EXPECT_GT(*yielding, 0.15);  // the rest of that block has come to rest at its faces
    EXPECT_LE(*yielding, 0.31);
    flowing++;
  }
  EXPECT_EQ(flowing, 2);
}

TEST_F(BenchSteps, AConstraintIsMeasuredWithWhatItsSolverDoes) {
  const ptree json = measure("--materials constraint/incompressibility --particles 2000 --threads 2");
  ASSERT_EQ(json.get_child("results").size(), 1u);
  const ptree& result = json.get_child("results").front().second;
  EXPECT_GE(result.get<double>("constraint_iterations"), 1);
  EXPECT_LE(result.get<double>("constraint_residual"), 1e-5);
  EXPECT_NEAR(result.get<double>("seconds_per_step"), 1e-9 * result.get<double>("median_ns") * result.get<double>("particles"),
              1e-12);
  EXPECT_EQ(laws_of(result).count("constraint/incompressibility"), 1u);
}

TEST_F(BenchSteps, EveryLawIsMeasuredOnAnElasticLawThatSuitsIt) {
  const ptree json = measure("--materials all --particles 500 --threads 1 --set plasticity/von-mises.yield_stress=123");
  std::set<std::string> measured, alone;
  for (const auto& [key, result] : json.get_child("results")) {
    const auto laws = laws_of(result);
    measured.insert(laws.begin(), laws.end());
    if (laws.size() == 1) alone.insert(*laws.begin());
    if (laws.contains("plasticity/von-mises")) {
      EXPECT_EQ(result.get<double>(Path("laws|plasticity/von-mises|yield_stress", '|')), 123);
    }
  }
  ASSERT_EQ(cleave("plugins --json").status, 0);
  const ptree listed = BenchSteps::json(directory / "stdout.txt");
  for (const auto& [key, plugin] : listed.get_child("plugins")) {
    const auto id = plugin.get<std::string>("id");
    if (id.starts_with("elasticity/")) {
      EXPECT_TRUE(alone.contains(id)) << id;
    }
    if (id.starts_with("plasticity/") || id.starts_with("damage/")) {
      EXPECT_TRUE(measured.contains(id)) << id;
    }
  }
  EXPECT_TRUE(json.get_child("skipped").empty());
}

TEST_F(BenchSteps, BlocksMoveSoThatParticlesAreSorted) {
  const ptree json = measure("--materials elasticity/qr --particles 1000 --threads 1", 45);
  ASSERT_EQ(json.get_child("results").size(), 2u) << "without and with fibres";
  for (const auto& [key, result] : json.get_child("results"))
    EXPECT_GT(result.get<double>("stages_ns.sort"), 0) << result.get<std::string>("material");
}

TEST_F(BenchSteps, BytesPerParticleAreThoseThatARunPrints) {
  for (const auto& [material, block] : {std::pair(rubber, "--materials elasticity/split-neo-hookean"),
                                        std::pair(flesh, "--materials elasticity/qr --set elasticity/qr.fiber_scale=10")}) {
    scene(material);
    ASSERT_EQ(cleave("run scene.toml --steps 1 --quiet --out run").status, 0) << contents(directory / "stderr.txt");
    const auto of_run = numbers_of(json(directory / "run/summary.json").get_child("bytes_per_particle"));
    for (const std::string& measured : {std::string("scene.toml"), "--particles 500 " + std::string(block)}) {
      const ptree json = measure(measured + " --threads 1");
      ASSERT_EQ(json.get_child("results").size(), 1u) << measured;
      EXPECT_EQ(numbers_of(json.get_child("results").front().second.get_child("bytes_per_particle")), of_run) << measured;
    }
  }
}

TEST_F(BenchSteps, AScenesStepsAreMeasuredAsTheSceneSays) {
  scene(rubber, "precision = \"double\"\n");
  const ptree json = measure("scene.toml --threads 1 --set simulation.cell_size=0.05");
  const auto& result = json.get_child("results").front().second;
  EXPECT_EQ(json.get_child("results").size(), 1u);
  EXPECT_EQ(result.get<std::string>("material"), "scene");
  EXPECT_EQ(result.get<std::string>("precision"), "double");
  EXPECT_EQ(result.get<int>("particles"), 8000);
  EXPECT_EQ(laws_of(result), std::set<std::string>{"elasticity/split-neo-hookean"});
  EXPECT_GT(json.get<double>("peak_memory_bytes"), 8000 * result.get<double>("bytes_per_particle.total"));

  const ptree both = measure("scene.toml --threads 1 --precision single,double");
  ASSERT_EQ(both.get_child("results").size(), 2u);
  const auto &single = both.get_child("results").front().second, &doubled = both.get_child("results").back().second;
  EXPECT_EQ(single.get<std::string>("precision"), "single");
  EXPECT_EQ(doubled.get<double>("bytes_per_particle.velocity"), 2 * single.get<double>("bytes_per_particle.velocity"));
}

TEST_F(BenchSteps, TableMarkdownAndChartShowTheSameMaterials) {
  const std::string blocks = "bench steps --materials elasticity/qr --particles 500,1000 --threads 1 --steps 1 --repeats 1 ";
  const Outcome table = cleave(blocks);
  EXPECT_EQ(table.status, 0) << table.err;
  EXPECT_NE(table.out.find("\nelasticity/qr with fibres  "), std::string::npos) << table.out;
  const Outcome markdown = cleave(blocks + "--markdown");
  EXPECT_NE(markdown.out.find("\n| material | particles | precision | threads | Mp/s | ns | bytes |"), std::string::npos);
  EXPECT_NE(markdown.out.find("\n| elasticity/qr with fibres | "), std::string::npos) << markdown.out;
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "no gnuplot here to draw the chart";
  EXPECT_EQ(cleave(blocks + "--chart chart.svg").status, 0);
  const std::string svg = contents(directory / "chart.svg");
  EXPECT_NE(svg.find("elasticity/qr with fibres, single"), std::string::npos);
  EXPECT_NE(svg.find(">particles<"), std::string::npos);
  EXPECT_EQ(svg.find(">threads<"), std::string::npos) << "one number of threads is no axis";
}

TEST_F(BenchSteps, BadInputIsRefusedWithWhatWouldBeRight) {
  scene(rubber);
  const auto refused = [&](const std::string& arguments, const std::string& message) {
    const Outcome outcome = cleave("bench steps " + arguments);
    EXPECT_EQ(outcome.status, 2) << arguments;
    EXPECT_EQ(outcome.out, "") << arguments;
    EXPECT_NE(outcome.err.find(message), std::string::npos) << arguments << "\n" << outcome.err;
  };
  refused("scene.toml --particles 1000", "--particles: error: is for blocks; a scene says so itself");
  refused("scene.toml --dimension 2", "--dimension: error: is for blocks");
  refused("missing.toml", "missing.toml: error: there is no such file");
  refused("scene.toml --set simulation.cel_size=1", "did you mean 'cell_size'?");
  refused("--particles 10", "not in range 100 to 1000000000");
  refused("--threads 1,0", "not in range 1 to 1024");
  refused("--precision half", "half not in {single,double}");
  refused("--steps 0", "not in range 1 to");
  refused("--materials elasticity/q", "--materials elasticity/q: error: there is no plugin \"elasticity/q\", did you mean");
  refused("--materials elasticity/qr+", "expected an ID, or IDs joined by +");
  refused("--materials elasticity/qr,all", "\"all\" stands alone");
  refused("--materials elasticity/qr+elasticity/split-neo-hookean",
          "two laws of elasticity; materials are separated by commas");
  refused("--materials elasticity/fixed-corotated+plasticity/nacc",
          "does not offer what it needs, elasticity/split-neo-hookean");
  refused("--set elasticity/qr.fibre_scale=1", "did you mean \"fiber_scale\"?");
  refused("--set elasticity/q.fiber_scale=1", "did you mean \"elasticity/qr\"?");
  refused("--chart steps.png", "the chart is an .svg file");
  refused("--threads 1 --chart steps.svg", "");
}

TEST_F(BenchSteps, TheInstructionSetCanBeNamedAnywhereOnTheCommandLine) {
  const std::string rest =
      " --materials elasticity/split-neo-hookean --particles 500 --threads 1 --steps 1 --repeats 1 --json s";
  const auto isa = [&](const std::string& command, const std::string& before = "") {
    const Outcome outcome = cleave(command, before);
    EXPECT_EQ(outcome.status, 0) << command << "\n" << outcome.err;
    return json(directory / "s").get<std::string>("isa");
  };
  EXPECT_EQ(isa("--isa x86-64-v2 bench steps" + rest), "baseline");
  EXPECT_EQ(isa("bench --isa x86-64-v2 steps" + rest), "baseline");
  EXPECT_EQ(isa("bench steps --isa x86-64-v2" + rest), "baseline");
  if (sanitized) GTEST_SKIP() << "built for one instruction set";
  if (!processor_has("x86-64-v3")) GTEST_SKIP() << "this processor has no AVX2";
  EXPECT_EQ(isa("bench steps --isa x86-64-v3" + rest), "x86-64-v3");
  EXPECT_EQ(isa("bench steps --isa x86-64-v3" + rest, "CLEAVE_ISA=x86-64-v2"), "x86-64-v3") << "what is said last holds";

  scene(rubber);
  ASSERT_EQ(cleave("run scene.toml --isa x86-64-v3 --steps 1 --out run").status, 0);
  EXPECT_NE(contents(directory / "stdout.txt").find("x86-64-v3 kernels"), std::string::npos);
  const ptree summary = json(directory / "run/summary.json");
  EXPECT_EQ(summary.get<std::string>("isa"), "x86-64-v3");
  const fs::path plugin = summary.get_child("plugins").front().second.get<std::string>("path");
  EXPECT_EQ(plugin.parent_path().filename(), "x86-64-v3");
}

TEST_F(BenchSteps, ChecksAreMadeOfTheBuildForTheInstructionSetThatIsNamed) {
  if (sanitized) GTEST_SKIP() << "built for one instruction set";
  if (!processor_has("x86-64-v3")) GTEST_SKIP() << "this processor has no AVX2";
  const std::string check = "check elasticity/qr --only abi.loads";
  EXPECT_EQ(cleave(check).out.find("x86-64-v3"), std::string::npos);
  const Outcome outcome = cleave(check + " --isa x86-64-v3");
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("/x86-64-v3/qr.so"), std::string::npos) << outcome.out;
}

TEST_F(BenchSteps, AnInstructionSetThatDoesNotExistIsRefusedByEveryCommand) {
  for (const char* command : {"run scene.toml", "bench steps", "bench kernels", "point elasticity/qr", "check --list"}) {
    const Outcome outcome = cleave(std::string(command) + " --isa avx512");
    EXPECT_EQ(outcome.status, 2) << command;
    EXPECT_EQ(outcome.err, "--isa avx512: must be x86-64-v2, x86-64-v3 or x86-64-v4\n") << command;
  }
}

TEST_F(BenchSteps, AnInstructionSetThatTheProcessorLacksIsRefused) {
  if (processor_has("x86-64-v4")) GTEST_SKIP() << "this processor has every level there is";
  const Outcome outcome = cleave("--isa x86-64-v4 bench steps");
  EXPECT_EQ(outcome.status, 2);
  EXPECT_NE(outcome.err.find("--isa x86-64-v4: this processor supports at most"), std::string::npos) << outcome.err;
}

}  // namespace
}  // namespace cleave::test
