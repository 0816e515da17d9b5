// Motion by implicit steps: what backward Euler keeps and what it may lose, and that it is the motion of symplectic steps.

#include "mpm/integrator_choice.hpp"
#include "scenes.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <random>

namespace cleave::test {
namespace {

struct Law {
  const char* name;
  plugins::GivenParameters parameters;
};
const plugins::GivenParameters rubber = {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}};
const Law laws[] = {
    {"elasticity/split-neo-hookean", rubber},
    {"elasticity/fixed-corotated", rubber},
    {"elasticity/stvk-hencky", rubber},
    {"elasticity/qr", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}, {"fiber_scale", 5.}}},
};

std::unique_ptr<PointScene> scene_of(int dimension, double dx, const std::vector<Point>& points, const Law& law) {
  auto s = std::make_unique<PointScene>(dimension, dx, points, law.name, law.parameters, 1000);
  if (law.parameters.count("fiber_scale")) s->scene.materials[0].fibers.emplace();
  s->scene.simulation.integrator = config::Integrator::implicit;
  return s;
}

std::vector<Point> block(int dimension, double dx, const Matrix3& F = Matrix3::Identity()) {
  auto points = lattice(dimension, dx, 2, Vector3(-0.4, -0.3, -0.2), Vector3(0.4, 0.3, 0.2));
  for (auto& p : points) {
    p.x = F * p.x;
    p.F = F;
  }
  return points;
}

const Matrix3 stretch = Vector3(1.1, 1, 1).asDiagonal();

double energy(const output::FrameRecord& r) { return r.kinetic_energy + r.elastic_energy + r.gravity_energy; }

double distance(const std::vector<mpm::ParticleState>& a, const std::vector<mpm::ParticleState>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); i++) sum += (a[i].position - b[i].position).squaredNorm();
  return std::sqrt(sum / double(a.size()));
}

/// 10 and 100 times the symplectic step: dx/c is 8.6 ms, of which that takes 0.4.
TEST(ImplicitStep, ElasticMotionNeverGainsEnergyAndKeepsMomentum) {
  for (const auto& law : laws)
    for (const int dimension : {2, 3})
      for (const double dt : {0.03, 0.3}) {
        SCOPED_TRACE(std::string(law.name) + " in " + std::to_string(dimension) + "D, dt " + std::to_string(dt));
        auto points = block(dimension, 0.1, stretch);
        for (auto& p : points) p.v = Vector3(0.02, -0.01, 0);
        auto s = scene_of(dimension, 0.1, points, law);
        s->scene.simulation.time_step = dt;
        const auto simulation = s->start();
        const auto start = simulation->measure();
        double before = energy(start);
        for (int i = 0; i < 10; i++) {
          simulation->step(100);
          const auto r = simulation->measure();
          EXPECT_LE(energy(r), before * (1 + 1e-9)) << "step " << i;
          EXPECT_LT((r.momentum - start.momentum).norm(), 1e-12 * (start.momentum.norm() + 1));
          before = energy(r);
        }
        EXPECT_LT(before, 0.2 * energy(start)) << "backward Euler damps";
      }
}

TEST(ImplicitStep, AgreesWithSymplecticStepsToFirstOrder) {
  const double end = 0.016;
  for (const auto& law : {laws[0], laws[3]}) {
    auto points = block(2, 0.1, stretch);
    for (auto& p : points) p.v = Vector3(0, 0, 3).cross(p.x);
    const auto run = [&](config::Integrator integrator, double dt) {
      auto s = scene_of(2, 0.1, points, law);
      s->scene.simulation.integrator = integrator;
      s->scene.simulation.implicit.tolerance = 1e-9;
      s->scene.simulation.time_step = dt;
      const auto simulation = s->start();
      while (simulation->time() < end) simulation->step(end);
      return simulation->state();
    };
    std::vector<double> errors;
    for (const double dt : {2e-3, 1e-3, 5e-4})
      errors.push_back(distance(run(config::Integrator::implicit, dt), run(config::Integrator::symplectic, dt)));
    for (std::size_t i = 1; i < errors.size(); i++)
      EXPECT_NEAR(std::log2(errors[i - 1] / errors[i]), 1, 0.2) << law.name << ": " << errors[i - 1] << ", " << errors[i];
  }
}

TEST(ImplicitStep, WhatRestsOrFliesFreelyIsLeftAlone) {
  for (const auto precision : {config::Precision::single_precision, config::Precision::double_precision})
    for (const auto& law : laws)
      for (const double speed : {0.0, 3.0}) {
        auto s = scene_of(3, 0.1, block(3, 0.1), law);
        s->scene.simulation.precision = precision;
        s->scene.simulation.gravity = Vector3(0, speed > 0 ? -9 : 0, 0);
        s->scene.simulation.time_step = 5e-3;
        s->scene.bodies[0].velocity = Vector3(speed, 0.3 * speed, 0);
        const auto simulation = s->start();
        for (int i = 0; i < 20; i++) simulation->step(10);
        const auto r = simulation->measure();
        EXPECT_EQ(r.newton_iterations, 0) << law.name;
        const Vector3 expected = Vector3(speed, speed > 0 ? 0.3 * speed - 0.9 : 0, 0);
        const double rounding = precision == config::Precision::double_precision ? 1e-12 : 1e-5;
        EXPECT_LT((r.momentum / r.mass - expected).norm(), rounding * 3);
        EXPECT_LT(std::max(r.maximum_J - 1, 1 - r.minimum_J), rounding);
      }
}

/// What is left is of first order in the step: A = I + dt C turns to second order only.
TEST(ImplicitStep, LosesAngularMomentumToFirstOrder) {
  std::vector<double> lost;
  for (const double dt : {4e-3, 2e-3, 1e-3}) {
    auto s = scene_of(3, 0.1, block(3, 0.1), {"elasticity/fixed-corotated", rubber});
    s->scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 3);
    s->scene.simulation.time_step = dt;
    s->scene.simulation.implicit.tolerance = 1e-8;
    const auto simulation = s->start();
    const double before = simulation->measure().angular_momentum.z();
    while (simulation->time() < 0.2) simulation->step(0.2);
    lost.push_back(1 - simulation->measure().angular_momentum.z() / before);
  }
  EXPECT_LT(std::abs(lost[0]), 0.02);
  EXPECT_LT(std::abs(lost[1]), 0.7 * std::abs(lost[0]));
  EXPECT_LT(std::abs(lost[2]), 0.7 * std::abs(lost[1]));
}

TEST(ImplicitStep, ThreadsDoNotChangeABit) {
  for (const bool single : {true, false}) {
    std::vector<std::vector<mpm::ParticleState>> runs;
    for (const std::size_t threads : {1, 2, 3}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      auto s = scene_of(3, 0.05, block(3, 0.05, stretch), laws[0]);
      if (single) s->scene.simulation.precision = config::Precision::single_precision;
      s->scene.simulation.time_step = 0.01;
      const auto simulation = s->start();
      for (int i = 0; i < 3; i++) simulation->step(1);
      runs.push_back(simulation->state());
    }
    for (std::size_t k = 1; k < runs.size(); k++)
      for (std::size_t i = 0; i < runs[0].size(); i++) {
        ASSERT_EQ(runs[0][i].position, runs[k][i].position);
        ASSERT_EQ(runs[0][i].velocity, runs[k][i].velocity);
        ASSERT_EQ(runs[0][i].strain, runs[k][i].strain);
      }
  }
}

/// Random strains of neighbours cannot all be undone by motion; what can be is. Fibres in two directions open what has
/// collapsed (see elasticity/qr).
TEST(ImplicitStep, FindsItsWayFromRandomAndCollapsedStrains) {
  const Law qr = {"elasticity/qr",
                  {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}, {"fiber_scale", 5.}, {"cross_fiber_scale", 5.}}};
  std::mt19937 random(5);
  for (const bool collapsed : {false, true}) {
    auto points = lattice(3, 0.1, 2, Vector3(-0.4, -0.2, -0.2), Vector3(0.4, 0.2, 0.2));
    for (auto& p : points) {
      if (collapsed) {
        p.F = 1e-3 * Matrix3::Identity();
        p.x = 1e-3 * p.x + Vector3(0.05, 0.05, 0.05);
        continue;
      }
      do
        for (int i = 0; i < 9; i++) p.F(i / 3, i % 3) = std::uniform_real_distribution<double>(-1, 1)(random);
      while (p.F.determinant() < 1e-3);
    }
    for (const auto precision : {config::Precision::single_precision, config::Precision::double_precision}) {
      auto s = scene_of(3, 0.1, points, qr);
      s->scene.simulation.precision = precision;
      s->scene.simulation.maximum_time_step = 0.04;
      const auto simulation = s->start();
      const double start = energy(simulation->measure());
      double before = start;
      for (int i = 0; i < (collapsed ? 30 : 10); i++) {
        simulation->step(100);
        const auto r = simulation->measure();
        EXPECT_LE(energy(r), before * (1 + 1e-6)) << "step " << i;
        EXPECT_LT(r.newton_iterations, 20);
        before = energy(r);
      }
      EXPECT_LT(before, (collapsed ? 0.2 : 0.85) * start);
    }
  }
}

/// A block flattened through itself to a fifth of its height unfolds where its law is defined there.
TEST(ImplicitStep, UnfoldsWhatStartsInsideOut) {
  const Matrix3 flat = Vector3(1, 1, -0.2).asDiagonal();
  auto s = scene_of(3, 0.1, block(3, 0.1, flat), laws[1]);
  s->scene.simulation.maximum_time_step = 0.02;
  const auto simulation = s->start();
  const double start = energy(simulation->measure());
  for (int i = 0; i < 30; i++) simulation->step(100);
  const auto r = simulation->measure();
  EXPECT_LT(r.elastic_energy, 0.02 * start);
  EXPECT_GT(r.minimum_J, 0.5);
  for (const Law& law : {laws[0], laws[2]}) try {
      scene_of(3, 0.1, block(3, 0.1, flat), law)->start();
      FAIL() << law.name;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find(std::string("starts with det F = -0.2, where ") + law.name + " is not defined"),
                std::string::npos)
          << e.what();
    }
}

config::Collider plane(config::Contact contact, double friction) {
  config::Collider c = half_space(contact, Vector3(0, 1, 0));
  c.friction = friction;
  return c;
}

/// Mean speed down a plane at 0.1 s and at 0.5 s. Gravity is tilted instead of the plane.
std::pair<double, double> incline(config::Contact contact, double friction, double dt) {
  const double angle = M_PI / 6;
  auto s = scene_of(2, 0.05, lattice(2, 0.05, 2, Vector3(0, 0, 0), Vector3(0.8, 0.4, 0)),
                    {"elasticity/split-neo-hookean", {{"youngs_modulus", 1e6}, {"poissons_ratio", 0.3}}});
  s->scene.colliders.push_back(plane(contact, friction));
  s->scene.simulation.gravity = 10 * Vector3(std::sin(angle), -std::cos(angle), 0);
  s->scene.simulation.maximum_time_step = dt;
  const auto simulation = s->start();
  double speed[2];
  for (int k = 0; k < 2; k++) {
    const double target = k ? 0.5 : 0.1;
    while (simulation->time() < target) simulation->step(target);
    const auto r = simulation->measure();
    speed[k] = r.momentum.x() / r.mass;
  }
  return {speed[0], speed[1]};
}

TEST(ImplicitContact, SlidesAndSticksByCoulombsLaw) {
  const double g = 10, s = std::sin(M_PI / 6), c = std::cos(M_PI / 6);
  for (const auto contact : {config::Contact::separate, config::Contact::slip})
    for (const double friction : {0.0, 0.1, 0.3}) {
      const auto [early, late] = incline(contact, friction, 5e-3);
      EXPECT_NEAR((late - early) / 0.4, g * (s - friction * c), 0.02 * g) << "friction " << friction;
    }
  EXPECT_LT(std::abs(incline(config::Contact::separate, 0.8, 5e-3).second), 0.01 * g * s);
  EXPECT_LT(std::abs(incline(config::Contact::sticky, 0, 5e-3).second), 0.01 * g * s);
}

TEST(ImplicitContact, SeparateLetsGoAndNothingElseDoes) {
  for (const auto contact : {config::Contact::separate, config::Contact::slip, config::Contact::sticky}) {
    auto s = scene_of(2, 0.05, lattice(2, 0.05, 2, Vector3(0, 0, 0), Vector3(0.4, 0.4, 0)), laws[0]);
    s->scene.colliders.push_back(plane(contact, 0));
    s->scene.bodies[0].velocity = Vector3(0, 1, 0);
    s->scene.simulation.maximum_time_step = 0.01;
    const auto simulation = s->start();
    while (simulation->time() < 0.1) simulation->step(0.1);
    const auto r = simulation->measure();
    if (contact == config::Contact::separate)
      EXPECT_NEAR(r.momentum.y() / r.mass, 1, 1e-6);
    else
      EXPECT_LT(r.momentum.y() / r.mass, 0.9);
  }
}

TEST(ImplicitContact, FallingBlockComesToRestUnderItsWeight) {
  auto s = scene_of(2, 0.05, lattice(2, 0.05, 2, Vector3(0, 0.2, 0), Vector3(0.4, 0.6, 0)), laws[0]);
  s->scene.colliders.push_back(plane(config::Contact::separate, 0.3));
  s->scene.simulation.gravity = Vector3(0, -10, 0);
  s->scene.simulation.maximum_time_step = 0.01;
  const auto simulation = s->start();
  double before = energy(simulation->measure());
  while (simulation->time() < 1.5) {
    simulation->step(1.5);
    const auto r = simulation->measure();
    EXPECT_LE(energy(r), before + 1e-3 * std::abs(before)) << "at " << simulation->time();
    before = energy(r);
  }
  const auto r = simulation->measure();
  EXPECT_LT(r.kinetic_energy, 1e-3 * r.mass * 10 * 0.2);
  for (const auto& p : simulation->state()) EXPECT_GT(p.position.y(), -0.25 * 0.05);
}

std::unique_ptr<PointScene> held_bar(int dimension, const Law& law, double dx, const config::Handle& right) {
  auto s = scene_of(dimension, dx, lattice(dimension, dx, 2, Vector3(-0.5, -0.1, -0.1), Vector3(0.5, 0.1, 0.1)), law);
  for (const double side : {-1.0, 1.0}) {
    config::Handle h = right;
    h.name = side < 0 ? "left" : "right";
    h.region.center = Vector3(side * 0.5, 0, 0);
    h.region.size = Vector3(0.2, 1, 1);
    h.motion.velocity *= side;
    h.motion.angular_velocity *= side;
    s->scene.handles.push_back(h);
  }
  return s;
}

TEST(ImplicitStep, DamagesAsSymplecticStepsDo) {
  std::vector<output::FrameRecord> ends;
  for (const auto integrator : {config::Integrator::symplectic, config::Integrator::implicit}) {
    config::Handle right;
    right.motion.velocity = Vector3(0.2, 0, 0);
    auto s = held_bar(2, laws[0], 0.05, right);
    s->scene.materials[0].damage = config::PluginUse{
        "damage/phase-field", {{"energy_release_rate", 500.}, {"length_scale", 0.05}, {"mobility", 1000.}}, {}};
    s->scene.simulation.integrator = integrator;
    if (integrator == config::Integrator::implicit) s->scene.simulation.maximum_time_step = 2e-3;
    const auto simulation = s->start();
    while (simulation->time() < 0.25) simulation->step(0.25);
    ends.push_back(simulation->measure());
  }
  EXPECT_GT(ends[0].maximum_damage, 0.1);
  EXPECT_LT(ends[0].maximum_damage, 0.95);
  EXPECT_NEAR(ends[1].maximum_damage, ends[0].maximum_damage, 0.03);
  EXPECT_NEAR(ends[1].elastic_energy, ends[0].elastic_energy, 0.03 * ends[0].elastic_energy);
}

/// A column of sand slumps. Material yields after each solve, whose forces are those of the elastic strain before: a viscosity
/// of about mu dt, gone as dt -> 0.
TEST(ImplicitStep, YieldsAfterTheSolve) {
  const auto height = [](config::Integrator integrator, double dt) {
    auto s = scene_of(2, 0.05, lattice(2, 0.05, 2, Vector3(0, 0, 0), Vector3(0.4, 0.8, 0)),
                      {"elasticity/split-neo-hookean", {{"youngs_modulus", 1e6}, {"poissons_ratio", 0.3}}});
    s->scene.materials[0].plasticity = config::PluginUse{"plasticity/drucker-prager", {{"friction_angle", 25.0}}, {}};
    s->scene.colliders.push_back(plane(config::Contact::separate, 0));
    s->scene.simulation.gravity = Vector3(0, -10, 0);
    s->scene.simulation.integrator = integrator;
    s->scene.simulation.maximum_time_step = dt;
    const auto simulation = s->start();
    while (simulation->time() < 0.2) simulation->step(0.2);
    return simulation->measure().center_of_mass.y();
  };
  const double expected = height(config::Integrator::symplectic, 1e-4);
  const double coarse = height(config::Integrator::implicit, 5e-4) - expected,
               fine = height(config::Integrator::implicit, 1e-4) - expected;
  EXPECT_LT(expected, 0.3) << "from 0.4";
  EXPECT_LT(std::abs(coarse), 0.05);
  EXPECT_LT(std::abs(fine), 0.4 * std::abs(coarse));
}

/// A stiff bar twisted by handles: the state of symplectic steps at a fifth of their cost, counted in symplectic steps (see
/// implicit_cost).
TEST(ImplicitStep, TwistsAStiffBarMoreCheaply) {
  config::Handle right;
  right.motion.angular_velocity = Vector3(1, 0, 0);
  const Law stiff = {"elasticity/fixed-corotated", {{"youngs_modulus", 4e8}, {"poissons_ratio", 0.3}}};
  const double end = 0.2;
  std::vector<std::vector<mpm::ParticleState>> states;
  std::vector<double> costs;
  for (const auto integrator : {config::Integrator::symplectic, config::Integrator::implicit}) {
    auto s = held_bar(3, stiff, 0.05, right);
    s->scene.simulation.integrator = integrator;
    s->scene.simulation.precision = config::Precision::single_precision;
    if (integrator == config::Integrator::implicit) s->scene.simulation.maximum_time_step = 0.02;
    const auto simulation = s->start();
    while (simulation->time() < end) simulation->step(end);
    const auto r = simulation->measure();
    states.push_back(simulation->state());
    EXPECT_LT(r.linear_iterations, 90) << "which nodes alone, passing on what they hear, would need for the length of the bar";
    const auto steps = double(simulation->steps());
    costs.push_back(integrator == config::Integrator::symplectic
                        ? steps
                        : steps * mpm::implicit_cost({.evaluations = std::int64_t(std::ceil(r.newton_iterations)) + 1,
                                                      .products = std::int64_t(std::ceil(r.linear_iterations)),
                                                      .tangents = 1}));
  }
  EXPECT_LT(distance(states[0], states[1]), 0.01 * 0.1) << "of the radius";
  EXPECT_LT(5 * costs[1], costs[0]);
}

/// Each half has less to do than the whole, and ends where steps of its size end.
TEST(ImplicitStep, IsTakenInHalvesWhereThereIsNoSolution) {
  std::vector<std::vector<mpm::ParticleState>> ends;
  for (const int iterations : {30, 2}) {
    auto s = scene_of(2, 0.1, block(2, 0.1, stretch), laws[0]);
    s->scene.simulation.implicit.tolerance = 1e-6;
    s->scene.simulation.time_step = 0.02;
    s->scene.simulation.implicit.maximum_iterations = iterations;
    const auto simulation = s->start();
    simulation->step(1);
    const auto r = simulation->measure();
    EXPECT_EQ(r.time, 0.02);
    EXPECT_EQ(r.steps, 1);
    EXPECT_EQ(r.newton_iterations <= 2, iterations == 2);
    ends.push_back(simulation->state());
  }
  EXPECT_GT(distance(ends[0], ends[1]), 0) << "the steps are shorter";
  EXPECT_LT(distance(ends[0], ends[1]), 0.01);
  double nearest = 1;
  for (const int parts : {2, 4, 8, 16, 32}) {
    auto s = scene_of(2, 0.1, block(2, 0.1, stretch), laws[0]);
    s->scene.simulation.implicit.tolerance = 1e-6;
    s->scene.simulation.time_step = 0.02 / parts;
    const auto simulation = s->start();
    for (int i = 0; i < parts; i++) simulation->step(0.02);
    nearest = std::min(nearest, distance(simulation->state(), ends[1]));
  }
  EXPECT_LT(nearest, 0.02 * distance(ends[0], ends[1]));
}

TEST(ImplicitStep, SaysWhatToChangeWhereItFails) {
  auto s = scene_of(2, 0.1, block(2, 0.1, stretch), laws[0]);
  s->scene.simulation.time_step = 0.1;
  s->scene.simulation.implicit.maximum_iterations = 1;
  s->scene.simulation.implicit.tolerance = 1e-13;
  const auto simulation = s->start();
  const auto before = simulation->state();
  try {
    simulation->step(1);
    FAIL();
  } catch (const SimulationError& e) {
    for (const char* part : {"step 0 at t = 0 s", "Newton", "simulation.maximum_time_step", "maximum_iterations"})
      EXPECT_NE(std::string(e.what()).find(part), std::string::npos) << part << " in " << e.what();
  }
  const auto after = simulation->state();
  for (std::size_t i = 0; i < after.size(); i++) EXPECT_EQ(after[i].position, before[i].position);
}

TEST(ImplicitStep, RefusesLawsWithoutTangent) {
  auto path = plugins::Registry::default_search_path();
  path.push_back(CLEAVE_BINARY_DIR "/tests/abi_plugins");
  plugins::Registry with_others(path);
  auto s = scene_of(2, 0.1, block(2, 0.1), laws[0]);
  s->scene.materials[0].elasticity = {"elasticity/built-for-1-0", rubber, {}};
  try {
    mpm::Simulation::create(s->scene, with_others);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("declares no tangent"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("elasticity/split-neo-hookean"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace cleave::test
