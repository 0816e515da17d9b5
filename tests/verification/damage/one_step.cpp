// One step of damage against a plain transcription of the method with a dense solve: the state before the step, whatever led to
// it, gives the damage after it and the velocities, whose forces use that damage.

#include "damage_scenes.hpp"

#include <Eigen/Cholesky>
#include <map>
#include <random>

namespace cleave::test {
namespace {

enum class Scheme { implicit, weak, cubic };

/// Weighted sums over the nodes of a quadratic stencil, or of a cubic one around the cell centres. Lengths in cells.
class Nodes {
 public:
  struct Weight {
    int node;
    double w, laplacian;
    Vector3 to_node;
  };
  Nodes(int dimension, bool cubic) : dimension_(dimension), cubic_(cubic) {}

  std::vector<Weight> stencil(const Vector3& x) {
    const int n = cubic_ ? 4 : 3;
    int first[3] = {0, 0, 0};
    double w[3][4] = {{1}, {1}, {1}}, second[3][4] = {};
    for (int a = 0; a < dimension_; a++) {
      const double shift = cubic_ ? 0.5 : 0;  // of the nodes
      first[a] = int(std::floor(x[a] - shift - (cubic_ ? 1 : 0.5)));
      for (int i = 0; i < n; i++) {
        const double r = std::abs(x[a] - shift - (first[a] + i));
        if (cubic_) {
          w[a][i] = r < 1 ? 2. / 3 - r * r + r * r * r / 2 : std::pow(std::max(2 - r, 0.0), 3) / 6;
          second[a][i] = r < 1 ? 3 * r - 2 : std::max(2 - r, 0.0);
        } else {
          w[a][i] = r < 0.5 ? 0.75 - r * r : 0.5 * (1.5 - r) * (1.5 - r);
        }
      }
    }
    std::vector<Weight> weights;
    for (int i = 0; i < n; i++)
      for (int j = 0; j < n; j++)
        for (int k = 0; k < (dimension_ == 3 ? n : 1); k++) {
          const std::array<int, 3> c = {first[0] + i, first[1] + j, first[2] + k};
          const int node = index_.emplace(c, int(index_.size())).first->second;
          Vector3 r = Vector3(c[0], c[1], c[2]) - x;
          if (dimension_ == 2) r.z() = 0;
          weights.push_back({node, w[0][i] * w[1][j] * w[2][k],
                             second[0][i] * w[1][j] * w[2][k] + w[0][i] * second[1][j] * w[2][k] +
                                 (dimension_ == 3 ? w[0][i] * w[1][j] * second[2][k] : 0.0),
                             r});
        }
    return weights;
  }
  int size() const { return int(index_.size()); }

 private:
  int dimension_;
  bool cubic_;
  std::map<std::array<int, 3>, int> index_;
};

struct Expected {
  std::vector<double> damage;
  std::vector<Vector3> velocity;
};

struct Material {
  int dimension;
  double dx, dt, density;
  Solid solid;
  PhaseField law;
};

Expected reference(const Material& m, Scheme scheme, const std::vector<mpm::ParticleState>& before) {
  using Vector = Eigen::VectorXd;
  const std::size_t n = before.size();
  const double rate = m.dt / m.law.eta, l2 = std::pow(m.law.length() / m.dx, 2);
  Nodes nodes(m.dimension, scheme == Scheme::cubic);
  std::vector<std::vector<Nodes::Weight>> stencils;
  std::vector<double> V, force;
  for (const auto& p : before) {
    stencils.push_back(nodes.stencil(p.position / m.dx));
    V.push_back(p.volume / std::pow(m.dx, m.dimension) * std::sqrt(p.strain.determinant()));
    const double D = m.law.driving_force(std::max(p.state[0], m.solid.tensile_energy(p.strain)));
    force.push_back(D);
  }
  Vector mass = Vector::Zero(nodes.size()), damage = mass, driven = mass;
  Eigen::MatrixXd K = Eigen::MatrixXd::Zero(nodes.size(), nodes.size());
  for (std::size_t p = 0; p < n; p++)
    for (const auto& i : stencils[p]) {
      mass[i.node] += V[p] * i.w;
      damage[i.node] += V[p] * i.w * before[p].damage;
      driven[i.node] += V[p] * i.w * force[p];
      if (scheme != Scheme::cubic)
        for (const auto& j : stencils[p]) K(i.node, j.node) += V[p] * 16 * i.w * j.w * i.to_node.dot(j.to_node);
    }
  const Vector initial = damage.cwiseQuotient(mass);
  Expected expected;
  Vector change;
  if (scheme == Scheme::implicit) {
    Eigen::MatrixXd A = l2 * K;
    A.diagonal() += (1 / rate + 1) * mass + driven;
    change = A.ldlt().solve(driven + damage / rate) - initial;
  } else if (scheme == Scheme::weak) {
    change = -(K * initial).cwiseQuotient(mass);
  }
  for (std::size_t p = 0; p < n; p++) {
    const double d = before[p].damage;
    double after = d, laplacian = 0;
    for (const auto& i : stencils[p]) {
      if (scheme == Scheme::implicit) after += i.w * change[i.node];
      if (scheme == Scheme::weak) laplacian += i.w * change[i.node];
      if (scheme == Scheme::cubic) laplacian += i.laplacian * initial[i.node];
    }
    if (scheme != Scheme::implicit) after = d + rate * std::max(0.0, (1 - d) * force[p] - (d - l2 * laplacian));
    expected.damage.push_back(std::clamp(std::max(d, after), 0.0, 1.0));
  }
  // motion, with forces of the damage just found
  Nodes grid(m.dimension, false);
  std::vector<double> node_mass;
  std::vector<Vector3> momentum;
  for (std::size_t p = 0; p < n; p++) {
    const auto& s = before[p];
    const Matrix3 tau = m.solid.kirchhoff(s.strain, degradation(expected.damage[p], m.law.residual));
    stencils[p] = grid.stencil(s.position / m.dx);
    node_mass.resize(std::size_t(grid.size()), 0.0);
    momentum.resize(std::size_t(grid.size()), Vector3::Zero());
    for (const auto& i : stencils[p]) {
      node_mass[std::size_t(i.node)] += i.w * m.density * s.volume;
      momentum[std::size_t(i.node)] += i.w * (m.density * s.volume * (s.velocity + m.dx * s.velocity_gradient * i.to_node) -
                                              m.dt * s.volume * 4 / m.dx * (tau * i.to_node));
    }
  }
  for (std::size_t p = 0; p < n; p++) {
    Vector3 v = Vector3::Zero();
    for (const auto& i : stencils[p]) v += i.w * momentum[std::size_t(i.node)] / node_mass[std::size_t(i.node)];
    if (m.dimension == 2) v.z() = 0;
    expected.velocity.push_back(v);
  }
  return expected;
}

struct Case {
  int dimension;
  Scheme scheme;
  config::Precision precision = config::Precision::double_precision;
};

class DamageStep : public testing::TestWithParam<Case> {};

TEST_P(DamageStep, IsThatOfADenseSolveAndDegradesTheForcesOfTheSameStep) {
  const auto [dimension, scheme, precision] = GetParam();
  const bool single = precision == config::Precision::single_precision;
  Material m{.dimension = dimension, .dx = 0.1, .dt = 2e-4, .density = 1000, .solid = {}, .law = {}};
  m.law = {.G = 20,
           .l0 = 0.12,
           .eta = scheme == Scheme::implicit ? 4e-3 : 3e-2,
           .residual = 0.01,
           .explicitly = scheme != Scheme::implicit};
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  auto points = lattice(dimension, m.dx, 2, Vector3(-0.45, -0.25, -0.25), Vector3(0.35, 0.25, 0.15));
  for (auto& p : points) {
    for (int a = 0; a < dimension; a++) {
      p.x[a] += 0.02 * uniform(random);
      p.v[a] = 0.5 * uniform(random) + 10;  // some cells of travel
      for (int c = 0; c < dimension; c++) p.F(a, c) += 0.1 * uniform(random);
    }
    p.volume *= 1 + 0.1 * uniform(random);
  }
  DamageScene s(dimension, m.dx, points, m.solid, m.law, m.density);
  s.scene.simulation.time_step = m.dt;
  s.scene.simulation.precision = precision;
  s.scene.simulation.damage.tolerance = single ? 1e-6 : 1e-12;
  s.scene.simulation.damage.laplacian = scheme == Scheme::cubic ? config::Laplacian::cubic : config::Laplacian::weak;
  const auto simulation = s.start();
  double damage = 0, velocity = 0, lowest = 1, highest = 0;
  for (int step = 0; step < 60; step++) {
    const auto before = simulation->state();
    simulation->step(1);
    if (step != 0 && step != 1 && step != 20 && step != 59) continue;
    const Expected expected = reference(m, scheme, before);
    const auto after = simulation->state();
    for (std::size_t p = 0; p < after.size(); p++) {
      damage = std::max(damage, std::abs(after[p].damage - expected.damage[p]));
      velocity = std::max(velocity, (after[p].velocity - expected.velocity[p]).cwiseAbs().maxCoeff());
      lowest = std::min(lowest, after[p].damage);
      highest = std::max(highest, after[p].damage);
    }
  }
  EXPECT_LT(damage, single ? 2e-6 : 1e-11);
  EXPECT_LT(velocity, single ? 1e-4 : 1e-11);
  EXPECT_GT(highest, 0.2);
  if (scheme == Scheme::implicit) {
    EXPECT_LT(simulation->measure().damage_iterations, single ? 12 : 25);
  }
}

std::string case_name(const testing::TestParamInfo<Case>& info) {
  const char* names[] = {"Implicit", "Weak", "Cubic"};
  return std::string(names[int(info.param.scheme)]) + std::to_string(info.param.dimension) + "D" +
         (info.param.precision == config::Precision::single_precision ? "Single" : "");
}
constexpr auto in_single = config::Precision::single_precision;
INSTANTIATE_TEST_SUITE_P(All, DamageStep,
                         testing::Values(Case{2, Scheme::implicit}, Case{3, Scheme::implicit}, Case{2, Scheme::weak},
                                         Case{3, Scheme::weak}, Case{2, Scheme::cubic}, Case{3, Scheme::cubic},
                                         Case{2, Scheme::implicit, in_single}, Case{3, Scheme::implicit, in_single},
                                         Case{3, Scheme::weak, in_single}, Case{3, Scheme::cubic, in_single}),
                         case_name);

}  // namespace
}  // namespace cleave::test
