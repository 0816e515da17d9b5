// The shape of a crack at rest: d = exp(-|x|/l) about a line that is broken, and what it costs.

#include "damage_scenes.hpp"

#include "figure.hpp"

#include <fmt/format.h>

#include <map>

namespace cleave::test {
namespace {

/// A strip at rest with one column of particles driven so hard that it breaks; nothing drives the others.
struct CrackedStrip : DamageScene {
  static constexpr double dx = 0.1;
  CrackedStrip(double length, const std::string& integration, config::Laplacian laplacian = config::Laplacian::weak,
               double eta = 1e-6, double width = dx / 2)
      : DamageScene(2, dx, points(width), {}, {}) {
    // the anisotropic law takes l itself; the square of the stress over sigma_c is D + 1
    scene.materials[0].damage = use("damage/anisotropic", {{"critical_stress", 1.0},
                                                           {"viscosity", eta},
                                                           {"structural_alpha", std::vector<double>{}},
                                                           {"length_scale", length},
                                                           {"integration", integration}});
    scene.simulation.damage.laplacian = laplacian;
    hold(-100, 100);
  }

 private:
  static std::vector<Point> points(double width) {
    auto points = lattice(2, dx, 2, Vector3(-6, -0.1, 0), Vector3(6, 0.1, 0));
    for (auto& p : points)
      if (std::abs(p.x.x() - 0.025) < width / 2) p.F = stretched_to({}, 1e3);
    return points;
  }
};

/// d by column.
std::map<double, double> profile(const mpm::Simulation& simulation) {
  std::map<double, double> d;
  for (const auto& p : simulation.state()) d[std::round(p.position.x() / 0.025) * 0.025] = p.damage;
  return d;
}

/// The tail of a profile: d = exp(-(x - edge)/l) fitted where d goes from 0.2 to 0.02.
struct Tail {
  double length, edge;
};
Tail tail(const std::map<double, double>& d) {
  double n = 0, x1 = 0, y1 = 0, xx = 0, xy = 0;
  for (const auto& [x, value] : d)
    if (x > 0 && value < 0.2 && value > 0.02) {
      const double y = std::log(value);
      n++;
      x1 += x;
      y1 += y;
      xx += x * x;
      xy += x * y;
    }
  const double slope = (n * xy - x1 * y1) / (n * xx - x1 * x1);
  return {-1 / slope, x1 / n - y1 / n / slope};
}

/// Per area and G: int (d^2 + l^2 d'^2)/(2 l) dx, which is int (d^2/(4 l0) + l0 d'^2) dx (Wolper et al. 2019, eq. 5).
double surface_energy(const std::map<double, double>& d, double length) {
  double energy = 0;
  for (auto a = d.begin(), b = std::next(a); b != d.end(); a++, b++) {
    const double h = b->first - a->first, slope = (b->second - a->second) / h, middle = (b->second + a->second) / 2;
    energy += h * (middle * middle + length * length * slope * slope) / (2 * length);
  }
  return energy;
}

/// A broken band of width W costs 1 + W/(2 l) times G. The nodes that a broken column of particles reaches are all broken, so
/// that W is 2.8 to 2.9 cells however thin the column, and the cost comes down to G only as l grows beyond the cell:
///
///   l/dx          8      4      2      1     1/2
///   cost/G       1.18   1.36   1.69   2.29   3.50     (l = 2 l0: the default of phase-field, l0 = dx/2, is l = dx)
///   decay/l - 1  0.002  0.007  0.026  0.10   0.44
TEST(CrackProfile, DecaysOverTheLengthOfTheLawAndCostsItsEnergy) {
  for (double cells : {8.0, 4.0, 2.0, 1.0, 0.5}) {
    const double dx = CrackedStrip::dx, length = cells * dx;
    CrackedStrip s(length, "implicit");
    const auto simulation = s.start();
    for (int i = 0; i < 50; i++) simulation->step(100);
    const auto d = profile(*simulation);
    const double decay = tail(d).length / length, cost = surface_energy(d, length);
    const bool resolved = cells >= 2;
    const std::string problem = fmt::format("exp(-x/l), l = {:g} dx", cells);
    report({.row = 12,
            .problem = problem,
            .quantity = "length of the decay / l",
            .reference = 1,
            .measured = decay,
            .tolerance = resolved ? 0.13 / (cells * cells) : 0,
            .judged = resolved ? Judged::within : Judged::shown});
    report({.row = 12,
            .problem = problem,
            .quantity = "surface energy / G",
            .reference = 1,
            .measured = cost,
            .judged = Judged::shown});
    if (resolved)
      report({.row = 12,
              .problem = problem,
              .quantity = "the same less a broken band of 2.85 cells",
              .reference = 1,
              .measured = cost - 2.85 / (2 * cells),
              .tolerance = 0.075 / cells});
  }
}

/// The clamp against healing lets damage grow where particles and nodes disagree, and nothing pulls it back. At rest that has
/// to come to an end: the shoulders of the band fill up within some steps, the tail stays.
TEST(CrackProfile, StaysWhenNothingHappens) {
  const double length = 4 * CrackedStrip::dx;
  CrackedStrip s(length, "implicit");
  const auto simulation = s.start();
  simulation->step(1);
  const Tail first = tail(profile(*simulation));
  double cost[2];
  for (int i : {0, 1}) {
    for (int k = 0; k < 200; k++) simulation->step(100);
    cost[i] = surface_energy(profile(*simulation), length);
  }
  const Tail last = tail(profile(*simulation));
  EXPECT_NEAR(last.edge, first.edge, 1e-6);
  EXPECT_NEAR(last.length, first.length, 1e-6);
  EXPECT_LT(cost[0], 1.4);
  EXPECT_NEAR(cost[1], cost[0], 1e-3);
}

/// Far from a broken band the integrators agree on the decay. They differ in where the band's edge is: the implicit one,
/// whose driving force acts on nodes, puts it almost a cell outside, the explicit ones, whose force acts on particles but which
/// see the band smoothed, a cell inside.
TEST(CrackProfile, HasTheSameTailWithAllIntegrators) {
  const double dx = CrackedStrip::dx, length = 3 * dx, eta = 1e-2, width = 4 * dx, edge = 0.2;
  struct Variant {
    const char* integration;
    config::Laplacian laplacian;
    double outside;
  };
  for (const Variant v : {Variant{"implicit", config::Laplacian::weak, 0.8}, Variant{"explicit", config::Laplacian::weak, -0.9},
                          Variant{"explicit", config::Laplacian::cubic, -0.9}}) {
    CrackedStrip s(length, v.integration, v.laplacian, eta, width);
    const auto simulation = s.start();
    run(*simulation, 20 * eta);
    const Tail t = tail(profile(*simulation));
    EXPECT_NEAR(t.length, length, 0.04 * length);
    EXPECT_NEAR((t.edge - edge) / dx, v.outside, 0.2);
  }
}

/// A bar of two bodies: the left one half as tough as the material, the right one twice.
struct UnevenBar : DamageScene {
  static constexpr double dx = 0.1;
  UnevenBar(const Solid& solid, const PhaseField& law, const Matrix3& F, double stretching)
      : DamageScene(2, dx, half(-1.6, 0, F, stretching), solid, law) {
    config::Body right = scene.bodies[0];
    right.name = "right";
    right.particle_file = right.particle_file->parent_path() / "right.csv";
    write_particles(*right.particle_file, half(0, 1.6, F, stretching));
    scene.bodies.push_back(right);
    for (int i : {0, 1})
      scene.bodies[std::size_t(i)].toughness = scene::VariationSpec{.size = 1, .minimum = factor[i], .maximum = factor[i]};
  }
  static constexpr double factor[2] = {0.5, 2};

 private:
  static std::vector<Point> half(double low, double high, const Matrix3& F, double stretching) {
    auto points = lattice(2, dx, 2, Vector3(low, -0.2, 0), Vector3(high, 0.2, 0));
    for (auto& p : points) {
      p.v.x() = stretching * p.x.x();
      p.F = F;
    }
    return points;
  }
};

/// At rest in one strain: D goes as 1/toughness in the phase field, and d = D/(1 + D) beyond what neighbours smear.
TEST(Toughness, ScalesTheDrivingForceOfEachParticle) {
  const double D = 2;
  const Solid solid;
  const PhaseField law{.l0 = 1e-5, .eta = 1e-9, .residual = 0};
  UnevenBar s(solid, law, stretched_to(solid, law.energy(D)), 0);
  s.hold(-10, 10);
  const auto simulation = s.start();
  simulation->step(1);
  for (const auto& p : simulation->state()) {
    if (std::abs(p.position.x()) < 3 * UnevenBar::dx) continue;
    const double toughness = UnevenBar::factor[p.body];
    ASSERT_NEAR(p.damage, D / (D + toughness), 1e-6);
  }
}

/// Pulled slowly, the bar breaks on its weak side.
TEST(Toughness, DecidesWhereABarBreaks) {
  UnevenBar s({.E = 1e5}, {.G = 20, .l0 = 0.05, .eta = 1e-4, .residual = 0.01}, Matrix3::Identity(), 0.1);
  s.hold(-2, -1.4, Vector3(-0.15, 0, 0));
  s.hold(1.4, 2, Vector3(0.15, 0, 0));
  const auto simulation = s.start();
  double highest[2] = {0, 0};
  while (highest[0] < 0.95 && highest[1] < 0.95 && simulation->time() < 4) {
    simulation->step(4);
    for (const auto& p : simulation->state())
      if (std::abs(p.position.x()) > 3 * UnevenBar::dx) highest[p.body] = std::max(highest[p.body], p.damage);
  }
  EXPECT_GT(highest[0], 0.95);
  EXPECT_LT(highest[1], 0.3);
}

}  // namespace
}  // namespace cleave::test
