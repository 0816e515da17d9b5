// A prism that is held at one end and sags: its fibers lie along it, or a few degrees off, each particle's its own way.

#include "constraint_scenes.hpp"

#include "figure.hpp"

#include <Eigen/Geometry>
#include <iostream>
#include <random>

namespace cleave::test {
namespace {

constexpr double dx = 0.05, length = 0.8, held = 0.2;

/// Fibers along F a0: rotations are fibers turned, and make no stress.
std::vector<Point> prism(double degrees) {
  auto points = lattice(3, dx, 2, Vector3(-held, -0.1, -0.1), Vector3(length, 0.1, 0.1));
  std::mt19937 random(1);
  std::uniform_real_distribution<double> angle(-degrees * M_PI / 180, degrees * M_PI / 180);
  for (auto& p : points)
    p.F = (Eigen::AngleAxisd(angle(random), Vector3::UnitY()) * Eigen::AngleAxisd(angle(random), Vector3::UnitZ()))
              .toRotationMatrix();
  return points;
}

struct Sag {
  double deflection = 0;  ///< of the tip when it turns for the first time, m
  double elongation = 0;  ///< mean of |F a0| - 1 then
};
Sag sag(double degrees, double fiber_scale, const plugins::GivenParameters* inextensible) {
  Constrained s(3, dx, prism(degrees), "elasticity/qr",
                {{"shear_modulus", 8e4}, {"bulk_modulus", 1.6e5}, {"fiber_scale", fiber_scale}}, 1000);
  s.scene.simulation.gravity = Vector3(0, -9.81, 0);
  s.hold(Vector3(-held / 2, 0, 0), Vector3(held, 1, 1));
  s.lay_fibers(Vector3::UnitX());
  if (inextensible) s.constrain("constraint/inextensibility", *inextensible);
  const auto simulation = s.start();
  Sag lowest;
  while (simulation->time() < 0.5) {
    for (int i = 0; i < 10 && simulation->time() < 0.5; i++) simulation->step(0.5);
    Sag now;
    double tip = 0;
    for (const auto& p : simulation->state()) {
      now.elongation += ((p.strain * Vector3::UnitX()).norm() - 1) / double(simulation->particles());
      if (p.id < simulation->particles() - 64) continue;
      now.deflection -= p.position.y();
      tip++;
    }
    now.deflection /= tip;
    if (now.deflection < lowest.deflection) break;
    lowest = now;
  }
  return lowest;
}

/// Fibers that lie along the prism let it sag in shear. Each row of the constraint is the mean of the fibers of a place, and
/// the rows are independent: what scatter makes of them little velocities across the scattered fibers meet. With multipliers at
/// the centres of cells combinations of rows that say next to nothing where fibers lie straight hold the prism where they
/// scatter, and stiff fibers bear shear each by itself.
TEST(PerturbedFibers, LockWhereTheyAreStiffButNotWhereTheyAreInextensible) {
  const plugins::GivenParameters as_it_is, centred = {{"multipliers", "centred"}};
  const Sag straight = sag(0, 0, &as_it_is), stiff = sag(0, 1000, nullptr);
  EXPECT_NEAR(stiff.deflection, straight.deflection, 0.05 * straight.deflection);
  const auto print = [](double degrees, const char* what, const Sag& s) {
    std::cout << degrees << " degrees, " << what << ": tip " << s.deflection << " m, elongation " << s.elongation << '\n';
  };
  print(0, "inextensible", straight);
  print(0, "fiber_scale 1000", stiff);
  for (const double degrees : {3., 5.}) {
    const Sag scattered = sag(degrees, 0, &as_it_is), locked = sag(degrees, 1000, nullptr);
    print(degrees, "inextensible", scattered);
    print(degrees, "fiber_scale 1000", locked);
    const std::string problem = "sagging prism, fibers scattered by " + std::to_string(int(degrees)) + " degrees";
    report({.row = 21,
            .problem = problem + ", inextensible",
            .quantity = "sag / that of straight fibers",
            .reference = 1,
            .measured = scattered.deflection / straight.deflection,
            .tolerance = 0.05});
    report({.row = 21,
            .problem = problem + ", 1000 times as stiff",
            .quantity = "sag / that of straight fibers",
            .reference = degrees == 5 ? 0.5 : 0.7,
            .measured = locked.deflection / straight.deflection,
            .judged = Judged::at_most,
            .scatter = 0.05});
    EXPECT_LT(std::abs(scattered.elongation), 1e-3);
  }
  const Sag held = sag(3, 0, &centred);
  print(3, "inextensible, centred multipliers", held);
  EXPECT_LT(held.deflection, 0.9 * straight.deflection);
}

}  // namespace
}  // namespace cleave::test
