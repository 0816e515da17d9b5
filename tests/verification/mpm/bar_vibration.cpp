// Axial vibration of a clamped-free bar in its first mode (validation problem 1).
//
// rho u_tt = E u_xx, u(0) = 0, u_x(L) = 0, u_t(x, 0) = v0 sin(pi x / 2L)  =>  u = v0/omega sin(pi x / 2L) sin(omega t),
// omega = pi c / 2L, c = sqrt(E/rho); the mean of sin over the bar is 2/pi, so the centre of mass moves with
// (2/pi) v0 cos(omega t). Poisson's ratio is zero, so that the two-dimensional bar is the one-dimensional one.

#include "scenes.hpp"

#include "figure.hpp"

#include <gtest/gtest.h>

namespace cleave::test {
namespace {

constexpr double L = 25, E = 100, rho = 1, v0 = 0.1;
const double omega = M_PI * std::sqrt(E / rho) / (2 * L);

struct Vibration {
  double velocity_error = 0;  ///< rms over one period, relative to the amplitude
  double period_error = 0;    ///< relative
  double energy_drift = 0;    ///< relative, after ten periods
};

Vibration vibrate(double dx, const std::string& law) {
  // the clamp is half a cell of fixed grid: nodes at x <= 0
  auto points = lattice(2, dx, 2, Vector3(0, -dx, 0), Vector3(L, dx, 0));
  for (auto& p : points) p.v.x() = v0 * std::sin(M_PI * p.x.x() / (2 * L));
  PointScene s(2, dx, points, law, {{"youngs_modulus", E}, {"poissons_ratio", 0.0}}, rho);
  s.scene.colliders.push_back(half_space(config::Contact::sticky, Vector3(1, 0, 0), Vector3(1e-9, 0, 0)));
  s.scene.simulation.time_step = 0.2 * dx / std::sqrt(E / rho);
  auto simulation = s.start();
  const double period = 2 * M_PI / omega;
  const auto first = simulation->measure();
  Vibration r;
  double squares = 0, crossing = 0, last_t = 0, last_v = 0;
  int samples = 0;
  while (simulation->time() < 10 * period) {
    simulation->step(10 * period);
    const double t = simulation->time();
    const auto m = simulation->measure();
    const double v = m.momentum.x() / m.mass;
    if (t <= period) {
      const double e = v - 2 / M_PI * v0 * std::cos(omega * t);
      squares += e * e;
      samples++;
    }
    if (last_v < 0 && v >= 0) crossing = last_t + (t - last_t) * -last_v / (v - last_v);  // at 3/4 + n periods
    last_t = t;
    last_v = v;
    r.energy_drift = (m.kinetic_energy + m.elastic_energy) / (first.kinetic_energy + first.elastic_energy) - 1;
  }
  r.velocity_error = std::sqrt(squares / samples) / (2 / M_PI * v0);
  r.period_error = crossing / (9.75 * period) - 1;
  return r;
}

TEST(BarVibration, FollowsTheFirstMode) {
  for (const char* law : {"elasticity/split-neo-hookean", "elasticity/fixed-corotated"}) {
    const Vibration coarse = vibrate(1.0, law), fine = vibrate(0.5, law);
    const std::string problem = std::string("bar, ") + (law + 11) + ", dx = L/50";
    report({.row = 1,
            .problem = problem,
            .quantity = "period error over 10 periods",
            .measured = fine.period_error,
            .tolerance = 0.01,
            .order = order_of(coarse.period_error, fine.period_error)});
    report({.row = 1,
            .problem = problem,
            .quantity = "rms error of the velocity / amplitude",
            .measured = fine.velocity_error,
            .tolerance = 0.03,
            .order = order_of(coarse.velocity_error, fine.velocity_error)});
    EXPECT_LT(fine.velocity_error, 0.75 * coarse.velocity_error) << law;
    report({.row = 1,
            .problem = problem,
            .quantity = "change of energy in 10 periods",
            .measured = fine.energy_drift,
            .tolerance = 0.05});  // APIC damps the mode slightly
    EXPECT_LT(fine.energy_drift, 1e-3) << law << ": energy must not grow";
  }
}

}  // namespace
}  // namespace cleave::test
