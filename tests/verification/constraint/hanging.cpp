// Weights on ropes.

#include "constraint_scenes.hpp"

#include <iostream>

namespace cleave::test {
namespace {

constexpr double dx = 0.1, top = 0.1, bottom = -0.8;

/// A rope of two cells width, held at its upper end, and around its lower end a block of the density given.
struct Hanging : Constrained {
  Hanging(double density, double fiber_scale)
      : Constrained(2, dx, lattice(2, dx, 2, Vector3(-0.1, bottom, 0), Vector3(0.1, top, 0)), "elasticity/qr",
                    {{"youngs_modulus", 2e4}, {"poissons_ratio", 0.3}, {"fiber_scale", fiber_scale}}, 1000) {
    scene.simulation.gravity = Vector3(0, -9.81, 0);
    hold(Vector3(0, 0.05, 0), Vector3(1, 0.1, 1));
    lay_fibers(Vector3::UnitY());
    config::Material heavy = scene.materials[0];
    heavy.name = "weight";
    heavy.density = density;
    heavy.fibers.reset();
    heavy.elasticity.parameters = {{"youngs_modulus", 1e3 * density}, {"poissons_ratio", 0.3}};
    scene.materials.push_back(heavy);
    for (const double side : {-1.0, 1.0}) {
      config::Body weight;
      weight.name = side < 0 ? "left" : "right";
      weight.material = "weight";
      weight.shape.emplace();
      weight.shape->center = Vector3(side * 0.2, -0.7, 0);
      weight.shape->size = Vector3(0.2, 0.2, 1);
      weight.sampling.particles_per_cell = 4;
      weight.sampling.jitter = 0;
      scene.bodies.push_back(weight);
    }
  }
};

struct Rope {
  double gap = 0;      ///< largest there was between neighbours on a fiber, in cells; half a cell at rest
  double stretch = 0;  ///< of the rope's free part, the largest there was, relative
  double residual = 0;
};
Rope hang(const Hanging& s) {
  constexpr std::size_t column = 18, free = 16;  // particles of a fiber, from below
  const auto simulation = s.start();
  Rope rope;
  while (simulation->time() < 0.6) {
    for (int i = 0; i < 10 && simulation->time() < 0.6; i++) simulation->step(0.6);
    rope.residual = std::max(rope.residual, simulation->measure().constraint_residual);
    const auto state = simulation->state();
    for (std::size_t fiber = 0; fiber < 4 * column; fiber += column) {
      for (std::size_t i = fiber; i + 1 < fiber + column; i++)
        rope.gap = std::max(rope.gap, (state[i + 1].position - state[i].position).norm() / dx);
      const double length = (state[fiber + free - 1].position - state[fiber].position).norm();
      rope.stretch = std::max(rope.stretch, std::abs(length / ((free - 1) * dx / 2) - 1));
    }
  }
  return rope;
}

TEST(Weight, BreaksElasticRopesAndHangsFromInextensibleOnes) {
  for (const double density : {500., 2000., 8000., 32000.}) {
    const Rope elastic = hang(Hanging(density, 10));
    Hanging s(density, 0);
    s.constrain("constraint/inextensibility");
    const Rope inextensible = hang(s);
    std::cout << "density " << density << " kg/m^3: elastic fibers stretch by " << elastic.stretch << ", neighbours "
              << elastic.gap << " cells apart; inextensible ones by " << inextensible.stretch << ", " << inextensible.gap
              << " cells, residual " << inextensible.residual << '\n';
    EXPECT_LE(inextensible.residual, 1e-6);
    EXPECT_EQ(elastic.gap > 1, density >= 8000) << "no stencil holds such particles together";
    EXPECT_LT(inextensible.gap, density > 8000 ? 0.6 : 0.51);
    EXPECT_LT(inextensible.stretch, density > 8000 ? 0.03 : 0.005);
  }
}

/// A standing block with upright fibers, pressed onto a floor and pushed sideways; its fibers bear the weight.
TEST(Fibers, MeetStickyAndSlipperyFloors) {
  for (const auto contact : {config::Contact::sticky, config::Contact::slip}) {
    Constrained s(2, dx, lattice(2, dx, 2, Vector3(-0.2, 0, 0), Vector3(0.2, 0.6, 0)), "elasticity/split-neo-hookean",
                  {{"youngs_modulus", 2e4}, {"poissons_ratio", 0.3}}, 1000);
    s.scene.simulation.gravity = Vector3(3, -9.81, 0);
    s.add_wall(Vector3::Zero(), Vector3::UnitY(), contact);
    s.lay_fibers(Vector3::UnitY());
    s.constrain("constraint/inextensibility");
    const auto simulation = s.start();
    double residual = 0;
    while (simulation->time() < 0.2) {
      simulation->step(0.2);
      residual = std::max(residual, simulation->measure().constraint_residual);
    }
    EXPECT_LE(residual, 1e-6);
    const auto state = simulation->state();
    double elongation = 0, foot = 0;
    for (std::size_t i = 0; i < state.size(); i++) {
      elongation += ((state[i].strain * Vector3::UnitY()).norm() - 1) / double(state.size());
      EXPECT_GT(state[i].position.y(), 0);
      if (i % 12 == 0) foot += (state[i].position.x() + 0.2 - dx / 2 * (double(i / 12) + 0.5)) / 8;
    }
    std::cout << (contact == config::Contact::slip ? "slip" : "sticky") << ": foot moves by " << foot << " m, elongation "
              << elongation << ", residual " << residual << '\n';
    EXPECT_LT(std::abs(elongation), 1e-3);
    if (contact == config::Contact::slip)
      EXPECT_NEAR(foot, 0.06, 0.003) << "3 m/s^2 for 0.2 s";
    else
      EXPECT_LT(foot, 0.02);
  }
}

/// One particle to a cell, in some cells two, and far from each other: their rows are dependent, or hold nothing.
TEST(IsolatedFibers, AreProjected) {
  for (const int dimension : {2, 3}) {
    std::vector<Point> points;
    for (int i = 0; i < 6; i++)
      for (int j = 0; j < 6; j++) {
        Point p;
        p.x = dx * Vector3((i % 2 ? 1 : 3) * i + 0.3 * (j % 3) + 0.1, (j % 2 ? 1 : 3) * j + 0.2 * (i % 4) + 0.1,
                           dimension == 3 ? 0.7 * (i + j) : 0);
        p.v = Vector3(std::sin(7. * i + j), std::cos(3. * i - 5. * j), 0);
        p.volume = 0.2 * std::pow(dx, dimension);
        points.push_back(p);
      }
    Constrained s(dimension, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 2e4}, {"poissons_ratio", 0.3}},
                  1000);
    s.lay_fibers(Vector3(1, 0.5, 0));
    s.constrain("constraint/inextensibility");
    const auto simulation = s.start();
    const auto before = simulation->measure();
    double residual = 0, iterations = 0;
    for (int i = 0; i < 50; i++) {
      simulation->step(10);
      const auto r = simulation->measure();
      residual = std::max(residual, r.constraint_residual);
      iterations = std::max(iterations, r.constraint_iterations);
    }
    const auto after = simulation->measure();
    std::cout << "isolated, " << dimension << "D: residual " << residual << ", at most " << iterations << " iterations\n";
    for (const auto& p : simulation->state()) EXPECT_TRUE(p.position.allFinite() && p.velocity.allFinite());
    EXPECT_LT((after.momentum - before.momentum).norm(), 1e-10 * before.mass);
    EXPECT_LE(after.kinetic_energy + after.elastic_energy, before.kinetic_energy * (1 + 1e-3));
    EXPECT_LE(residual, 1e-6);
  }
}

}  // namespace
}  // namespace cleave::test
