// Fibers that keep their length: what a projection leaves, and what adds up over many of them.

#include "constraint_scenes.hpp"

#include "figure.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <iostream>

namespace cleave::test {
namespace {

constexpr double dx = 0.1;
const plugins::GivenParameters soft = {{"youngs_modulus", 2e4}, {"poissons_ratio", 0.3}};

/// A bar with fibers along it.
struct Bar : Constrained {
  Bar(int dimension, double stabilization, const std::string& kept = "length", const std::string& transport = "convected")
      : Constrained(dimension, dx, lattice(dimension, dx, 2, Vector3(-0.5, -0.1, -0.1), Vector3(0.6, 0.1, 0.1)),
                    "elasticity/split-neo-hookean", soft, 1000) {
    scene.simulation.time_step = 7e-4;
    lay_fibers(Vector3::UnitX());
    constrain("constraint/inextensibility", {{"stabilization", stabilization}, {"kept", kept}, {"fiber_transport", transport}});
  }
};

struct Motion {
  double elongation = 0;  ///< mean of |F a0| - 1 after all steps, a third of the bar at the end that may be held left out
  double spread = 0;      ///< and its standard deviation: particles of a cell may differ
  double residual = 0, iterations = 0;
  double momentum = 0;  ///< largest change, relative to sum m |v|
  double energy = 0;    ///< largest gain over that at the start, J/kg
};
Motion move(const Bar& bar, int steps) {
  const auto simulation = bar.start();
  const auto energy = [](const output::FrameRecord& r) { return r.kinetic_energy + r.elastic_energy + r.gravity_energy; };
  const auto before = simulation->measure();
  Motion result;
  for (int i = 0; i < steps; i++) {
    simulation->step(10);
    const auto record = simulation->measure();
    result.residual = std::max(result.residual, record.constraint_residual);
    result.iterations += record.constraint_iterations / steps;
    result.momentum = std::max(result.momentum, (record.momentum - before.momentum).norm() / before.mass);
    result.energy = std::max(result.energy, (energy(record) - energy(before)) / before.mass);
  }
  double sum = 0, squares = 0, volume = 0;
  for (const auto& p : simulation->state()) {
    if (3 * p.id < simulation->particles()) continue;
    const double e = (p.strain * Vector3::UnitX()).norm() - 1;
    sum += p.volume * e;
    squares += p.volume * e * e;
    volume += p.volume;
  }
  result.elongation = sum / volume;
  result.spread = std::sqrt(std::max(0.0, squares / volume - result.elongation * result.elongation));
  return result;
}

void print(const std::string& what, const Motion& m) {
  std::cout << what << ": elongation " << m.elongation << ", spread " << m.spread << ", residual " << m.residual << ", "
            << m.iterations << " iterations a step, energy " << m.energy << " J/kg\n";
}

class Elongation : public testing::TestWithParam<int> {};

/// Two thirds of a turn in a thousand steps. |I + dt W| > 1 for each turn by dt W: what is linear in dt is not all there is.
TEST_P(Elongation, OfASpinningBarStaysSmall) {
  const int dimension = GetParam();
  const auto spin = [&](double stabilization, const char* kept, const char* transport = "convected") {
    Bar bar(dimension, stabilization, kept, transport);
    bar.scene.bodies[0].velocity = Vector3(1, 2, 0);
    bar.scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 6);
    const Motion m = move(bar, 1000);
    print(std::to_string(dimension) + "D spinning, " + kept + ", " + transport + ", stabilization " +
              std::to_string(stabilization),
          m);
    report({.row = 21,
            .problem =
                fmt::format("spinning bar, {}D, kept: {}, stabilization {:g}, {}", dimension, kept, stabilization, transport),
            .quantity = "residual of a projection",
            .measured = m.residual,
            .tolerance = 1e-6,
            .judged = Judged::at_most,
            .scatter = any});
    EXPECT_LT(m.momentum, 1e-11) << "m/s";
    EXPECT_LE(m.energy, 1e-3 * 2.5) << "of (1^2 + 2^2) / 2 J/kg";
    return std::abs(m.elongation);
  };
  const double drift = spin(0, "rate"), taken_back = spin(0.1, "rate");
  const std::string problem = fmt::format("spinning bar, {}D, 1000 steps", dimension);
  report({.row = 21,
          .problem = problem,
          .quantity = "mean elongation of fibers",
          .measured = spin(0.1, "length"),
          .tolerance = 2e-4,
          .scatter = 0.1});
  report({.row = 21,
          .problem = problem,
          .quantity = "the same of rates alone, no stabilization",
          .measured = drift,
          .judged = Judged::shown,
          .scatter = 0.1});
  EXPECT_LT(spin(0, "length"), 0.02 * drift);
  EXPECT_LT(taken_back, 0.1 * drift);
  EXPECT_LT(spin(0.1, "length", "rotated"), 2e-4);
}

/// It swings down from the horizontal about its held end, where it bends by a right angle. Across the two cells of its width a
/// constraint sees no bending, in which some fibers lengthen as others shorten.
TEST_P(Elongation, OfAPendulumIsHeld) {
  const int dimension = GetParam();
  const auto swing = [&](double stabilization, const char* kept) {
    Bar bar(dimension, stabilization, kept);
    bar.scene.simulation.gravity = Vector3(0, -9.81, 0);
    bar.hold(Vector3(-0.5, 0, 0), Vector3(0.2, 0.1, 1));
    const Motion m = move(bar, 1000);
    print(std::to_string(dimension) + "D pendulum, " + kept + ", stabilization " + std::to_string(stabilization), m);
    EXPECT_LE(m.residual, 1e-6);
    EXPECT_LT(m.energy, 1e-3 * 9.81 * 0.5) << "of what it falls by";
    return std::abs(m.elongation);
  };
  const double drift = swing(0, "rate"), taken_back = swing(0.1, "rate");
  report({.row = 21,
          .problem = fmt::format("pendulum, {}D, 1000 steps", dimension),
          .quantity = "mean elongation of fibers",
          .measured = swing(0.1, "length"),
          .tolerance = 1e-3,
          .scatter = 0.1});
  EXPECT_LT(swing(0, "length"), 0.2 * drift);
  EXPECT_LT(taken_back, 0.5 * drift);
}

INSTANTIATE_TEST_SUITE_P(Dimension, Elongation, testing::Values(2, 3), testing::PrintToStringParamName());

}  // namespace
}  // namespace cleave::test
