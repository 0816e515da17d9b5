// Constraint laws inside the simulation.

#include "scenes.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>

namespace cleave::test {
namespace {

plugins::Registry& laws() {
  static plugins::Registry r([] {
    auto path = plugins::Registry::default_search_path();
    path.emplace_back(CLEAVE_CONSTRAINT_PLUGINS);
    return path;
  }());
  return r;
}

const plugins::GivenParameters soft = {{"youngs_modulus", 2e4}, {"poissons_ratio", 0.3}};

void constrain(config::Material& material, const Vector3& fibers, const std::string& law = "constraint/fixed-length",
               const plugins::GivenParameters& parameters = {}) {
  material.fibers.emplace();
  material.fibers->direction = fibers;
  material.constraint.emplace();
  material.constraint->id = law;
  material.constraint->parameters = parameters;
}

config::Handle hold(const Vector3& center, const Vector3& size) {
  config::Handle h;
  h.name = "held";
  h.region.center = center;
  h.region.size = size;
  return h;
}

std::unique_ptr<mpm::Simulation> start(const PointScene& s) { return mpm::Simulation::create(s.scene, laws()); }

void run(mpm::Simulation& simulation, double until) {
  while (simulation.time() < until) simulation.step(until);
}

// ------------------------------------------------------------------------------------------------- what it does

struct Case {
  int dimension;
  config::Precision precision;
  config::Transfer transfer;
};

class HangingPrism : public testing::TestWithParam<Case> {
 protected:
  static constexpr double dx = 0.1, height = 0.8;

  /// A prism that hangs from its top fifth.
  struct Prism : PointScene {
    explicit Prism(const Case& c)
        : PointScene(c.dimension, dx, lattice(c.dimension, dx, 2, Vector3(-0.1, -height, -0.1), Vector3(0.1, 0.2, 0.1)),
                     "elasticity/split-neo-hookean", soft, 1000) {
      scene.simulation.precision = c.precision;
      scene.simulation.transfer = c.transfer;
      scene.simulation.gravity = Vector3(0, -9.81, 0);
      scene.handles.push_back(hold(Vector3(0, 0.1, 0), Vector3(1, 0.2, 1)));
    }
  };
  static double lowest(const mpm::Simulation& simulation) {
    double y = 0;
    for (const auto& p : simulation.state()) y = std::min(y, p.position.y());
    return y;
  }
};

TEST_P(HangingPrism, IsHeldByItsFibres) {
  Prism with(GetParam()), without(GetParam());
  constrain(with.scene.materials[0], Vector3::UnitY());
  auto held = start(with), loose = start(without);
  const double from = lowest(*loose);
  double stretched = 0, kept = 0, residual = 0, iterations = 0;
  while (loose->time() < 0.3) {
    loose->step(0.3);
    stretched = std::max(stretched, from - lowest(*loose));
  }
  while (held->time() < 0.3) {
    held->step(0.3);
    kept = std::max(kept, from - lowest(*held));
    const auto record = held->measure();
    residual = std::max(residual, record.constraint_residual);
    iterations += record.constraint_iterations;
  }
  EXPECT_GT(stretched, 0.15) << "the weight is enough to stretch it";
  EXPECT_LT(kept, 0.05 * stretched);
  EXPECT_LE(residual, 1.1e-8) << "as the law promises";
  EXPECT_GT(iterations, 0);
  double worst = 0;
  for (const auto& p : held->state()) {
    ASSERT_FALSE(p.stores_b) << "the constraint reads F";
    worst = std::max(worst, std::abs((p.strain * Vector3::UnitY()).norm() - 1));
  }
  EXPECT_LT(worst, 0.05) << "of every fibre";
  EXPECT_EQ(loose->measure().constraint_iterations, 0);
  const auto has_stage = [](const mpm::Simulation& simulation) {
    for (const auto& [name, seconds] : simulation.stage_seconds())
      if (name == "constraint") return seconds > 0;
    return false;
  };
  EXPECT_TRUE(has_stage(*held));
  EXPECT_FALSE(has_stage(*loose));
}
INSTANTIATE_TEST_SUITE_P(All, HangingPrism,
                         testing::Values(Case{2, config::Precision::double_precision, config::Transfer::apic},
                                         Case{3, config::Precision::single_precision, config::Transfer::apic},
                                         Case{2, config::Precision::single_precision, config::Transfer::flip}),
                         [](const auto& info) {
                           return std::to_string(info.param.dimension) + "D" +
                                  (info.param.precision == config::Precision::single_precision ? "Single" : "Double") +
                                  (info.param.transfer == config::Transfer::flip ? "Flip" : "Apic");
                         });

TEST(FreeBody, KeepsItsMomentaUnderAConstraint) {
  for (const int dimension : {2, 3}) {
    const double dx = 0.1, omega = 4;
    auto points = lattice(dimension, dx, 2, Vector3(-0.3, -0.1, -0.1), Vector3(0.3, 0.1, 0.1));
    for (auto& p : points) {  // turns about a point beside it, and is drawn out along its fibres
      p.v = Vector3(1, 0, 0) + omega * Vector3(-p.x.y(), p.x.x(), 0) + 0.5 * Vector3(p.x.x(), p.x.x(), 0);
      p.F(0, 0) = 1.05;
    }
    PointScene s(dimension, dx, points, "elasticity/split-neo-hookean", soft, 1000);
    constrain(s.scene.materials[0], Vector3(1, 0.3, 0));
    auto simulation = start(s);
    const auto before = simulation->measure();
    run(*simulation, 0.2);
    const auto after = simulation->measure();
    EXPECT_GT(after.constraint_iterations, 3);
    const double scale = before.momentum.norm();
    EXPECT_LT((after.momentum - before.momentum).norm(), 1e-12 * scale) << dimension;
    EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-12 * scale) << dimension;
    EXPECT_LT(after.kinetic_energy + after.elastic_energy, (before.kinetic_energy + before.elastic_energy) * (1 + 1e-3));
  }
}

/// Where nothing stretches along the beam its cross sections slide past each other: rho w_tt = G w_xx - rho g, w = 0 at the
/// root, w_x = 0 at the tip. From rest the tip falls freely until a wave from the root has come, L/c; then, up to 3 L/c,
/// w = -g t^2/2 + g (t - L/c)^2. A discretisation with more rows than the nodes can follow would not move: it locks.
TEST(CantileverOfFibres, SagsInShearAlone) {
  const double dx = 0.1, length = 1, modulus = 1.5e5, t = 0.15, g = 9.81;
  PointScene s(2, dx, lattice(2, dx, 2, Vector3(-0.2, -0.1, 0), Vector3(length, 0.1, 0)), "elasticity/split-neo-hookean",
               {{"shear_modulus", modulus}, {"bulk_modulus", 3e5}}, 1000);
  s.scene.simulation.gravity = Vector3(0, -g, 0);
  s.scene.handles.push_back(hold(Vector3(-0.1, 0, 0), Vector3(0.2, 1, 1)));
  constrain(s.scene.materials[0], Vector3::UnitX());
  auto simulation = start(s);
  double before = 0, after = 0;
  for (const auto& p : simulation->state())
    if (p.position.x() > length - dx) before += p.position.y() / 8;
  run(*simulation, t);
  for (const auto& p : simulation->state())
    if (p.position.x() > length - dx) after += p.position.y() / 8;
  const double arrival = length / std::sqrt(modulus / 1000), exact = g * t * t / 2 - g * std::pow(t - arrival, 2);
  EXPECT_NEAR(before - after, exact, 0.15 * exact);
}

// ------------------------------------------------------------------------------------------------- its place in the scene

struct TwoBlocks : PointScene {
  explicit TwoBlocks(bool constrained)
      : PointScene(2, 0.1, lattice(2, 0.1, 2, Vector3(-0.2, -0.2, 0), Vector3(0.2, 0.2, 0)), "elasticity/split-neo-hookean",
                   soft, 1000) {
    scene.simulation.gravity = Vector3(0, -9.81, 0);
    scene.simulation.time_step = 1e-3;
    scene.materials.push_back(scene.materials[0]);
    scene.materials[1].name = "fibrous";
    if (constrained) constrain(scene.materials[1], Vector3::UnitX());
    scene.bodies.push_back(scene.bodies[0]);
    scene.bodies[0].velocity = Vector3(0.3, 0, 0);
    scene.bodies[1].name = "fibrous";
    scene.bodies[1].material = "fibrous";
    scene.bodies[1].particle_file.reset();
    scene.bodies[1].shape.emplace();
    scene.bodies[1].shape->center = Vector3(3, 0, 0);
    scene.bodies[1].shape->size = Vector3(0.4, 0.4, 1);
    scene.bodies[1].sampling.particles_per_cell = 4;
    scene.bodies[1].velocity = Vector3(0, 1, 0);
    scene.bodies[1].spin.angular_velocity = Vector3(0, 0, 3);
    config::Collider floor;
    floor.name = "floor";
    floor.shape.type = cleave::scene::ShapeSpec::Type::half_space;
    floor.shape.center = Vector3(0, -0.25, 0);
    floor.shape.axis = Vector3(0, 1, 0);
    scene.colliders.push_back(floor);
  }
};

TEST(Constraint, LeavesOtherBodiesAloneToTheBit) {
  auto with = start(TwoBlocks(true)), without = start(TwoBlocks(false));
  run(*with, 0.2);
  run(*without, 0.2);
  const auto a = with->state(), b = without->state();
  bool other = false;
  for (std::size_t i = 0; i < a.size(); i++) {
    if (a[i].body == 0) {
      ASSERT_EQ(a[i].position, b[i].position);
      ASSERT_EQ(a[i].velocity, b[i].velocity);
    } else {
      other = other || a[i].velocity != b[i].velocity;
    }
  }
  EXPECT_TRUE(other);
}

/// Two prisms that hang side by side and share the nodes between them, one after the other.
TEST(Constraint, OfEachMaterialHolds) {
  PointScene s(2, 0.1, lattice(2, 0.1, 2, Vector3(-0.2, -0.8, 0), Vector3(0, 0.2, 0)), "elasticity/split-neo-hookean", soft,
               1000);
  s.scene.simulation.gravity = Vector3(0, -9.81, 0);
  constrain(s.scene.materials[0], Vector3::UnitY());
  s.scene.materials.push_back(s.scene.materials[0]);
  s.scene.materials[1].name = "right";
  s.scene.bodies.push_back(s.scene.bodies[0]);
  s.scene.bodies[1].name = "right";
  s.scene.bodies[1].material = "right";
  s.scene.bodies[1].particle_file.reset();
  s.scene.bodies[1].shape.emplace();
  s.scene.bodies[1].shape->center = Vector3(0.1, -0.3, 0);
  s.scene.bodies[1].shape->size = Vector3(0.2, 1, 1);
  s.scene.bodies[1].sampling.pattern = scene::SamplingPattern::regular;
  s.scene.bodies[1].sampling.particles_per_cell = 4;
  s.scene.handles.push_back(hold(Vector3(0, 0.1, 0), Vector3(1, 0.2, 1)));
  const auto worst = [&] {
    auto simulation = start(s);
    run(*simulation, 0.3);
    std::array<double, 2> of_body{};
    for (const auto& p : simulation->state()) {
      double& stretch = of_body[std::size_t(p.body)];
      if (!p.stores_b) stretch = std::max(stretch, std::abs((p.strain * Vector3::UnitY()).norm() - 1));
    }
    return of_body;
  };
  const auto both = worst();
  EXPECT_LT(both[0], 0.05);
  EXPECT_LT(both[1], 0.05);
  s.scene.materials[1].constraint.reset();
  s.scene.materials[1].elasticity.id = "elasticity/fixed-corotated";  // stores F without a constraint
  EXPECT_GT(worst()[1], 0.1) << "what the second law holds";
}

TEST(Constraint, IsTheSameWithAnyNumberOfThreads) {
  const auto run_with = [](int threads) {
    tbb::global_control control(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
    TwoBlocks s(true);
    s.scene.simulation.precision = config::Precision::single_precision;
    auto simulation = start(s);
    run(*simulation, 0.1);
    return simulation->state();
  };
  const auto one = run_with(1), three = run_with(3);
  for (std::size_t i = 0; i < one.size(); i++) {
    ASSERT_EQ(one[i].position, three[i].position);
    ASSERT_EQ(one[i].velocity, three[i].velocity);
    ASSERT_EQ(one[i].strain, three[i].strain);
  }
}

// ------------------------------------------------------------------------------------------------- what it is given

/// 4 x 4 cells whose particles reach 7 x 7 nodes, the first of them at (-0.1, -0.1).
class Witnessed : public testing::Test {
 protected:
  struct Block : PointScene {
    explicit Block(const std::string& act = "nothing", int dimension = 2)
        : PointScene(dimension, 0.1, points(dimension), "elasticity/split-neo-hookean", soft, 1000) {
      scene.simulation.time_step = 1e-3;
      const double volume = std::pow(0.05, dimension);
      constrain(scene.materials[0], Vector3(0.6, 0.8, 0), "constraint/witness",
                {{"mass", 1000 * std::pow(0.4, dimension)}, {"rest_volume", volume}, {"act", act}});
    }
    static std::vector<Point> points(int dimension) {
      auto all = lattice(dimension, 0.1, 2, Vector3::Zero(), Vector3::Constant(0.4));
      for (auto& p : all) p.F(0, 0) = 1.02;
      return all;
    }
  };
  static void add_floor(PointScene& s, const Vector3& normal, config::Contact contact, double distance = 0) {
    config::Collider c;
    c.name = "wall-" + std::to_string(s.scene.colliders.size());
    c.shape.type = cleave::scene::ShapeSpec::Type::half_space;
    c.shape.axis = normal;
    c.shape.center = -distance * normal;
    c.contact = contact;
    s.scene.colliders.push_back(c);
  }
  /// Nodes held altogether and along a normal, in the first step.
  static std::pair<double, double> held(const PointScene& s) {
    auto simulation = start(s);
    simulation->step(1);
    const auto record = simulation->measure();
    return {record.constraint_iterations, record.constraint_residual};
  }
};
using Nodes = std::pair<double, double>;

TEST_F(Witnessed, SystemIsAsTheContractSays) {
  for (const int dimension : {2, 3})
    for (const auto precision : {config::Precision::single_precision, config::Precision::double_precision}) {
      Block s("nothing", dimension);
      s.scene.simulation.precision = precision;
      s.scene.bodies[0].velocity = Vector3(-3, 2, 0);
      s.scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 5);
      s.scene.materials[0].constraint->parameters["spin"] = 5.0;
      auto simulation = start(s);
      EXPECT_NO_THROW(run(*simulation, 0.1)) << dimension;
    }
}

TEST_F(Witnessed, NodesOfCollidersAreMarked) {
  Block sticky;
  add_floor(sticky, Vector3::UnitY(), config::Contact::sticky);
  EXPECT_EQ(held(sticky), Nodes(14, 0));
  Block corner;
  add_floor(corner, Vector3::UnitY(), config::Contact::slip);
  EXPECT_EQ(held(corner), Nodes(0, 14));
  add_floor(corner, Vector3::UnitY(), config::Contact::slip, 0.05);
  EXPECT_EQ(held(corner), Nodes(0, 14)) << "the same normal twice holds no more";
  add_floor(corner, Vector3::UnitX(), config::Contact::slip);
  EXPECT_EQ(held(corner), Nodes(4, 20)) << "two normals hold a node altogether";
  Block separate;
  for (auto& m : separate.scene.materials) m.elasticity.parameters["youngs_modulus"] = 1e-3;
  add_floor(separate, Vector3::UnitY(), config::Contact::separate);
  separate.scene.simulation.gravity = Vector3(0, -9.81, 0);
  EXPECT_EQ(held(separate), Nodes(0, 14)) << "pressed onto it";
  separate.scene.simulation.gravity = Vector3(0, 9.81, 0);
  EXPECT_EQ(held(separate), Nodes(0, 0)) << "about to leave";
}

TEST_F(Witnessed, NodesOfHandlesAreMarked) {
  Block s;
  s.scene.handles.push_back(hold(Vector3(0.1, 0.2, 0), Vector3(0.2, 1, 1)));
  EXPECT_EQ(held(s), Nodes(4 * 7, 0)) << "columns -1, 0, 1, and 2 that half of the mass of is the handle's";
}

TEST_F(Witnessed, WhatIsHeldStaysWhateverTheLawDoes) {
  Block s("push");
  s.scene.handles.push_back(hold(Vector3(0.1, 0.2, 0), Vector3(0.2, 1, 1)));
  auto simulation = start(s);
  simulation->step(1);
  int inside = 0, between = 0, pushed = 0;
  for (const auto& p : simulation->state()) {
    if (p.position.x() < 0.1) {  // all of its nodes are the handle's
      EXPECT_EQ(p.velocity_gradient(0, 0), 0);
      inside++;
    } else if (p.position.x() > 0.2 && p.position.x() < 0.3) {  // from the handle's to those that are pushed
      EXPECT_GT(p.velocity_gradient(0, 0), 10);
      between++;
    }
    pushed += p.velocity.x() > 6.9;
  }
  EXPECT_EQ(inside, 16);
  EXPECT_EQ(between, 16);
  EXPECT_GE(pushed, 8);
}

TEST_F(Witnessed, NothingIsPushedIntoACollider) {
  Block s("push");
  s.scene.simulation.gravity = Vector3(-200, 0, 0);  // about to leave the wall before it is pushed
  add_floor(s, -Vector3::UnitX(), config::Contact::separate, -0.4);
  auto simulation = start(s);
  run(*simulation, 0.02);
  for (const auto& p : simulation->state()) EXPECT_LT(p.position.x(), 0.4) << "after 0.02 s at 7 m/s";
}

TEST_F(Witnessed, FailuresNamePluginStepAndTime) {
  const auto failure = [](const std::string& act) -> std::string {
    auto simulation = start(Block(act));
    try {
      run(*simulation, 0.1);
    } catch (const SimulationError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(failure("give-up"),
            "step 2 at t = 0.002 s, dt = 0.001 s, constraint: plugin constraint/witness 1.0.0 failed: three times is enough");
  EXPECT_EQ(failure("give-nan"),
            "step 2 at t = 0.002 s, dt = 0.001 s, constraint: plugin constraint/witness 1.0.0 gives velocities that are not "
            "finite, at the grid node at (-0.1, -0.1, 0) m");
  EXPECT_EQ(failure("report-nan"),
            "step 2 at t = 0.002 s, dt = 0.001 s, constraint: plugin constraint/witness 1.0.0 reports a residual that is not a "
            "number");
}

}  // namespace
}  // namespace cleave::test
