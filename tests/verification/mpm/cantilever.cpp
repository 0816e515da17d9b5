// A clamped beam under a load at its end (problem 6): the elastica. EI theta'' = -P cos theta with theta(0) = theta'(L) = 0
// gives the drop and the shortening of the end over L; the weight of a heavy end is the load, and implicit steps damp the
// motion to rest.

#include "scenes.hpp"

#include "figure.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace cleave::test {
namespace {

struct Beam : PointScene {
  static constexpr double length = 1, height = 0.05, E = 1e6, density = 0.01, g = 10, end = 0.025;

  /// `load` is P L^2/EI, in plane strain with nu = 0, where EI is E h^3/12; the middle of the heavy end is at L.
  Beam(double load, int across)
      : PointScene(2, height / across,
                   lattice(2, height / across, 2, Vector3(-height, -height / 2, 0), Vector3(length - end / 2, height / 2, 0)),
                   "elasticity/fixed-corotated", {{"youngs_modulus", E}, {"poissons_ratio", 0.0}}, density) {
    config::Material heavy = scene.materials[0];
    heavy.name = "heavy";
    heavy.density = load * E * height * height * height / 12 / (length * length) / (g * end * height);
    scene.materials.push_back(heavy);
    config::Body weight = scene.bodies[0];
    weight.name = weight.material = "heavy";
    weight.particle_file = weight.particle_file->parent_path() / "heavy.csv";
    write_particles(*weight.particle_file, lattice(2, height / across, 2, Vector3(length - end / 2, -height / 2, 0),
                                                   Vector3(length + end / 2, height / 2, 0)));
    scene.bodies.push_back(weight);
    config::Handle clamp;
    clamp.name = "clamp";
    clamp.region.center = Vector3(-height, 0, 0);
    clamp.region.size = Vector3(2 * height, 2 * height, 1);
    scene.handles.push_back(clamp);
    auto& s = scene.simulation;
    s.gravity = Vector3(0, -g, 0);
    s.end_time = 1e3;
    s.integrator = config::Integrator::implicit;
    s.time_step = 0.1;
    s.implicit.tolerance = 1e-6;
    s.implicit.maximum_iterations = 100;
  }
};

struct Bent {
  double drop, shortening;
};
Bent at_rest(double load, int across) {
  const Beam s(load, across);
  const auto simulation = s.start();
  Bent bent{};
  for (int i = 0; i < 80; i++) {
    simulation->step(1e3);
    Vector3 x = Vector3::Zero();
    double n = 0;
    for (const auto& p : simulation->state())
      if (p.body == 1) {
        x += p.position;
        n++;
      }
    const Bent now{-x.y() / n, 1 - x.x() / n};
    const bool rests = std::abs(now.drop - bent.drop) < 1e-4 * now.drop && i > 10;
    bent = now;
    if (rests) break;
  }
  return bent;
}

/// Where the beam bends by less than a cell it is as stiff as it should be. Farther out its surfaces cut cells at an angle, and
/// the few particles in those integrate what a thin beam lives on, stresses that cancel across it, too softly.
TEST(Cantilever, BendsAsTheElasticaAndMoreWhereItLeavesItsCells) {
  const Bent slight = at_rest(0.01, 4);
  report({.row = 6,
          .problem = "material point method, P L^2/EI = 0.01, h = 4 dx",
          .quantity = "drop / L",
          .reference = 0.01 / 3,
          .measured = slight.drop,
          .tolerance = 0.1 * 0.01 / 3});
  struct Case {
    double load, drop, shortening;
  };
  for (const Case& c : {Case{1, 0.3017, 0.0564}, Case{2, 0.4935, 0.1606}, Case{3, 0.6033, 0.2544}, Case{10, 0.8106, 0.5550}}) {
    const Bent coarse = at_rest(c.load, 2), fine = at_rest(c.load, 4);
    const std::string problem = fmt::format("material point method, P L^2/EI = {:g}, h = 4 dx", c.load);
    report({.row = 6,
            .problem = problem,
            .quantity = "drop / L",
            .reference = c.drop,
            .measured = fine.drop,
            .judged = Judged::shown,
            .order = order_of(coarse.drop - c.drop, fine.drop - c.drop),
            .scatter = 0.03});
    report({.row = 6,
            .problem = problem,
            .quantity = "shortening / L",
            .reference = c.shortening,
            .measured = fine.shortening,
            .judged = Judged::shown,
            .order = order_of(coarse.shortening - c.shortening, fine.shortening - c.shortening),
            .scatter = 0.05});
    EXPECT_LT(std::abs(fine.drop - c.drop), std::abs(coarse.drop - c.drop));
    EXPECT_LT(fine.drop, 1.4 * c.drop);
  }
}

}  // namespace
}  // namespace cleave::test
