// A whole explicit run against the authors' published code: 640 particles, 40 steps of 2e-4 s, APIC, quadratic kernels,
// split neo-Hookean solid, no gravity, no colliders, grid nodes at multiples of the cell size.

#include "../../reference_data.hpp"
#include "scenes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <sstream>

namespace cleave::test {
namespace {

std::vector<std::map<std::string, double>> read_table(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::vector<std::map<std::string, double>> rows;
  std::vector<std::string> header;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::vector<std::string> cells;
    std::stringstream s(line);
    for (std::string cell; std::getline(s, cell, ',');) cells.push_back(cell);
    if (header.empty()) {
      header = cells;
      continue;
    }
    std::map<std::string, double> row;
    for (std::size_t i = 0; i < header.size(); i++) row[header[i]] = std::strtod(cells[i].c_str(), nullptr);
    rows.push_back(row);
  }
  return rows;
}

Matrix3 matrix(const std::map<std::string, double>& row, const std::string& name) {
  Matrix3 m;
  for (int i = 0; i < 9; i++) m(i / 3, i % 3) = row.at(name + std::to_string(i / 3) + std::to_string(i % 3));
  return m;
}

TEST(GoldenTrajectory, NeoHookeanBlockEndsWhereThePublishedCodePutsIt) {
  const auto folder = reference_data() / "golden/trajectories";
  const auto initial = read_table(folder / "nhb_mls_init.csv"), final = read_table(folder / "nhb_mls_final.csv");
  if (initial.empty() || final.empty()) GTEST_SKIP() << "reference trajectories are not in " << folder;
  ASSERT_EQ(initial.size(), 640u);
  ASSERT_EQ(final.size(), 640u);

  const double E = 1e4, nu = 0.3, dx = 0.01, dt = 2e-4;
  const double mu = E / (2 * (1 + nu)), lambda = E * nu / ((1 + nu) * (1 - 2 * nu));
  std::vector<Point> points;
  for (const auto& row : initial) {
    Point p;
    p.x = {row.at("x"), row.at("y"), row.at("z")};
    p.v = {row.at("vx"), row.at("vy"), row.at("vz")};
    p.volume = dx * dx * dx / 8;
    p.F = matrix(row, "F");
    ASSERT_TRUE(matrix(row, "C").isZero());
    points.push_back(p);
  }
  // the published code's bulk modulus is lambda + 0.666666 mu, literally
  PointScene s(3, dx, points, "elasticity/split-neo-hookean", {{"shear_modulus", mu}, {"bulk_modulus", lambda + 0.666666 * mu}},
               1000);
  s.scene.simulation.time_step = dt;
  auto simulation = s.start();
  for (int i = 0; i < 40; i++) simulation->step(40 * dt);
  ASSERT_EQ(simulation->steps(), 40);
  ASSERT_DOUBLE_EQ(simulation->time(), 40 * dt);

  double position = 0, velocity = 0, gradient = 0, strain = 0, v_scale = 0, c_scale = 0;
  const auto state = simulation->state();
  for (std::size_t i = 0; i < state.size(); i++) {
    const auto& row = final[i];
    const Vector3 x(row.at("x"), row.at("y"), row.at("z")), v(row.at("vx"), row.at("vy"), row.at("vz"));
    const Matrix3 C = matrix(row, "C"), F = matrix(row, "F");
    position = std::max(position, (state[i].position - x).cwiseAbs().maxCoeff());
    velocity = std::max(velocity, (state[i].velocity - v).cwiseAbs().maxCoeff());
    gradient = std::max(gradient, (state[i].velocity_gradient - C).cwiseAbs().maxCoeff());
    strain = std::max(strain, (state[i].strain - (state[i].stores_b ? Matrix3(F * F.transpose()) : F)).cwiseAbs().maxCoeff());
    v_scale = std::max(v_scale, v.cwiseAbs().maxCoeff());
    c_scale = std::max(c_scale, C.cwiseAbs().maxCoeff());
  }
  EXPECT_LT(position, 1e-9 * 1.0);  // the block lies about one metre from the origin
  EXPECT_LT(velocity, 1e-9 * v_scale);
  EXPECT_LT(gradient, 1e-9 * c_scale);
  EXPECT_LT(strain, 1e-9);
}

}  // namespace
}  // namespace cleave::test
