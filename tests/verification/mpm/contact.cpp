// A block slides down an inclined plane with Coulomb friction: after the start its acceleration is g (sin a - mu cos a), and
// below the friction angle it rests. Gravity is tilted instead of the plane, so that the plane is a grid line.

#include "scenes.hpp"

#include <gtest/gtest.h>

namespace cleave::test {
namespace {

/// Speeds down the plane at the given times.
std::vector<double> incline(double friction, double angle, config::Contact contact, const std::vector<double>& times) {
  const double dx = 0.05, g = 10;
  auto points = lattice(2, dx, 2, Vector3(0, 0, 0), Vector3(0.8, 0.4, 0));
  PointScene s(2, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 1e6}, {"poissons_ratio", 0.3}}, 1000);
  config::Collider plane = half_space(contact, Vector3(0, 1, 0));
  plane.friction = friction;
  s.scene.colliders.push_back(plane);
  s.scene.simulation.gravity = g * Vector3(std::sin(angle), -std::cos(angle), 0);
  auto simulation = s.start();
  std::vector<double> speeds;
  for (double t : times) {
    while (simulation->time() < t) simulation->step(t);
    const auto m = simulation->measure();
    speeds.push_back(m.momentum.x() / m.mass);
  }
  return speeds;
}

double sliding_acceleration(double friction, double angle, config::Contact contact) {
  const auto speeds = incline(friction, angle, contact, {0.1, 0.5});
  return (speeds[1] - speeds[0]) / 0.4;
}

TEST(InclinedPlane, SlidingFollowsCoulombsLaw) {
  const double g = 10, angle = M_PI / 6;
  EXPECT_NEAR(sliding_acceleration(0, angle, config::Contact::separate), g * std::sin(angle), 0.01 * g);
  for (double mu : {0.1, 0.3}) {
    const double expected = g * (std::sin(angle) - mu * std::cos(angle));
    // the block rocks on its front edge a little, which modulates the contact force
    EXPECT_NEAR(sliding_acceleration(mu, angle, config::Contact::separate), expected, 0.03 * g) << "mu = " << mu;
  }
}

TEST(InclinedPlane, BelowTheFrictionAngleTheBlockStops) {
  // gravity starts at once, so the block rings on the plane and creeps a little while the contact force is low
  const double free_speed = 10 * std::sin(M_PI / 6) * 2;
  EXPECT_LT(std::abs(incline(0.8, M_PI / 6, config::Contact::separate, {2.0})[0]), 0.02 * free_speed);
  EXPECT_LT(std::abs(incline(0, M_PI / 6, config::Contact::sticky, {2.0})[0]), 0.02 * free_speed);
}

/// Elastic bodies rest on the kernels above a floor; sand comes to lie on it.
TEST(Floor, HoldsTheSandThatFallsOnIt) {
  const double dx = 0.05;
  PointScene s(2, dx, lattice(2, dx, 2, Vector3(0, 0, 0), Vector3(0.4, 0.8, 0)), "elasticity/split-neo-hookean",
               {{"youngs_modulus", 1e6}, {"poissons_ratio", 0.3}}, 1000);
  s.scene.materials[0].plasticity.emplace();
  s.scene.materials[0].plasticity->id = "plasticity/drucker-prager";
  s.scene.materials[0].plasticity->parameters = {{"friction_angle", 25.0}};
  config::Collider floor = half_space(config::Contact::separate, Vector3(0, 1, 0));  // through a row of nodes
  floor.friction = 0.3;
  s.scene.colliders.push_back(floor);
  s.scene.simulation.gravity = Vector3(0, -10, 0);
  const auto simulation = s.start();
  while (simulation->time() < 1) simulation->step(1);
  int below = 0;
  double lowest = 1;
  for (const auto& p : simulation->state()) {
    lowest = std::min(lowest, p.position.y());
    below += p.position.y() < 0;
  }
  EXPECT_GT(lowest, -0.25 * dx);
  EXPECT_LT(below, 0.02 * double(simulation->particles()));
}

TEST(MovingCollider, PushesWithItsOwnSpeed) {
  const double dx = 0.05;
  auto points = lattice(2, dx, 2, Vector3(0.1, -0.2, 0), Vector3(0.5, 0.2, 0));
  PointScene s(2, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}, 1000);
  config::Collider wall = half_space(config::Contact::slip, Vector3(1, 0, 0));
  wall.motion.velocity = Vector3(0.5, 0, 0);
  s.scene.colliders.push_back(wall);
  auto simulation = s.start();
  while (simulation->time() < 2) simulation->step(2);
  const auto m = simulation->measure();
  EXPECT_GT(m.momentum.x() / m.mass, 0.45);
  for (const auto& p : simulation->state()) ASSERT_GT(p.position.x(), 0.5 * 2 - dx) << "nothing is left behind in the wall";
}

TEST(Handle, CarriesItsParticlesExactly) {
  const double dx = 0.05;
  auto points = lattice(3, dx, 2, Vector3(-0.3, -0.1, -0.1), Vector3(0.3, 0.1, 0.1));
  for (auto precision : {config::Precision::single_precision, config::Precision::double_precision}) {
    PointScene s(3, dx, points, "elasticity/fixed-corotated", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}, 1000);
    s.scene.simulation.precision = precision;
    for (double side : {-1.0, 1.0}) {
      config::Handle h;
      h.name = side < 0 ? "left" : "right";
      h.region.center = Vector3(side * 0.3, 0, 0);
      h.region.size = Vector3(0.2, 1, 1);
      h.motion.velocity = Vector3(side * 0.02, 0, 0);
      h.motion.angular_velocity = Vector3(side, 0, 0);
      s.scene.handles.push_back(h);
    }
    auto simulation = s.start();
    while (simulation->time() < 0.5) simulation->step(0.5);
    double worst = 0, middle = 0;
    const auto state = simulation->state();
    for (std::size_t i = 0; i < state.size(); i++) {
      const double side = points[i].x.x() > 0 ? 1 : -1;
      const Vector3 expected = Eigen::AngleAxisd(side * 0.5, Vector3::UnitX()) * points[i].x + Vector3(side * 0.01, 0, 0);
      if (std::abs(points[i].x.x()) > 0.2)
        worst = std::max(worst, (state[i].position - expected).norm());
      else if (std::abs(points[i].x.x()) < 0.03)
        middle = std::max(middle, (state[i].position - points[i].x).norm());
    }
    EXPECT_LT(worst, precision == config::Precision::double_precision ? 1e-12 : 2e-5 * dx * 100);
    EXPECT_LT(middle, 0.02) << "the middle is held by symmetry";
  }
}

}  // namespace
}  // namespace cleave::test
