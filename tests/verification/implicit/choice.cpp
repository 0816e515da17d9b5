// integrator = "auto": which steps it takes in scenes whose cheaper integrator is beyond doubt, and that choosing leaves no
// trace.

#include "mpm/integrator_choice.hpp"
#include "scenes.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <sstream>

namespace cleave::test {
namespace {

using config::Integrator;
using ::testing::HasSubstr;

/// What is said while it exists.
class Said {
 public:
  Said() {
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("said", std::make_shared<spdlog::sinks::ostream_sink_mt>(text_)));
  }
  ~Said() { spdlog::set_default_logger(before_); }
  std::string text() const { return text_.str(); }
  std::ptrdiff_t lines() const {
    const std::string all = text();
    return std::count(all.begin(), all.end(), '\n');
  }

 private:
  std::ostringstream text_;
  std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
};

constexpr double density = 1000, dx = 0.05;

/// A bar along x, clamped at its left end, that bends under its weight.
struct HangingBar : PointScene {
  HangingBar(double youngs_modulus)
      : PointScene(2, dx, lattice(2, dx, 2, Vector3(-2 * dx, 0, 0), Vector3(16 * dx, 4 * dx, 0)),
                   "elasticity/split-neo-hookean", {{"youngs_modulus", youngs_modulus}, {"poissons_ratio", 0.3}}, density) {
    scene.simulation.gravity = Vector3(0, -1, 0);
    scene.simulation.maximum_time_step = 0.04;
    scene.colliders.push_back(half_space(config::Contact::sticky, Vector3(1, 0, 0)));
  }
};

/// A square that hits the ground at twice the speed of its waves.
struct SoftImpact : PointScene {
  SoftImpact()
      : PointScene(2, dx, lattice(2, dx, 2, Vector3(0, 2 * dx, 0), Vector3(8 * dx, 10 * dx, 0)), "elasticity/split-neo-hookean",
                   {{"youngs_modulus", 1e3}, {"poissons_ratio", 0.3}}, density) {
    scene.bodies[0].velocity = Vector3(0, -2, 0);
    scene.colliders.push_back(half_space(config::Contact::separate, Vector3(0, 1, 0)));
  }
};

std::map<std::string, std::int64_t> integrators(const mpm::Simulation& simulation) {
  std::map<std::string, std::int64_t> steps;
  for (const auto& [name, count] : simulation.integrators()) steps[name] = count;
  return steps;
}

std::unique_ptr<mpm::Simulation> run(PointScene& s, Integrator integrator, double end, std::int64_t most = 1000000) {
  s.scene.simulation.integrator = integrator;
  auto simulation = s.start();
  while (simulation->time() < end && simulation->steps() < most) simulation->step(end);
  return simulation;
}

void expect_same(const mpm::Simulation& a, const mpm::Simulation& b) {
  const auto m = a.state(), n = b.state();
  ASSERT_EQ(m.size(), n.size());
  for (std::size_t i = 0; i < m.size(); i++) {
    ASSERT_EQ(m[i].position, n[i].position) << i;
    ASSERT_EQ(m[i].velocity, n[i].velocity) << i;
    ASSERT_EQ(m[i].strain, n[i].strain) << i;
  }
}

TEST(AutomaticIntegrator, StepsAStiffSlowBarImplicitly) {
  const Said said;
  HangingBar bar(1e8);
  const auto simulation = run(bar, Integrator::automatic, 0.2);
  EXPECT_EQ(integrators(*simulation).at("implicit"), simulation->steps()) << said.text();
  EXPECT_EQ(simulation->steps(), 5);
  EXPECT_THAT(said.text(), HasSubstr("implicit steps: "));
  EXPECT_THAT(said.text(), HasSubstr("elastic wave"));
  EXPECT_EQ(said.lines(), 1) << said.text();
  expect_same(*simulation, *run(bar, Integrator::implicit, 0.2));
}

/// The same bar so soft that an implicit step is worth 23 symplectic ones, and what it costs only a trial tells.
TEST(AutomaticIntegrator, LeavesNoTraceOfItsTrials) {
  const Said said;
  HangingBar bar(1e5);
  const auto simulation = run(bar, Integrator::automatic, 1);
  EXPECT_EQ(integrators(*simulation).count("implicit"), 0u) << said.text();
  EXPECT_THAT(said.text(), HasSubstr("symplectic steps: "));
  double trials = 0;
  for (const auto& [stage, seconds] : simulation->stage_seconds())
    if (stage == "implicit solve") trials = seconds;
  EXPECT_GT(trials, 0);
  EXPECT_EQ(simulation->measure().newton_iterations, 0) << "counts steps that were taken";
  expect_same(*simulation, *run(bar, Integrator::symplectic, 1));
}

/// The same bar with fibers that do not stretch: ten times the cost of a symplectic step for each of either kind.
TEST(AutomaticIntegrator, TakesFewerStepsWhereConstraintsAreDear) {
  const Said said;
  HangingBar bar(1e5);
  config::Material& material = bar.scene.materials[0];
  material.fibers.emplace();
  material.fibers->direction = Vector3(1, 0, 0);
  material.constraint.emplace();
  material.constraint->id = "constraint/inextensibility";
  bar.scene.simulation.maximum_time_step = 0.01;
  const auto simulation = run(bar, Integrator::automatic, 0.2);
  const auto steps = integrators(*simulation);
  EXPECT_GT(steps.count("implicit"), 0u) << said.text();
  EXPECT_LE(steps.at("symplectic"), 2) << "before the first projection what it costs is not known";
  EXPECT_THAT(said.text(), HasSubstr("are for damage and constraints"));
}

/// A bar twisted by its ends.
struct TwistedBar : PointScene {
  TwistedBar(double youngs_modulus)
      : PointScene(3, dx, lattice(3, dx, 2, Vector3(-5 * dx, -2 * dx, -2 * dx), Vector3(5 * dx, 2 * dx, 2 * dx)),
                   "elasticity/split-neo-hookean", {{"youngs_modulus", youngs_modulus}, {"poissons_ratio", 0.3}}, density) {
    scene.simulation.precision = config::Precision::single_precision;
    scene.simulation.maximum_time_step = 0.02;
    for (const double side : {-1.0, 1.0}) {
      config::Handle h;
      h.name = side < 0 ? "left" : "right";
      h.region.center = Vector3(side * 5 * dx, 0, 0);
      h.region.size = Vector3(2 * dx, 1, 1);
      h.motion.angular_velocity = Vector3(side, 0, 0);
      scene.handles.push_back(h);
    }
  }
};

/// What steps of either integrator cost, in symplectic steps, of the same motion; counted, not timed.
TEST(AutomaticIntegrator, PicksWhatCostsLessAtEveryStiffness) {
  const double end = 0.06;
  int chose_implicit = 0;
  for (const double youngs_modulus : {1e6, 1e7, 1e8, 1e9}) {
    const Said said;
    TwistedBar bar(youngs_modulus);
    const auto automatic = run(bar, Integrator::automatic, end);
    const bool implicit = integrators(*automatic).count("implicit") > 0;
    const auto solved = run(bar, Integrator::implicit, end);
    const auto r = solved->measure();
    const double cost_implicit =
        double(solved->steps()) * mpm::implicit_cost({.evaluations = std::int64_t(std::ceil(r.newton_iterations)) + 1,
                                                      .products = std::int64_t(std::ceil(r.linear_iterations)),
                                                      .tangents = 1});
    const double cost_symplectic =
        implicit ? double(run(bar, Integrator::symplectic, end)->steps()) : double(automatic->steps());
    EXPECT_EQ(implicit ? integrators(*automatic).at("implicit") : 0, implicit ? automatic->steps() : 0) << said.text();
    if (implicit)
      EXPECT_LT(cost_implicit, cost_symplectic) << youngs_modulus << ": " << said.text();
    else
      EXPECT_LT(cost_symplectic, 2 * cost_implicit) << youngs_modulus << ": " << said.text();
    chose_implicit += implicit;
  }
  EXPECT_GE(chose_implicit, 2);
  EXPECT_LT(chose_implicit, 4);
}

TEST(AutomaticIntegrator, StepsASoftFastImpactSymplectically) {
  const Said said;
  SoftImpact square;
  const auto simulation = run(square, Integrator::automatic, 0.15);
  EXPECT_EQ(integrators(*simulation).count("implicit"), 0u) << said.text();
  EXPECT_THAT(said.text(), HasSubstr("symplectic steps: "));
  EXPECT_THAT(said.text(), HasSubstr("particle speed"));
  expect_same(*simulation, *run(square, Integrator::symplectic, 0.15));
}

}  // namespace
}  // namespace cleave::test
