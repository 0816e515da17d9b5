// Rigid motion, free flight, reproducibility and precision (validation problem 5).

#include "scenes.hpp"

#include "figure.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

namespace cleave::test {
namespace {

const plugins::GivenParameters rubber = {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}};

std::vector<Point> spinning_block(int dimension, double dx, const Vector3& omega, const Vector3& drift) {
  auto points = lattice(dimension, dx, 2, Vector3(-0.4, -0.3, -0.2), Vector3(0.4, 0.3, 0.2));
  for (auto& p : points) p.v = drift + omega.cross(p.x);
  return points;
}

TEST(FreeFlight, KeepsMomentumToRounding) {
  for (int dimension : {2, 3}) {
    const Vector3 omega = dimension == 3 ? Vector3(1, -2, 3) : Vector3(0, 0, 3);
    PointScene s(dimension, 0.1, spinning_block(dimension, 0.1, omega, Vector3(1.5, -0.5, dimension == 3 ? 0.25 : 0)),
                 "elasticity/split-neo-hookean", rubber, 1000);
    auto simulation = s.start();
    const auto before = simulation->measure();
    while (simulation->time() < 0.2) simulation->step(0.2);
    const auto after = simulation->measure();
    report({.row = 5,
            .problem = "spinning block, " + std::to_string(dimension) + "D",
            .quantity = "change of momentum",
            .measured = (after.momentum - before.momentum).norm() / before.momentum.norm(),
            .tolerance = 1e-12,
            .scatter = any});
    EXPECT_NEAR(after.mass, before.mass, 1e-13 * before.mass);
    EXPECT_LT((after.center_of_mass - before.center_of_mass - 0.2 * before.momentum / before.mass).norm(), 1e-12);
  }
}

TEST(FreeFlight, ApicKeepsAngularMomentumAndPicLosesIt) {
  std::vector<double> kept;
  for (auto transfer : {config::Transfer::apic, config::Transfer::pic}) {
    PointScene s(3, 0.1, spinning_block(3, 0.1, Vector3::Zero(), Vector3::Zero()), "elasticity/split-neo-hookean", rubber,
                 1000);
    s.scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 3);
    s.scene.simulation.transfer = transfer;
    auto simulation = s.start();
    const double before = simulation->measure().angular_momentum.z();
    for (int i = 0; i < 100; i++) simulation->step(1);
    kept.push_back(simulation->measure().angular_momentum.z() / before);
  }
  const char* quantity = "angular momentum kept in 100 steps";
  report({.row = 5,
          .problem = "spinning block, apic",
          .quantity = quantity,
          .reference = 1,
          .measured = kept[0],
          .tolerance = 1e-12});
  report({.row = 5,
          .problem = "spinning block, pic",
          .quantity = quantity,
          .reference = 0.99,
          .measured = kept[1],
          .judged = Judged::at_most,
          .scatter = any});
}

TEST(RigidRotation, MakesNoStress) {
  // half a radian; what strain there is comes from the centrifugal force, rho omega^2 R^2 / E = 2.5e-5
  for (const char* law : {"elasticity/split-neo-hookean", "elasticity/fixed-corotated"})
    for (int dimension : {2, 3}) {
      auto points = spinning_block(dimension, 0.1, Vector3::Zero(), Vector3::Zero());
      PointScene s(dimension, 0.1, points, law, {{"youngs_modulus", 1e7}, {"poissons_ratio", 0.3}}, 1000);
      s.scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 1);
      auto simulation = s.start();
      while (simulation->time() < 0.5) simulation->step(0.5);
      double largest = 0, turned = 0;
      const auto state = simulation->state();
      for (std::size_t i = 0; i < state.size(); i++) {
        const auto& p = state[i];
        const Matrix3 b = p.stores_b ? p.strain : Matrix3(p.strain * p.strain.transpose());
        largest = std::max(largest, (b - Matrix3::Identity()).norm());
        const Vector3 expected = Eigen::AngleAxisd(0.5, Vector3::UnitZ()) * points[i].x;
        turned = std::max(turned, (p.position - expected).norm());
      }
      const std::string problem =
          std::string("turning by half a radian, ") + (law + 11) + ", " + std::to_string(dimension) + "D";
      report({.row = 5,
              .problem = problem,
              .quantity = "largest strain, of which 5e-5 is centrifugal",
              .measured = largest,
              .tolerance = 5e-4,
              .judged = Judged::at_most,
              .scatter = 0.05});
      report({.row = 5,
              .problem = problem,
              .quantity = "largest distance from the rotated place, m",
              .measured = turned,
              .tolerance = 1e-3,
              .judged = Judged::at_most,
              .scatter = 0.05});
    }
}

TEST(Reproducibility, ThreadsDoNotChangeABit) {
  for (bool single : {true, false}) {
    std::vector<std::vector<mpm::ParticleState>> runs;
    for (std::size_t threads : {1, 2, 3}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      PointScene s(3, 0.05, spinning_block(3, 0.05, Vector3(1, -2, 3), Vector3(4, 0, 1)), "elasticity/split-neo-hookean",
                   rubber, 1000);
      s.scene.simulation.precision = single ? config::Precision::single_precision : config::Precision::double_precision;
      s.scene.simulation.gravity = Vector3(0, 0, -9.81);
      auto simulation = s.start();
      for (int i = 0; i < 60; i++) simulation->step(10);
      runs.push_back(simulation->state());
    }
    for (std::size_t r = 1; r < runs.size(); r++)
      for (std::size_t i = 0; i < runs[0].size(); i++) {
        ASSERT_EQ(runs[r][i].position, runs[0][i].position);
        ASSERT_EQ(runs[r][i].velocity, runs[0][i].velocity);
        ASSERT_EQ(runs[r][i].strain, runs[0][i].strain);
      }
  }
}

TEST(SinglePrecision, FarFromTheOriginIsAsGoodAsAtIt) {
  // ten thousand blocks away; without block-relative positions single precision would resolve 1/200 of a cell there
  const double dx = 1.0 / 64;  // exact in binary, so that the shift is exact too
  const Vector3 shift = Vector3(1e4, -2e4, 1.5e4) * 4 * dx;
  std::vector<std::vector<mpm::ParticleState>> runs;
  for (const Vector3& offset : {Vector3(0, 0, 0), shift}) {
    auto points = lattice(3, dx, 2, Vector3(-8, -6, -4) * dx, Vector3(8, 6, 4) * dx);
    for (auto& p : points) {
      p.v = Vector3(1, 0.5, -0.25) + Vector3(0, 0, 3).cross(p.x);
      p.x += offset;
    }
    PointScene s(3, dx, points, "elasticity/split-neo-hookean", rubber, 1000);
    s.scene.simulation.precision = config::Precision::single_precision;
    auto simulation = s.start();
    for (int i = 0; i < 100; i++) simulation->step(1);
    runs.push_back(simulation->state());
  }
  for (std::size_t i = 0; i < runs[0].size(); i++) {
    ASSERT_LT((runs[1][i].position - shift - runs[0][i].position).norm(), 1e-4 * dx);
    ASSERT_LT((runs[1][i].velocity - runs[0][i].velocity).norm(), 1e-4);
  }
}

TEST(SinglePrecision, FollowsDoublePrecision) {
  std::vector<std::vector<mpm::ParticleState>> runs;
  for (bool single : {true, false}) {
    PointScene s(3, 0.05, spinning_block(3, 0.05, Vector3(1, -2, 3), Vector3(1, 0, 0)), "elasticity/split-neo-hookean", rubber,
                 1000);
    s.scene.simulation.precision = single ? config::Precision::single_precision : config::Precision::double_precision;
    s.scene.simulation.time_step = 1e-3;
    auto simulation = s.start();
    for (int i = 0; i < 200; i++) simulation->step(0.2);
    runs.push_back(simulation->state());
  }
  for (std::size_t i = 0; i < runs[0].size(); i++) ASSERT_LT((runs[1][i].position - runs[0][i].position).norm(), 1e-4 * 0.05);
}

TEST(Units, ScalingLengthTimeAndMassChangesNothing) {
  // the same motion in a world a million times smaller, with densities and moduli to match: single precision must not care
  std::vector<std::vector<mpm::ParticleState>> runs;
  const double length = 1e-6, density = 1e-3;
  for (bool scaled : {false, true}) {
    const double l = scaled ? length : 1, rho = scaled ? density : 1;
    auto points = lattice(3, 0.1 * l, 2, Vector3(-0.4, -0.3, -0.2) * l, Vector3(0.4, 0.3, 0.2) * l);
    for (auto& p : points) p.v = l * Vector3(1, 0.5, -0.25) + Vector3(0, 0, 3).cross(p.x);
    PointScene s(3, 0.1 * l, points, "elasticity/split-neo-hookean",
                 {{"youngs_modulus", 1e5 * rho * l * l}, {"poissons_ratio", 0.3}}, 1000 * rho);
    s.scene.simulation.precision = config::Precision::single_precision;
    s.scene.simulation.time_step = 1e-3;
    auto simulation = s.start();
    for (int i = 0; i < 100; i++) simulation->step(0.1);
    runs.push_back(simulation->state());
  }
  for (std::size_t i = 0; i < runs[0].size(); i++) ASSERT_LT((runs[1][i].position / length - runs[0][i].position).norm(), 1e-4);
}

}  // namespace
}  // namespace cleave::test
