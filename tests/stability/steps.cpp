// Steps that are too large: what bounds them, where they become unstable, and what happens if one turns out too large.

#include "../verification/mpm/scenes.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>
#include <random>

namespace cleave::test {
namespace {

using plugins::GivenParameters;

const GivenParameters soft{{"youngs_modulus", 1e4}, {"poissons_ratio", 0.3}};

double energy(const output::FrameRecord& r) { return r.kinetic_energy + r.elastic_energy; }

/// A free block whose particles tremble, so that whatever can grow does.
struct Trembling {
  const char* name;
  const char* law = "elasticity/split-neo-hookean";
  GivenParameters parameters = soft;
  int dimension = 2;
  double left_out = 0;              ///< part of the particles, at random: the others are unevenly spread
  Matrix3 F = Matrix3::Identity();  ///< at the start

  static constexpr double dx = 0.1;
  std::unique_ptr<mpm::Simulation> start(std::optional<double> step) const {
    const double size = dimension == 3 ? 0.4 : 0.8;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> number(-1, 1);
    std::vector<Point> points;
    for (auto p : lattice(dimension, dx, 2, Vector3(0, 0, 0), Vector3(size, size, size))) {
      if (0.5 * (number(random) + 1) < left_out) continue;
      for (int a = 0; a < dimension; a++) {
        if (left_out > 0) p.x[a] += 0.25 * dx * number(random);
        p.v[a] = 0.02 * number(random);
      }
      p.x = F * p.x;
      p.F = F;
      points.push_back(p);
    }
    PointScene s(dimension, dx, points, law, parameters, 1000);
    s.scene.simulation.cfl = 1;
    s.scene.simulation.time_step = step;
    return s.start();
  }
  double bound() const { return start({})->largest_step().seconds; }
  /// Energy after some hundred waves through a cell over that at the start.
  double growth(double step) const {
    const auto simulation = start(step);
    const double before = energy(simulation->measure());
    try {
      for (int i = 0; i < 300; i++) simulation->step(1e9);
    } catch (const SimulationError&) {
      return std::numeric_limits<double>::infinity();
    }
    const double after = energy(simulation->measure());
    return std::isfinite(after) ? after / before : std::numeric_limits<double>::infinity();
  }
};

class StepBound : public testing::TestWithParam<Trembling> {};

/// The bound that the program reports with cfl = 1 is below the step at which a trembling block gains energy, and by less than
/// a factor 2. The default of cfl, 0.4, is a margin on top of it.
TEST_P(StepBound, LiesWithinAFactorTwoBelowTheBoundary) {
  const double bound = GetParam().bound();
  EXPECT_LT(GetParam().growth(0.9 * bound), 1.02);
  EXPECT_GT(GetParam().growth(2 * bound), 2);
}

INSTANTIATE_TEST_SUITE_P(Blocks, StepBound,
                         testing::Values(Trembling{.name = "Regular"},
                                         Trembling{.name = "Stiff",
                                                   .parameters = {{"youngs_modulus", 1e9}, {"poissons_ratio", 0.3}}},
                                         Trembling{.name = "SparselySampled", .left_out = 0.5},
                                         Trembling{.name = "InThreeDimensions", .dimension = 3},
                                         Trembling{.name = "NearlyIncompressible",
                                                   .parameters = {{"youngs_modulus", 1e4}, {"poissons_ratio", 0.49}}}),
                         [](const auto& info) { return std::string(info.param.name); });

/// A block that flies into a wall within less than a step: faster than any wave, it is turned inside out there.
struct Impact : PointScene {
  static constexpr double dx = 0.1, speed = 8;
  explicit Impact(std::optional<double> step) : PointScene(2, dx, points(), "elasticity/split-neo-hookean", soft, 1000) {
    scene.simulation.time_step = step;
    scene.colliders.push_back(half_space(config::Contact::sticky, Vector3(1, 0, 0)));
  }

 private:
  static std::vector<Point> points() {
    auto points = lattice(2, dx, 2, Vector3(0.15, -0.4, 0), Vector3(0.95, 0.4, 0));
    for (auto& p : points) p.v.x() = -speed;
    return points;
  }
};

TEST(LargeStep, IsRolledBackAndTakenInHalves) {
  const Impact impact(0.02);
  const auto simulation = impact.start();
  const double before = energy(simulation->measure());
  std::int64_t halved = 0;
  for (int i = 0; i < 3; i++) {
    simulation->step(1e9);
    const auto record = simulation->measure();
    EXPECT_GT(record.minimum_J, 0);
    EXPECT_LT(energy(record), 1.5 * before);
    halved += record.halved_steps;
  }
  EXPECT_GT(halved, 0);
  EXPECT_NEAR(simulation->time(), 3 * 0.02, 1e-12) << "the halves make up the steps";
}

/// Steps of automatic size neither turn matter inside out nor press it beyond a quarter of its volume at once.
TEST(LargeStep, IsNotTakenAutomatically) {
  const Impact impact({});
  const auto simulation = impact.start();
  const double before = energy(simulation->measure());
  while (simulation->time() < 0.1) {
    const auto start = simulation->state();
    simulation->step(0.1);
    const auto record = simulation->measure();
    const auto end = simulation->state();
    for (std::size_t i = 0; i < start.size(); i++)
      ASSERT_GT(end[i].strain.determinant(), 0.06 * start[i].strain.determinant()) << "b, whose determinant is J^2";
    ASSERT_LT(energy(record), 1.01 * before) << "t = " << simulation->time();
  }
}

/// Nothing is done twice where nothing has to be: the calls of a law that counts them are those of two halves.
TEST(LargeStep, OfALawThatAsksForASmallerOneIsRolledBack) {
  const double dx = 0.1, rate = 3, dt = 0.1;
  auto points = lattice(2, dx, 2, Vector3(-0.8, -0.8, 0), Vector3(0.8, 0.8, 0));
  for (auto& p : points) p.v = Vector3(rate * p.x.x(), -rate * p.x.y(), 0);
  PointScene s(2, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 1.0}, {"poissons_ratio", 0.3}}, 1000);
  s.scene.simulation.time_step = dt;
  s.scene.materials[0].plasticity.emplace();
  s.scene.materials[0].plasticity->id = "plasticity/failing-flow";
  s.scene.materials[0].plasticity->parameters = {{"limit", 0.7}};
  plugins::Registry registry([] {
    auto path = plugins::Registry::default_search_path();
    path.push_back(CLEAVE_FAILING_PLUGINS);
    return path;
  }());
  const auto simulation = mpm::Simulation::create(s.scene, registry);
  simulation->step(1e9);
  EXPECT_EQ(simulation->measure().halved_steps, 1);
  for (const auto& p : simulation->state()) ASSERT_EQ(p.state.at(0), 2) << "calls for particle " << p.id;
  EXPECT_DOUBLE_EQ(simulation->time(), dt);
}

/// Fibers carry waves of their own: with (lambda + 2 mu + k)/rho for c^2 along them, k = fiber_scale mu, the step holds cfl
/// dx/c.
TEST(LargestStep, CountsTheStiffnessOfFibers) {
  for (const double scale : {1.0, 100.0, 1e4}) {
    const double dx = 0.1, E = 1e4, nu = 0.3, rho = 1000, mu = E / (2 * (1 + nu)), lambda = E * nu / ((1 + nu) * (1 - 2 * nu));
    PointScene s(2, dx, lattice(2, dx, 2, Vector3(0, 0, 0), Vector3(0.4, 0.4, 0)), "elasticity/qr",
                 {{"youngs_modulus", E}, {"poissons_ratio", nu}, {"fiber_scale", scale}}, rho);
    s.scene.materials[0].fibers.emplace();
    s.scene.materials[0].fibers->direction = Vector3(1, 0, 0);
    const double c = std::sqrt((lambda + mu + scale * mu) / rho);
    const mpm::Bound bound = s.start()->largest_step();
    EXPECT_STREQ(bound.name, "elastic wave");
    EXPECT_LE(bound.seconds, 0.4 * dx / c * (1 + 1e-9));
    EXPECT_GT(bound.seconds, 0.7 * 0.4 * dx / c);
  }
}

}  // namespace
}  // namespace cleave::test
