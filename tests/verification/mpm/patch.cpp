// Patch test (validation problem 4): a homogeneous deformation makes no force inside.

#include "scenes.hpp"

#include "figure.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

namespace cleave::test {
namespace {

struct Patch {
  double interior = 0;  ///< largest velocity change of particles three cells from the surface, one step
  double surface = 0;   ///< of all
};

Patch one_step(int dimension, const Matrix3& F, double jitter) {
  const double dx = 0.1, half = 0.8;
  // rest positions are regular and the grid sees the deformed ones: only a deformation that keeps the pattern aligned with
  // the grid leaves the quadrature exact, so the points stand on a regular lattice of the deformed body
  auto points = lattice(dimension, dx, 2, Vector3(-half, -half, -half), Vector3(half, half, half));
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (auto& p : points) {
    p.volume /= F.determinant();
    p.F = F;
    for (int a = 0; a < dimension; a++) p.x[a] += jitter * 0.25 * dx * uniform(random);
  }
  PointScene s(dimension, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}, 1000);
  s.scene.simulation.time_step = 1e-4;
  auto simulation = s.start();
  simulation->step(1);
  Patch result;
  const auto state = simulation->state();
  for (std::size_t i = 0; i < state.size(); i++) {
    double depth = 1e9;
    for (int a = 0; a < dimension; a++) depth = std::min(depth, half - std::abs(points[i].x[a]));
    const double v = state[i].velocity.norm();
    result.surface = std::max(result.surface, v);
    if (depth > 3.5 * dx) result.interior = std::max(result.interior, v);
  }
  return result;
}

TEST(PatchTest, HomogeneousStressPushesNothingInside) {
  for (int dimension : {2, 3}) {
    Matrix3 F = Matrix3::Identity();
    F.topLeftCorner(dimension, dimension) +=
        (Matrix3() << 0.1, 0.05, -0.02, 0.03, -0.08, 0.04, 0.01, -0.06, 0.12).finished().topLeftCorner(dimension, dimension);
    const Patch regular = one_step(dimension, F, 0), jittered = one_step(dimension, F, 1);
    EXPECT_GT(regular.surface, 1e-3) << "the stress does act at the surface";
    const std::string problem = "affine deformation, " + std::to_string(dimension) + "D, ",
                      quantity = "force inside / at the surface";
    report({.row = 4,
            .problem = problem + "regular",
            .quantity = quantity,
            .measured = regular.interior / regular.surface,
            .tolerance = 1e-12,
            .scatter = any});
    // jittered sampling makes quadrature errors: reported, and bounded so that a regression shows
    report({.row = 4,
            .problem = problem + "jittered by half a particle",
            .quantity = quantity,
            .measured = jittered.interior / jittered.surface,
            .tolerance = 0.5});
    EXPECT_GT(jittered.interior, 1e-6 * jittered.surface);
  }
}

}  // namespace
}  // namespace cleave::test
