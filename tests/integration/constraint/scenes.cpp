// Constraints in scene files: what `cleave validate` and `cleave run` make of them.

#include "program.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>

namespace cleave::test {
namespace {

class ConstraintScene : public Program {
 protected:
  static constexpr const char* plugins = "CLEAVE_PLUGIN_PATH='" CLEAVE_CONSTRAINT_PLUGINS ":" CLEAVE_FAILING_PLUGINS "'";

  static std::string replaced(std::string text, const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
  }
  /// The scene of the template for authors.
  static std::string hanging() {
    return replaced(contents(fs::path(CLEAVE_SOURCE_DIR) / "sdk/templates/constraint/scene.toml"), "{{id}}", "fixed-length");
  }
  Outcome cleave(const std::string& arguments) const { return Program::cleave(arguments, plugins); }

  /// Lowest point of a body.
  double bottom(const std::string& frame, int body) const {
    const std::string text = contents(directory / "run/ply" / frame);
    std::istringstream in(text);
    std::string line, type, kind, name;
    std::size_t count = 0, size = 0, y = 0, body_at = 0;
    while (std::getline(in, line) && line != "end_header") {
      std::istringstream words(line);
      words >> kind >> type >> name;
      if (kind == "element") count = std::stoul(name);
      if (kind != "property") continue;
      if (name == "y") y = size;
      if (name == "body") body_at = size;
      size += type == "double" ? 8 : type == "uchar" ? 1 : 4;
    }
    double lowest = 1e9;
    for (std::size_t i = 0; i < count; i++) {
      const char* vertex = text.data() + std::size_t(in.tellg()) + i * size;
      float at = 0;
      std::int32_t of = 0;
      std::memcpy(&at, vertex + y, 4);
      std::memcpy(&of, vertex + body_at, 4);
      if (of == body) lowest = std::min(lowest, double(at));
    }
    return lowest;
  }
};

TEST_F(ConstraintScene, OfTheTemplateShowsWhatTheLawDoes) {
  write("scene.toml", hanging());
  const Outcome valid = cleave("validate scene.toml");
  EXPECT_EQ(valid.status, 0) << valid.err;
  EXPECT_NE(valid.out.find("constraint/fixed-length"), std::string::npos) << valid.out;
  const Outcome run = cleave(
      "run scene.toml --out run --set 'output.formats=[\"ply\"]' --set 'simulation.end_time=0.4' --set "
      "simulation.cell_size=0.1");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto summary = json(directory / "run/summary.json");
  EXPECT_GT(summary.get<double>("stage_seconds.constraint"), 0);
  const auto plugins_used = contents(directory / "run/summary.json");
  EXPECT_NE(plugins_used.find("constraint/fixed-length"), std::string::npos);
  const auto frames = table(directory / "run/frames.csv");
  const auto iterations = numbers(frames.at("constraint_iterations")), residual = numbers(frames.at("constraint_residual"));
  EXPECT_EQ(iterations[0], 0);
  for (std::size_t i = 1; i < iterations.size(); i++) {
    EXPECT_GT(iterations[i], 0);
    EXPECT_LE(residual[i], 1.01e-3);
    EXPECT_GT(residual[i], 1e-6);
  }
  double fibrous = 0, plain = 0;
  for (std::size_t i = 0; i < iterations.size(); i++) {
    char name[32];
    std::snprintf(name, sizeof name, "frame_%04zu.ply", i);
    fibrous = std::min(fibrous, bottom(name, 0));
    plain = std::min(plain, bottom(name, 1));
  }
  EXPECT_GT(fibrous, -0.85);
  EXPECT_LT(plain, -1.0);

  // the scene that is written back is the same
  const Outcome again = cleave("run run/scene.toml --out again --quiet");
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(table(directory / "again/frames.csv").at("elastic_energy"), frames.at("elastic_energy"));
}

TEST_F(ConstraintScene, NeedsTheFibersThatTheLawReads) {
  write("scene.toml", replaced(hanging(), "fibers = { direction = [0, 1, 0] }\n", ""));
  const Outcome run = cleave("validate scene.toml");
  EXPECT_NE(run.status, 0);
  EXPECT_NE(run.err.find("'constraint/fixed-length' needs the direction of the fibers"), std::string::npos) << run.err;
}

TEST_F(ConstraintScene, StoresTheDeformationGradient) {
  write("scene.toml", hanging());
  EXPECT_EQ(cleave("validate scene.toml --set 'output.attributes=[\"F\"]'").status, 0);
  const Outcome both = cleave(
      "validate scene.toml --set material.plain.constraint.plugin=fixed-length --set "
      "'material.plain.fibers.direction=[1,0,0]' --set 'output.attributes=[\"b\"]'");
  EXPECT_NE(both.status, 0);
  EXPECT_NE(both.err.find("unknown name \"b\""), std::string::npos) << both.err;
}

TEST_F(ConstraintScene, CannotBeOfALawThatDoesNotTakeF) {
  write("scene.toml", replaced(hanging(), "{ plugin = \"split-neo-hookean\", youngs_modulus = 3e4, poissons_ratio = 0.3 }",
                               "{ plugin = \"careless\", stiffness = 1e5, limit = 1 }"));
  const Outcome run = cleave("run scene.toml --out run --set simulation.precision=double --set simulation.time_step=1e-3");
  EXPECT_EQ(run.status, 2) << run.err;
  EXPECT_NE(run.err.find("elasticity/careless accepts only b, but constraint/fixed-length needs F"), std::string::npos)
      << run.err;
}

TEST_F(ConstraintScene, ThatFailsEndsTheRunNamingThePlugin) {
  const std::string law = "{ plugin = \"witness\", mass = 72, rest_volume = 1e-3, act = \"give-up\" }";
  write("scene.toml", replaced(hanging(), "{ plugin = \"fixed-length\", tolerance = 1e-3 }", law));
  const Outcome run = cleave("run scene.toml --out run --quiet --steps 5");
  EXPECT_EQ(run.status, 3) << run.err;
  EXPECT_NE(run.err.find("step 0 at t = 0 s"), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("constraint: plugin constraint/witness 1.0.0 failed: witness: the mass is 36"), std::string::npos)
      << run.err;
  EXPECT_TRUE(fs::exists(directory / "run/failure.txt"));
}

}  // namespace
}  // namespace cleave::test
