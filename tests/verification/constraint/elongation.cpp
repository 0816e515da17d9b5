// Fibers that keep their length: what a projection leaves, and what adds up over many of them.

#include "constraint_scenes.hpp"

#include <Eigen/LU>
#include <iostream>

namespace cleave::test {
namespace {

constexpr double dx = 0.1;
const plugins::GivenParameters soft = {{"youngs_modulus", 2e4}, {"poissons_ratio", 0.3}};

/// A bar with fibers along it.
struct Bar : Constrained {
  Bar(int dimension, double stabilization, const std::string& transport = "convected")
      : Constrained(dimension, dx, lattice(dimension, dx, 2, Vector3(-0.5, -0.1, -0.1), Vector3(0.6, 0.1, 0.1)),
                    "elasticity/split-neo-hookean", soft, 1000) {
    scene.simulation.time_step = 7e-4;
    lay_fibers(Vector3::UnitX());
    constrain("constraint/inextensibility", {{"stabilization", stabilization}, {"fiber_transport", transport}});
  }
};

struct Motion {
  double elongation = 0;  ///< mean of |F a0| - 1 after all steps, a third of the bar at the end that may be held left out
  double spread = 0;      ///< and its standard deviation: particles of a cell may differ
  double residual = 0, iterations = 0;
  double momentum = 0;  ///< largest change, relative to sum m |v|
  double energy = 0;    ///< largest over that at the start
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
    result.energy = std::max(result.energy, energy(record) / energy(before));
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
            << m.iterations << " iterations a step\n";
}

class Elongation : public testing::TestWithParam<int> {};

/// Two thirds of a turn in a thousand steps. |I + dt W| > 1 for each turn by dt W: what is linear in dt is not all there is.
TEST_P(Elongation, OfASpinningBarStaysSmall) {
  const int dimension = GetParam();
  const auto spin = [&](double stabilization, const char* transport) {
    Bar bar(dimension, stabilization, transport);
    bar.scene.bodies[0].velocity = Vector3(1, 2, 0);
    bar.scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 6);
    const Motion m = move(bar, 1000);
    print(std::to_string(dimension) + "D spinning, " + transport + ", stabilization " + std::to_string(stabilization), m);
    EXPECT_LE(m.residual, 1e-6);
    EXPECT_LT(m.momentum, 1e-11) << "m/s";
    EXPECT_LE(m.energy, 1 + 1e-3);
    return m;
  };
  const Motion kept = spin(0.1, "convected"), drifting = spin(0, "convected");
  EXPECT_LT(std::abs(kept.elongation), 1e-3);
  EXPECT_LT(std::abs(kept.elongation), 0.1 * std::abs(drifting.elongation));
  EXPECT_LT(std::abs(spin(0.1, "rotated").elongation), 1e-3);
}

/// It swings down from the horizontal about its held end, where it bends by a right angle. Across the two cells of its width a
/// constraint sees no bending, in which some fibers lengthen as others shorten.
TEST_P(Elongation, OfAPendulumIsTakenBack) {
  const int dimension = GetParam();
  const auto swing = [&](double stabilization) {
    Bar bar(dimension, stabilization);
    bar.scene.simulation.gravity = Vector3(0, -9.81, 0);
    bar.hold(Vector3(-0.5, 0, 0), Vector3(0.2, 0.1, 1));
    const Motion m = move(bar, 1000);
    print(std::to_string(dimension) + "D pendulum, stabilization " + std::to_string(stabilization), m);
    EXPECT_LE(m.residual, 1e-6);
    return m;
  };
  const Motion kept = swing(0.1), drifting = swing(0);
  EXPECT_LT(std::abs(kept.elongation), 1.5e-3);
  EXPECT_LT(std::abs(kept.elongation), 0.5 * std::abs(drifting.elongation));
}

INSTANTIATE_TEST_SUITE_P(Dimension, Elongation, testing::Values(2, 3), testing::PrintToStringParamName());

}  // namespace
}  // namespace cleave::test
