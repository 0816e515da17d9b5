// The engine against a plain transcription of the method: one loop over particles, a dense map of nodes, no tiles, no lanes.
// Every transfer scheme in two and three dimensions has to agree with it to rounding, over many steps and several sorts.

#include "scenes.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <map>
#include <random>

namespace cleave::test {
namespace {

struct ReferenceParticle {
  Vector3 x, v;
  Matrix3 C = Matrix3::Zero(), b = Matrix3::Identity();
  double volume;
};

/// Plain MLS-MPM with the split neo-Hookean solid (physics of the plugin written out again).
class Reference {
 public:
  int dimension;
  double dx, dt, mu, kappa, density;
  config::Transfer transfer;
  double flip_ratio;
  Vector3 gravity;
  std::vector<ReferenceParticle> particles;

  void step() {
    struct Node {
      double mass = 0;
      Vector3 momentum = Vector3::Zero(), before = Vector3::Zero();
    };
    std::map<std::array<int, 3>, Node> grid;
    const auto stencil = [&](const Vector3& x, auto&& visit) {
      Index3 base = Index3::Zero();
      double w[3][3] = {};
      for (int a = 0; a < 3; a++) {
        if (a >= dimension) {
          w[a][0] = 1;
          continue;
        }
        base[a] = int(std::floor(x[a] / dx - 0.5));
        const double f = x[a] / dx - base[a];
        w[a][0] = 0.5 * (1.5 - f) * (1.5 - f);
        w[a][1] = 0.75 - (f - 1) * (f - 1);
        w[a][2] = 0.5 * (f - 0.5) * (f - 0.5);
      }
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
          for (int k = 0; k < (dimension == 3 ? 3 : 1); k++) {
            const Index3 n = base + Index3(i, j, k);
            Vector3 r = n.cast<double>() * dx - x;
            if (dimension == 2) r.z() = 0;
            visit(grid[{n[0], n[1], n[2]}], w[0][i] * w[1][j] * w[2][k], r);
          }
    };
    for (const auto& p : particles) {
      const double J2 = p.b.determinant();
      const Matrix3 deviator = p.b - p.b.trace() / 3 * Matrix3::Identity();
      const Matrix3 tau = mu * std::pow(J2, -1.0 / 3) * deviator + kappa / 2 * (J2 - 1) * Matrix3::Identity();
      const double m = density * p.volume;
      stencil(p.x, [&](Node& n, double w, const Vector3& r) {
        const Vector3 affine = transfer == config::Transfer::apic ? Vector3(p.C * r) : Vector3(Vector3::Zero());
        n.mass += w * m;
        n.momentum += w * (m * (p.v + affine) - dt * p.volume * 4 / (dx * dx) * (tau * r));
        n.before += w * m * p.v;
      });
    }
    for (auto& [c, n] : grid) {
      n.momentum = n.momentum / n.mass + dt * gravity;
      n.before /= n.mass;
    }
    for (auto& p : particles) {
      Vector3 v = Vector3::Zero(), before = Vector3::Zero();
      Matrix3 C = Matrix3::Zero();
      stencil(p.x, [&](const Node& n, double w, const Vector3& r) {
        v += w * n.momentum;
        before += w * n.before;
        C += 4 / (dx * dx) * w * n.momentum * r.transpose();
      });
      if (dimension == 2) C.row(2).setZero();
      p.x += dt * v;
      const Matrix3 A = Matrix3::Identity() + dt * C;
      p.b = (A * p.b * A.transpose()).eval();
      p.C = transfer == config::Transfer::apic ? C : Matrix3(Matrix3::Zero());
      p.v = transfer == config::Transfer::flip ? Vector3((1 - flip_ratio) * v + flip_ratio * (p.v + v - before)) : v;
    }
  }
};

struct Case {
  int dimension;
  config::Transfer transfer;
};

class ReferenceStep : public testing::TestWithParam<Case> {};

TEST_P(ReferenceStep, AgreesToRoundingOverManyStepsAndSorts) {
  const auto [dimension, transfer] = GetParam();
  const double dx = 0.1, E = 1e4, nu = 0.3, density = 1000;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Point> points = lattice(dimension, dx, 2, Vector3(-0.65, -0.35, -0.25), Vector3(0.55, 0.45, 0.35));
  for (auto& p : points) {
    for (int a = 0; a < dimension; a++) {
      p.x[a] += 0.02 * uniform(random);
      p.v[a] = 0.3 * uniform(random) + (a == 0 ? 3.0 : -1.0);
      for (int c = 0; c < dimension; c++) p.F(a, c) += 0.05 * uniform(random);
    }
    p.volume *= 1 + 0.1 * uniform(random);
  }
  Reference reference;
  reference.dimension = dimension;
  reference.dx = dx;
  reference.dt = 2e-3;
  reference.mu = E / (2 * (1 + nu));
  reference.kappa = E / (3 * (1 - 2 * nu));
  reference.density = density;
  reference.transfer = transfer;
  reference.flip_ratio = 0.9;
  reference.gravity = dimension == 3 ? Vector3(0.5, 1, -9.81) : Vector3(0.5, -9.81, 0);
  for (const auto& p : points) {
    ReferenceParticle r;
    r.x = p.x;
    r.v = p.v;
    r.b = p.F * p.F.transpose();
    r.volume = p.volume;
    reference.particles.push_back(r);
  }
  PointScene s(dimension, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", E}, {"poissons_ratio", nu}}, density);
  s.scene.simulation.time_step = reference.dt;
  s.scene.simulation.transfer = transfer;
  s.scene.simulation.flip_ratio = reference.flip_ratio;
  s.scene.simulation.gravity = reference.gravity;
  auto simulation = s.start();
  const int steps = 100;  // 0.6 m of travel: six cells, several blocks
  for (int i = 0; i < steps; i++) {
    simulation->step(steps * reference.dt);
    reference.step();
  }
  const auto state = simulation->state();
  ASSERT_EQ(state.size(), reference.particles.size());
  double position = 0, velocity = 0, strain = 0;
  for (std::size_t i = 0; i < state.size(); i++) {
    const auto& r = reference.particles[i];
    position = std::max(position, (state[i].position - r.x).cwiseAbs().maxCoeff());
    velocity = std::max(velocity, (state[i].velocity - r.v).cwiseAbs().maxCoeff());
    strain = std::max(strain, (state[i].strain - r.b).cwiseAbs().maxCoeff());
  }
  // rounding only: 1e-16 per step, amplified by the ringing of a block with random strain
  EXPECT_LT(position, 1e-12);
  EXPECT_LT(velocity, 1e-10);
  EXPECT_LT(strain, 1e-11);
}

std::string case_name(const testing::TestParamInfo<Case>& info) {
  const char* names[] = {"Apic", "Flip", "Pic"};
  return std::string(names[int(info.param.transfer)]) + std::to_string(info.param.dimension) + "D";
}

INSTANTIATE_TEST_SUITE_P(Schemes, ReferenceStep,
                         testing::Values(Case{2, config::Transfer::apic}, Case{3, config::Transfer::apic},
                                         Case{2, config::Transfer::pic}, Case{3, config::Transfer::pic},
                                         Case{2, config::Transfer::flip}, Case{3, config::Transfer::flip}),
                         case_name);

}  // namespace
}  // namespace cleave::test
