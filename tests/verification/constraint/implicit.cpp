// Projections on top of implicit steps.

#include "constraint_scenes.hpp"

namespace cleave::test {
namespace {

/// A block with fibres along x flies head on into a pad two cells thick on a wall. The solve takes momentum from the end of the
/// block that meets the pad, the projection shares it out over the block: of the pad it then leaves less than nothing.
TEST(ImplicitStep, OfWhichAConstraintTurnsMatterInsideOutIsTakenInHalves) {
  constexpr double dx = 0.1, speed = 1.2;
  auto points = lattice(2, dx, 2, Vector3(2 * dx, -0.2, 0), Vector3(12 * dx, 0.2, 0));
  for (auto& p : points) p.v.x() = -speed;
  Constrained s(2, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 200}, {"poissons_ratio", 0.3}}, 1000);
  config::Material pad = s.scene.materials[0];
  pad.name = "pad";
  pad.elasticity.parameters = {{"youngs_modulus", 2e3}, {"poissons_ratio", 0.3}};
  s.scene.materials.push_back(pad);
  config::Body body;
  body.name = "pad";
  body.material = "pad";
  body.shape.emplace();
  body.shape->center = Vector3(dx, 0, 0);
  body.shape->size = Vector3(2 * dx, 0.4, 1);
  body.sampling.particles_per_cell = 4;
  body.sampling.jitter = 0;
  s.scene.bodies.push_back(body);
  s.lay_fibers(Vector3::UnitX());
  s.constrain("constraint/inextensibility");
  s.add_wall(Vector3::Zero(), Vector3::UnitX(), config::Contact::sticky);
  s.scene.simulation.integrator = config::Integrator::implicit;
  s.scene.simulation.time_step = 0.15;
  const auto simulation = s.start();
  const auto energy = [](const output::FrameRecord& r) { return r.kinetic_energy + r.elastic_energy; };
  const double before = energy(simulation->measure());
  std::int64_t halved = 0;
  for (int i = 0; i < 5; i++) {
    simulation->step(1e9);
    const auto r = simulation->measure();
    EXPECT_GT(r.minimum_J, 0);
    EXPECT_LT(energy(r), before);
    EXPECT_LE(r.constraint_residual, 1e-6);
    halved += r.halved_steps;
  }
  EXPECT_GT(halved, 0);
  EXPECT_NEAR(simulation->time(), 5 * 0.15, 1e-12) << "the halves make up the steps";
}

}  // namespace
}  // namespace cleave::test
