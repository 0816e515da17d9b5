#include "pair.hpp"

#include <gtest/gtest.h>

namespace cleave {
namespace {

/// The comparison of speeds is one of equal work: 50,000 particles that inertia pulls apart (without stress they would end a
/// third of a cell elsewhere) are after 20 steps where the plain loop has them, to rounding.
TEST(NaiveLoop, MovesParticlesAsTheHostDoes) {
  config::Scene scene = naive::block_scene(0.05);
  scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 40);
  plugins::Registry registry(plugins::Registry::default_search_path());
  const auto simulation = mpm::Simulation::create(scene, registry);
  constexpr int steps = 20;
  naive::Twin twin(scene, *simulation, steps);
  for (int i = 0; i < steps; i++) {
    simulation->step(1e6);
    twin.step();
  }
  ASSERT_GT(simulation->particles(), 45000);
  double farthest = 0, fastest = 0;
  for (const auto& p : simulation->state()) {
    const auto& q = twin.particles()[twin.index()[std::size_t(p.id)]];
    for (int a = 0; a < 3; a++) {
      farthest = std::max(farthest, std::abs(p.position[a] - double(q.position[a])) / scene.simulation.cell_size);
      fastest = std::max(fastest, std::abs(p.velocity[a] - double(q.velocity[a])));
    }
  }
  RecordProperty("farthest", std::to_string(farthest));
  EXPECT_LT(farthest, 1e-4) << "cells";
  EXPECT_LT(fastest, 1e-3) << "m/s, of some 4 m/s";
}

}  // namespace
}  // namespace cleave
