// Two elastic discs collide centrally and separate (validation problem 7). By symmetry each leaves with the other's velocity;
// what is missing of the kinetic energy afterwards rings in the discs or is lost to the transfers.

#include "scenes.hpp"

#include "figure.hpp"

#include <gtest/gtest.h>

namespace cleave::test {
namespace {

TEST(CollidingDiscs, SeparateAndGiveBackTheirEnergy) {
  const double radius = 0.2, dx = 0.02, speed = 0.1;
  std::vector<Point> points;
  std::size_t left = 0;
  for (double side : {-1.0, 1.0})
    for (auto& p : lattice(2, dx, 2, Vector3(-0.24, -0.24, 0), Vector3(0.24, 0.24, 0))) {
      if (p.x.norm() > radius) continue;
      Point q = p;
      q.x.x() += side * 0.3;
      q.v.x() = -side * speed;
      points.push_back(q);
      if (side < 0) left++;
    }
  PointScene s(2, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 1000.0}, {"poissons_ratio", 0.3}}, 1000);
  auto simulation = s.start();
  const auto before = simulation->measure();
  double largest_elastic = 0;
  while (simulation->time() < 4) {
    simulation->step(4);
    if (simulation->steps() % 10 == 0) largest_elastic = std::max(largest_elastic, simulation->measure().elastic_energy);
  }
  const auto after = simulation->measure();
  Vector3 velocity = Vector3::Zero(), position = Vector3::Zero();
  const auto state = simulation->state();
  for (std::size_t i = 0; i < left; i++) {
    velocity += state[i].velocity / double(left);
    position += state[i].position / double(left);
  }
  const double energy = (after.kinetic_energy + after.elastic_energy) / before.kinetic_energy;
  EXPECT_GT(largest_elastic, 0.2 * before.kinetic_energy) << "they did collide";
  const char* problem = "discs, dx = r/10";
  report({.row = 7,
          .problem = problem,
          .quantity = "speed after / before",
          .reference = 0.7,
          .measured = -velocity.x() / speed,
          .judged = Judged::at_least,
          .scatter = 0.05});
  EXPECT_LT(position.x(), -radius - dx) << "the discs have separated";
  report({.row = 7,
          .problem = problem,
          .quantity = "energy after / before",
          .reference = 0.8,
          .measured = energy,
          .judged = Judged::at_least,
          .scatter = 0.05});
  EXPECT_LT(energy, 1.001) << "energy must not be made";
  EXPECT_LT(after.momentum.norm(), 1e-12 * before.mass * speed);
}

}  // namespace
}  // namespace cleave::test
