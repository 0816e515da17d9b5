// How damage evolves in time at a point: eta dd/dt = <(1 - d) D - d> in a uniform state, the bounds of steps, and that nothing
// ever heals.

#include "damage_scenes.hpp"

#include "figure.hpp"

#include <gmock/gmock.h>

namespace cleave::test {
namespace {

using testing::HasSubstr;

/// A block at rest, uniformly strained so that D is the given one everywhere: no gradients, natural boundary.
struct UniformBlock : DamageScene {
  UniformBlock(int dimension, double D, const PhaseField& law, const Solid& solid = {})
      : DamageScene(dimension, 0.1, points(dimension, stretched_to(solid, law.energy(D))), solid, law) {
    hold(-10, 10);
  }

 private:
  static std::vector<Point> points(int dimension, const Matrix3& F) {
    auto points = lattice(dimension, 0.1, 2, Vector3(-0.25, -0.15, -0.15), Vector3(0.35, 0.25, 0.25));
    for (auto& p : points) p.F = F;
    return points;
  }
};

double spread(const std::vector<mpm::ParticleState>& state) {
  double low = 1, high = 0;
  for (const auto& p : state) {
    low = std::min(low, p.damage);
    high = std::max(high, p.damage);
  }
  return high - low;
}

/// d = D/(1+D) (1 - exp(-(1+D) t/eta)), to first order in the step; and exactly what each integrator makes of the equation.
TEST(DamageRate, IsThatOfTheClosedForm) {
  const double D = 1.5, eta = 0.02, end = 0.02;
  for (int dimension : {2, 3})
    for (bool explicitly : {false, true}) {
      double error[2];
      for (int refined : {0, 1}) {
        const int steps = refined ? 160 : 80;
        const PhaseField law{.G = 1, .l0 = 0.05, .eta = eta, .residual = 0, .explicitly = explicitly};
        UniformBlock s(dimension, D, law);
        s.scene.simulation.time_step = end / steps;
        const auto simulation = s.start();
        run(*simulation, end);
        ASSERT_EQ(simulation->steps(), steps);
        const auto state = simulation->state();
        EXPECT_LT(spread(state), 1e-9) << "a uniform state stays uniform";
        const double d = state[0].damage, rate = end / steps / eta, limit = D / (1 + D);
        const double per_step = explicitly ? 1 - rate * (1 + D) : 1 / (1 + rate * (1 + D));
        EXPECT_NEAR(d, limit * (1 - std::pow(per_step, steps)), 1e-9);
        error[refined] = d - limit * (1 - std::exp(-(1 + D) * end / eta));
      }
      EXPECT_NEAR(error[0] / error[1], 2, 0.1) << "first order";
      report({.row = 15,
              .problem = "uniform state, " + std::to_string(dimension) + "D, " + (explicitly ? "explicit" : "implicit") +
                         ", dt = eta/160",
              .quantity = "error of d at t = eta",
              .measured = error[1],
              .tolerance = 1e-3,
              .order = order_of(error[0], error[1])});
    }
}

/// Damage that grows by less than a millionth per step grows all the same: over dt = 1e-6 eta, d = 1.5e-6 (1, 2, 3, ...).
TEST(DamageRate, DoesNotDependOnTheStepHoweverShort) {
  for (auto precision : {config::Precision::single_precision, config::Precision::double_precision})
    for (bool explicitly : {false, true}) {
      const double D = 0.5, eta = 1;
      const PhaseField law{.G = 1, .l0 = 0.05, .eta = eta, .residual = 0, .explicitly = explicitly};
      UniformBlock s(2, D, law);
      s.scene.simulation.precision = precision;
      s.scene.simulation.time_step = 1e-6 * eta;
      const auto simulation = s.start();
      for (int i = 0; i < 100; i++) simulation->step(1);
      EXPECT_NEAR(simulation->state()[0].damage, 100e-6 * D, 1e-3 * 100e-6 * D);
    }
}

/// With steps of a thousandth of eta, damage comes to rest at D/(1+D), whatever the tolerance of the solves says of one step.
TEST(DamageRate, IsNotStoppedByTheToleranceOfTheSolve) {
  const double D = 0.05, eta = 1;
  const PhaseField law{.G = 1, .l0 = 0.05, .eta = eta, .residual = 0};
  for (auto precision : {config::Precision::single_precision, config::Precision::double_precision}) {
    UniformBlock s(2, D, law);
    s.scene.simulation.precision = precision;
    s.scene.simulation.damage.tolerance = 1e-3;
    s.scene.simulation.time_step = 1e-3 * eta;
    const auto simulation = s.start();
    run(*simulation, 7 * eta);
    // Seven times eta leave exp(-7.35) = 6e-4; in single precision, steps near rest round to as much as 2.5e-3 (without FMA).
    EXPECT_NEAR(simulation->state()[0].damage, D / (1 + D), 4e-3 * D);
  }
}

/// At the bound of the explicit step d comes to its equilibrium D/(1+D) without passing it, also from the first step.
TEST(ExplicitDamage, DoesNotOvershootAtItsLargestStep) {
  for (double D : {0.2, 3.0, 60.0, 1e4}) {
    const PhaseField law{.G = 1, .l0 = 0.05, .eta = 1e-4, .residual = 0, .explicitly = true};
    UniformBlock s(2, D, law, {.E = 1e5});
    const auto simulation = s.start();
    for (int i = 0; i < 200; i++) {
      simulation->step(1);
      // a force above 99 counts as 99: the end is then between 0.99 and 1
      const double most = D > 99 ? 1 : D / (1 + D) + 1e-9;
      for (const auto& p : simulation->state()) ASSERT_LE(p.damage, most) << "D = " << D << ", step " << i;
    }
    EXPECT_NEAR(simulation->state()[0].damage, D / (1 + D), 1e-2);
    EXPECT_EQ(simulation->measure().limited_by, "explicit damage");
  }
}

TEST(ExplicitDamage, IsRefusedWhereItsStepsWouldBeHopeless) {
  PhaseField law{.eta = 1e-9, .explicitly = true};
  UniformBlock s(2, 1, law);
  EXPECT_THROW(s.start(), InputError);
  // l = 0.2 m is two cells: eta/(1 + 2^2 4) = 5.9e-11 s against an elastic step of 0.4 dx/c, c = sqrt(1.35e4/1e3) m/s
  EXPECT_THAT(failure_of(s), HasSubstr("explicit evolution of damage takes steps of at most 5.88e-11 s here, "));
  EXPECT_THAT(failure_of(s), HasSubstr("times less than elasticity"));
  EXPECT_THAT(failure_of(s), HasSubstr("give integration = \"implicit\", which has no such limit, or a larger viscosity"));

  law.eta = 1e-3;
  UniformBlock fixed(2, 1, law);
  fixed.scene.simulation.time_step = 1e-4;  // above 1e-3/17 s whatever the driving force
  EXPECT_THROW(fixed.start(), InputError);
  EXPECT_THAT(failure_of(fixed), HasSubstr("explicit evolution of damage takes steps of at most 5.88e-05 s here, "
                                           "simulation.time_step is 0.0001 s; give a smaller one or \"auto\", or "
                                           "integration = \"implicit\""));
  fixed.scene.simulation.time_step = 5.7e-5;  // above 1e-3/(17 + D) s
  EXPECT_THAT(failure_of(fixed, 1),
              HasSubstr("step 0 at t = 0 s: the fixed step of 5.7e-05 s is above 5.56e-05 s, the most that the explicit "
                        "evolution of damage of material 'material' allows under its present driving force; give a smaller "
                        "simulation.time_step or \"auto\", or integration = \"implicit\" in its damage law"));
  fixed.scene.simulation.damage.laplacian = config::Laplacian::cubic;  // eigenvalue 4 per axis: 1e-3/(1 + 4 8) s
  EXPECT_THAT(failure_of(fixed), HasSubstr("takes steps of at most 3.03e-05 s here"));
}

TEST(ImplicitDamage, IsStableAtAnyViscosity) {
  for (double eta : {1e-9, 1e-3, 1e6}) {
    const PhaseField law{.G = 5, .l0 = 0.05, .eta = eta, .residual = 0.01};
    const Solid solid{.E = 1e5};
    auto points = lattice(2, 0.1, 2, Vector3(-1, -0.2, 0), Vector3(1, 0.2, 0));
    for (auto& p : points) p.v = Vector3(4 * p.x.x(), 0, 0);
    DamageScene s(2, 0.1, points, solid, law);
    const auto simulation = s.start();
    run(*simulation, 0.5);
    double highest = 0;
    for (const auto& p : simulation->state()) {
      ASSERT_TRUE(p.damage >= 0 && p.damage <= 1) << p.damage;
      ASSERT_LT(p.velocity.norm(), 8);
      highest = std::max(highest, p.damage);
    }
    if (eta == 1e-9) {
      EXPECT_GT(highest, 0.99) << "it tore";
    }
    if (eta == 1e6) {
      EXPECT_LT(highest, 1e-3) << "it had no time to";
    }
    EXPECT_LT(simulation->measure().damage_iterations, 20);
  }
}

/// Cyclic loading of a bar next to a bar that nothing happens to.
TEST(Damage, NeverHealsAndNeverLeavesItsBounds) {
  for (bool explicitly : {false, true}) {
    const double dx = 0.1;
    const Solid solid{.E = 1e5};
    const PhaseField law{.G = 20, .l0 = 0.1, .eta = 5e-3, .residual = 0.01, .explicitly = explicitly};
    auto points = lattice(2, dx, 2, Vector3(-1, -0.2, 0), Vector3(1, 0.2, 0));
    const std::size_t loaded = points.size();
    for (auto p : lattice(2, dx, 2, Vector3(-1, 2, 0), Vector3(1, 2.4, 0))) points.push_back(p);
    DamageScene s(2, dx, points, solid, law);
    for (double side : {-1.0, 1.0}) {
      config::Handle h;
      h.name = side < 0 ? "left" : "right";
      h.region.center = Vector3(side * 0.95, 0, 0);
      h.region.size = Vector3(0.3, 1, 1);
      for (int i = 0; i <= 4; i++) {
        scene::RigidMotion::Keyframe k;
        k.time = 0.05 * i;
        k.translation.x() = side * (i % 2 ? 0.03 + 0.005 * i : -0.02);
        if (i == 0) k.translation.x() = 0;
        h.motion.keyframes.push_back(k);
      }
      s.scene.handles.push_back(h);
    }
    const auto simulation = s.start();
    auto before = simulation->state();
    double highest = 0;
    int relaxing = 0;
    while (simulation->time() < 0.2) {
      simulation->step(0.2);
      const auto after = simulation->state();
      double stretching = 0;
      for (std::size_t i = 0; i < after.size(); i++) {
        ASSERT_GE(after[i].damage, before[i].damage);
        ASSERT_LE(after[i].damage, 1);
        ASSERT_GE(after[i].state[0], before[i].state[0]) << "history";
        highest = std::max(highest, after[i].damage);
        if (i < loaded)
          stretching += after[i].strain(0, 0) - before[i].strain(0, 0);
        else
          ASSERT_EQ(after[i].damage, 0) << "nothing drives it";
      }
      relaxing += stretching < 0;
      before = after;
    }
    EXPECT_GT(highest, 0.2) << "the load is enough to damage";
    EXPECT_GT(relaxing, 10) << "and goes back";
  }
}

TEST(Damage, IsNotDrivenByCompression) {
  const PhaseField law{.eta = 1e-6, .residual = 0};
  auto points = lattice(3, 0.1, 2, Vector3(-0.2, -0.2, -0.2), Vector3(0.2, 0.2, 0.2));
  for (auto& p : points) p.F = 0.8 * Matrix3::Identity();
  DamageScene s(3, 0.1, points, {}, law);
  s.hold(-10, 10);
  const auto simulation = s.start();
  for (int i = 0; i < 10; i++) simulation->step(1);
  for (const auto& p : simulation->state()) ASSERT_EQ(p.damage, 0);
}

TEST(BrokenMatter, IsNotDrawnOutWithoutEnd) {
  for (const bool single : {true, false}) {
    const PhaseField law{.G = 0.01, .l0 = 0.05, .eta = 1e-3, .residual = 0};
    DamageScene s(2, 0.1, lattice(2, 0.1, 2, Vector3(-0.4, -0.2, 0), Vector3(0.4, 0.2, 0)), {}, law);
    if (single) {
      s.scene.simulation.precision = config::Precision::single_precision;
      s.scene.simulation.damage.tolerance = 1e-5;
    }
    s.hold(-0.45, -0.2, Vector3(-1, 0.3, 0));
    s.hold(0.2, 0.45, Vector3(1, 0, 0));
    const auto simulation = s.start();
    double drawn = 0;
    while (simulation->time() < 1) {
      const auto before = simulation->state();
      simulation->step(1);
      const auto after = simulation->state();
      for (std::size_t i = 0; i < after.size(); i++) {
        if (before[i].damage < 0.99) continue;
        const double trace = after[i].strain.trace();
        drawn = std::max(drawn, trace);
        ASSERT_LE(trace, std::max(100.0, before[i].strain.trace()) * (1 + 1e-6)) << "particle " << i;
      }
    }
    EXPECT_GT(drawn, 50) << "the scene draws matter out";
  }
}

}  // namespace
}  // namespace cleave::test
