// Manufactured solutions (problems 2 and 3): a motion is chosen, and the body force that makes it one is put on the particles
// (tests/fixtures/plugins/body_force.cpp has the formulas). Velocities of symplectic Euler are those half a step before the
// positions: so are the ones that motions start with.

#include "scenes.hpp"

#include "figure.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

namespace cleave::test {
namespace {

struct Material {
  double E, nu, density;
  double mu() const { return E / (2 * (1 + nu)); }
  double kappa() const { return E / (3 * (1 - 2 * nu)); }
  /// Of waves that do not contract sideways, m/s.
  double speed() const { return std::sqrt((kappa() + 4 * mu() / 3) / density); }
};

struct Manufactured : PointScene {
  Manufactured(double dx, const std::vector<Point>& points, const Material& m, const char* kind, double amplitude)
      : PointScene(2, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", m.E}, {"poissons_ratio", m.nu}},
                   m.density) {
    config::PluginUse force;
    force.id = "constraint/body-force";
    force.parameters = {{"kind", std::string(kind)},
                        {"density", m.density},
                        {"shear_modulus", m.mu()},
                        {"bulk_modulus", m.kappa()},
                        {"amplitude", amplitude}};
    scene.materials[0].constraint = force;
  }
  void transfer_by(const std::string& name) {
    scene.simulation.transfer = name == "apic" ? config::Transfer::apic : config::Transfer::flip;
    scene.simulation.flip_ratio = 1;
  }
};

/// Root of the mean square, over particles and steps, of the distance from where the solution puts them.
template <class Exact>
double distance(const Manufactured& s, const std::vector<Point>& points, double end, double step, Exact&& exact) {
  const auto simulation = s.start();
  double squares = 0, count = 0;
  while (simulation->time() < end - step / 2) {
    simulation->step(end);
    if (simulation->steps() % 8 != 0) continue;
    const auto state = simulation->state();
    for (std::size_t i = 0; i < state.size(); i++) {
      squares += (state[i].position - exact(points[i].x, simulation->time())).squaredNorm();
      count++;
    }
  }
  return std::sqrt(squares / count);
}

/// u = A sin(pi X) sin(pi c t) in 0 < X < 1 for one period. The ends move as the solution does when it is continued: a wall
/// would be met to first order only, as the stencils that it cuts are.
double wave_error(int cells, double amplitude, const std::string& transfer) {
  const Material m{.E = 1, .nu = 0, .density = 1};
  const double dx = 1.0 / cells, omega = M_PI * m.speed(), period = 2 * M_PI / omega;
  const int steps = 10 * cells;  // a fifth of dx/c each
  const double dt = period / steps;
  auto points = lattice(2, dx, 2, Vector3(0, 0, 0), Vector3(1, 2 * dx, 0));
  auto started = points;
  for (auto& p : started) {
    p.v.x() = amplitude * omega * std::cos(omega * dt / 2) * std::sin(M_PI * p.x.x());
    p.v.y() = 1e-300;  // velocities are the points' own even where all are at rest
  }
  Manufactured s(dx, started, m, "wave", amplitude);
  s.transfer_by(transfer);
  s.scene.simulation.time_step = dt;
  return distance(s, points, period, dt,
                  [&](Vector3 X, double t) {
                    X.x() += amplitude * std::sin(M_PI * X.x()) * std::sin(omega * t);
                    return X;
                  }) /
         (amplitude / 2);  // the root of the mean square of u itself
}

/// Errors at halved spacings, from dx = 1/first to 1/last; the order between the two finest.
template <class Error>
double refine(int row, const std::string& problem, const char* quantity, int first, int last, double tolerance, Error&& error) {
  double before = 0, order = 0;
  for (int cells = first; cells <= last; cells *= 2) {
    Figure f{.row = row,
             .problem = fmt::format("{}, dx = 1/{}", problem, cells),
             .quantity = quantity,
             .measured = error(cells),
             .tolerance = tolerance,
             .judged = Judged::at_most};
    if (cells > first) f.order = order = order_of(before, f.measured);
    before = f.measured;
    report(f);
  }
  return order;
}

TEST(ManufacturedWave, ConvergesToSecondOrder) {
  for (const std::string transfer : {"apic", "flip"}) {
    const std::string problem = "wave of 0.001, " + transfer;
    const double order = refine(2, problem, "L2 error of u / L2 of u", 8, 64, 0.12,
                                [&](int cells) { return wave_error(cells, 1e-3, transfer); });
    report({.row = 2,
            .problem = problem,
            .quantity = "order from dx = 1/32 to 1/64",
            .reference = 1.8,
            .measured = order,
            .judged = Judged::at_least});
  }
}

/// Particles that stray from the places that share a cell evenly make errors of quadrature, which no smaller cells take away.
TEST(ManufacturedWave, SaturatesWhereParticlesLeaveTheirPlaces) {
  const double order = refine(2, "wave of 0.05, apic", "L2 error of u / L2 of u", 8, 64, 0.12,
                              [](int cells) { return wave_error(cells, 0.05, "apic"); });
  EXPECT_LT(order, 1.6);
}

/// A ring 0.75 < R < 1.25 that turns back and forth, each radius by its own angle, and keeps its volume, until it has turned
/// farthest. Its surfaces are at rest, as is what lies beyond: what the quadrature of a force a thousand times that of inertia
/// leaves of a torque would turn a free ring.
double vortex_error(int cells, double amplitude) {
  const Material m{.E = 1e6, .nu = 0.3, .density = 1050};
  const double dx = 1.0 / cells, end = 0.5;
  const int steps = int(std::ceil(end / (0.4 * dx / m.speed())));
  const double dt = end / steps;
  const auto shape = [](double R) {
    const double s = R - 1;
    return std::abs(s) < 0.25 ? 1 - 32 * s * s + 256 * s * s * s * s : 0;
  };
  auto points = lattice(2, dx, 2, Vector3(-1.5, -1.5, 0), Vector3(1.5, 1.5, 0));
  std::erase_if(points, [&](const Point& p) { return std::abs(p.x.norm() - 1) > 0.25 + 3 * dx; });
  auto started = points;
  for (auto& p : started) p.v = amplitude * M_PI * std::cos(M_PI * dt / 2) * shape(p.x.norm()) * Vector3(-p.x.y(), p.x.x(), 0);
  Manufactured s(dx, started, m, "vortex", amplitude);
  s.scene.simulation.time_step = dt;
  config::Handle inner, outer;
  inner.name = "inner";
  inner.region.type = scene::ShapeSpec::Type::sphere;
  inner.region.radius = 0.75;
  outer.name = "outer";
  outer.region.type = scene::ShapeSpec::Type::tube;
  outer.region.radius = 3;
  outer.region.inner_radius = 1.25;
  outer.region.height = 1;
  s.scene.handles = {inner, outer};
  return distance(s, points, end, dt, [&](const Vector3& X, double t) {
    const double alpha = amplitude * std::sin(M_PI * t) * shape(X.norm());
    return Vector3(Eigen::AngleAxisd(alpha, Vector3::UnitZ()) * X);
  });
}

TEST(GeneralisedVortex, ConvergesToSecondOrder) {
  for (double amplitude : {0.001, 0.1})
    refine(3, fmt::format("turning by {:g}", amplitude), "L2 error of x / amplitude, m", 12, amplitude < 0.01 ? 48 : 24, 0.2,
           [&](int cells) { return vortex_error(cells, amplitude) / amplitude; });
}

}  // namespace
}  // namespace cleave::test
