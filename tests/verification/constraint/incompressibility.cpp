// Volumes kept by pressure: the projection by itself, and bodies that bounce and stand.

#include "constraint_scenes.hpp"

#include <cleave/testkit/grid_system.hpp>

#include <Eigen/Dense>
#include <iostream>
#include <map>

namespace cleave::test {
namespace {
namespace kit = testkit;

kit::Projection project(const kit::GridSystem& system, const kit::Settings& settings = {}) {
  static const kit::Plugin plugin(CLEAVE_INCOMPRESSIBILITY);
  const kit::ConstraintInstance law(plugin, settings, system.dimension);
  const kit::Projection result = kit::project(law, system);
  EXPECT_EQ(result.result, CLEAVE_OK) << result.words;
  return result;
}

/// sum V_p div v of the particles in each cell, a row for each cell: B, found by velocities of single nodes.
Eigen::MatrixXd divergence(kit::GridSystem system) {
  const std::size_t d = std::size_t(system.dimension), columns = system.velocity.size();
  std::map<std::array<int, 3>, Eigen::Index> cells;
  std::vector<Eigen::Index> cell_of(system.particle_count());
  for (std::size_t p = 0; p < system.particle_count(); p++) {
    std::array<int, 3> cell{};
    for (std::size_t a = 0; a < d; a++) cell[a] = int(std::floor(system.position[d * p + a]));
    cell_of[p] = cells.try_emplace(cell, Eigen::Index(cells.size())).first->second;
  }
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(Eigen::Index(cells.size()), Eigen::Index(columns));
  for (std::size_t k = 0; k < columns; k++) {
    std::fill(system.velocity.begin(), system.velocity.end(), 0.0);
    system.velocity[k] = 1;
    system.gather_gradients();
    for (std::size_t p = 0; p < system.particle_count(); p++)
      for (std::size_t a = 0; a < d; a++)
        B(cell_of[p], Eigen::Index(k)) += system.volume[p] * system.velocity_gradient[d * d * p + (d + 1) * a];
  }
  return B;
}

using Velocities = Eigen::Map<Eigen::VectorXd>;
double norm(const kit::GridSystem& system, const std::vector<double>& velocity) {
  return std::sqrt(system.product(velocity, velocity));
}

TEST(IncompressibleVelocity, OfZeroDivergenceIsLeftAsItIs) {
  kit::Random random(1);
  for (const int dimension : {2, 3}) {
    kit::GridSystem system =
        random_block(random, {.dimension = dimension, .fibers = kit::Block::none, .strain = kit::Block::rotated});
    const std::size_t d = std::size_t(dimension);
    Matrix3 L;
    for (int i = 0; i < 9; i++) L(i / 3, i % 3) = random.uniform(-1, 1);
    L(0, 0) -= L.topLeftCorner(dimension, dimension).trace();
    for (std::size_t k = 0; k < system.velocity.size(); k++) {
      system.velocity[k] = 0.3;
      for (std::size_t a = 0; a < d; a++) system.velocity[k] += L(int(k % d), int(a)) * double(system.node_cell[k - k % d + a]);
    }
    const kit::Projection result = project(system);
    for (std::size_t k = 0; k < system.velocity.size(); k++) ASSERT_NEAR(result.velocity[k], system.velocity[k], 1e-11);
  }
}

/// M^-1 B^T lambda is what pressures make of rest; all of it goes.
TEST(IncompressibleVelocity, OfAPressureGradientIsZero) {
  kit::Random random(2);
  for (const int dimension : {2, 3}) {
    kit::GridSystem system =
        random_block(random, {.dimension = dimension, .cells = 4, .fibers = kit::Block::none, .strain = kit::Block::rest});
    const Eigen::MatrixXd B = divergence(system);
    Eigen::VectorXd pressure(B.rows());
    for (double& p : pressure) p = random.uniform(-1, 1);
    const Eigen::VectorXd impulse = B.transpose() * pressure;
    for (std::size_t k = 0; k < system.velocity.size(); k++)
      system.velocity[k] = impulse[Eigen::Index(k)] / system.mass[k / std::size_t(dimension)];
    const kit::Projection result = project(system);
    EXPECT_EQ(result.report.rows, std::uint64_t(B.rows()));
    EXPECT_LT(norm(system, result.velocity), 1e-5 * norm(system, system.velocity)) << dimension;
  }
}

TEST(IncompressibleVelocity, CorrectsVolumesWithTheKineticEnergyThereIs) {
  kit::Random random(3);
  kit::GridSystem system = random_block(random, {.fibers = kit::Block::none, .strain = kit::Block::strained});
  const double J = Eigen::Map<const Eigen::Matrix3d>(system.deformation.data()).determinant();
  double volume = 0;
  for (double v : system.volume) volume += v;
  const double asked = -0.2 / system.time_step * (1 - 1 / J) * volume;
  const Eigen::MatrixXd B = divergence(system);
  const auto given = [&](const std::vector<double>& v) {
    return (B * Eigen::Map<const Eigen::VectorXd>(v.data(), Eigen::Index(v.size()))).sum();
  };
  for (double& v : system.velocity) v *= 100;
  const auto fast = project(system, {{"stabilization", 0.2}});
  EXPECT_NEAR(given(fast.velocity), asked, 1e-3 * std::abs(asked)) << "there is enough";
  for (double& v : system.velocity) v *= 1e-4;
  const auto slow = project(system, {{"stabilization", 0.2}});
  EXPECT_NEAR(norm(system, slow.velocity), norm(system, system.velocity), 1e-4 * norm(system, system.velocity)) << "all of it";
  EXPECT_GT(given(slow.velocity) / asked, 1e-4);
  EXPECT_LT(given(slow.velocity) / asked, 0.1);
}

/// A column between walls, whose v* = -g dt is what a pressure rho g h takes away. Walls and floor are half a cell inside of
/// the body, where no node that is free misses a part of its support.
TEST(IncompressibleColumn, CarriesItsWeightByPressure) {
  constexpr int width = 5, height = 16, rows = height + 1;  // in cells; rows of cells, of which the outer ones are half full
  constexpr double g = 9.81, density = 1000;
  std::vector<double> places;
  for (int i = 0; i < 2 * width; i++)
    for (int j = 0; j < 2 * height; j++) places.insert(places.end(), {9.75 + i / 2., 9.75 + j / 2.});
  kit::Random random(4);
  kit::GridSystem system = kit::particles_at(random, 2, places);
  system.normal.assign(system.velocity.size(), 0);
  for (std::size_t n = 0; n < system.node_count(); n++) {
    const int x = system.node_cell[2 * n], y = system.node_cell[2 * n + 1];
    const bool side = x <= 10 || x >= 9 + width, floor = y <= 10;
    system.prescribed[n] = side && floor ? 1 : side || floor ? 2 : 0;
    system.normal[2 * n] = side;
    system.normal[2 * n + 1] = !side && floor;
    system.velocity[2 * n] = 0;
    system.velocity[2 * n + 1] = floor ? 0 : -g * system.time_step;
  }
  const kit::Projection result = project(system, {{"tolerance", 1e-10}});
  double falling = 0;  // where the surface is not near
  for (std::size_t n = 0; n < system.node_count(); n++)
    if (system.node_cell[2 * n + 1] < 9 + height - 4)
      falling = std::max(falling, std::abs(result.velocity[2 * n + 1]) / (g * system.time_step));

  // The multipliers from M (v - v*) = B'^T lambda, with B' the columns that are free.
  Eigen::MatrixXd B = divergence(system);
  ASSERT_EQ(B.rows(), (width + 1) * rows);
  Eigen::VectorXd impulse(B.cols());
  for (Eigen::Index k = 0; k < B.cols(); k++) {
    const auto n = std::size_t(k / 2), row = std::size_t(k);
    impulse[k] = system.mass[n] * (result.velocity[row] - system.velocity[row]);
    if (system.prescribed[n] == 1 || (system.prescribed[n] == 2 && system.normal[row] != 0)) B.col(k).setZero();
  }
  const Eigen::VectorXd lambda = B.transpose().completeOrthogonalDecomposition().solve(impulse);
  const Eigen::Map<const Eigen::MatrixXd> pressure(lambda.data(), rows, width + 1);  // from below
  double error = 0;  // away from floor and surface, relative to the pressure at the floor
  for (int x = 0; x <= width; x++)
    for (int y = 4; y < rows - 2; y++)
      error = std::max(error,
                       std::abs(pressure(y, x) / (system.time_step * density * g * system.cell_size) - (height - y)) / height);
  std::cout << "column: falls with " << falling << " g below its surface, pressure is off by " << error << " rho g h\n";
  EXPECT_LT(falling, 1e-6);
  EXPECT_LT(error, 2e-3);
}

/// A spinning block that falls onto the floor.
struct DroppedBlock : Constrained {
  static constexpr double dx = 0.05;
  explicit DroppedBlock(int dimension)
      : Constrained(dimension, dx, lattice(dimension, dx, 2, Vector3(-0.3, 0.1, -0.1), Vector3(0.3, 0.5, 0.1)),
                    "elasticity/split-neo-hookean", {{"youngs_modulus", 5e4}, {"poissons_ratio", 0.3}}, 1000) {
    scene.simulation.gravity = Vector3(0, -9.81, 0);
    scene.bodies[0].spin.angular_velocity = Vector3(0, 0, 2);
    add_wall(Vector3::Zero(), Vector3::UnitY(), config::Contact::separate);
  }
};

struct Drop {
  double volume = 0;  ///< largest change of the body's, relative
  double energy = 0;  ///< largest, relative to that at the start
  double residual = 0;
};
Drop drop(const DroppedBlock& s) {
  const auto simulation = s.start();
  const auto energy = [](const output::FrameRecord& r) { return r.kinetic_energy + r.elastic_energy + r.gravity_energy; };
  const auto before = simulation->measure();
  Drop result;
  while (simulation->time() < 0.6) {
    simulation->step(0.6);
    const auto record = simulation->measure();
    result.volume = std::max(result.volume, std::abs(record.volume / before.volume - 1));
    result.energy = std::max(result.energy, energy(record) / energy(before));
    result.residual = std::max(result.residual, record.constraint_residual);
  }
  return result;
}

TEST(IncompressibleBlock, KeepsItsVolumeWhenItIsDropped) {
  for (const int dimension : {2, 3}) {
    DroppedBlock s(dimension);
    const Drop compressible = drop(s);
    s.constrain("constraint/incompressibility", {{"stabilization", 0.0}});
    const Drop drifting = drop(s);
    s.constrain("constraint/incompressibility");
    const Drop kept = drop(s);
    std::cout << dimension << "D: volume changes by " << compressible.volume << " without, " << drifting.volume
              << " with the constraint, " << kept.volume << " with corrections\n";
    EXPECT_GT(compressible.volume, 0.02);
    EXPECT_LT(kept.volume, 1e-3);
    EXPECT_LE(kept.residual, 1e-6);
    EXPECT_LE(kept.energy, 1 + 1e-3);
  }
}

}  // namespace
}  // namespace cleave::test
