// The helper with which authors write constraints, against dense linear algebra.

#include <cleave/projection.hpp>

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>
#include <random>

namespace cleave {
namespace {

using Rows = std::vector<std::pair<Eigen::VectorXd, double>>;  // of B, all nodes' velocities one after another, and c

/// Particles in a box of cells, the nodes they reach with the masses they give, and random velocities.
struct System {
  cleave_constraint_system abi{};
  std::vector<double> mass, velocity, normal, position, volume, deformation, fiber, gradient;
  std::vector<std::int32_t> cell;
  std::vector<std::uint8_t> prescribed;
  std::vector<std::uint64_t> nodes;
  std::mt19937 random{7};

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }

  System(unsigned d, int particles, double dx = 0.1) {
    std::map<std::vector<int>, std::uint64_t> row;
    const unsigned stencil = d == 3 ? 27 : 9;
    for (int p = 0; p < particles; p++) {
      std::vector<double> x;
      for (unsigned a = 0; a < d; a++) x.push_back(uniform(-2.3, 1.1));
      position.insert(position.end(), x.begin(), x.end());
      volume.push_back(uniform(0.5, 1) * std::pow(dx, d) / 8);
      for (int i = 0; i < 9; i++) deformation.push_back((i % 4 == 0) + uniform(-0.2, 0.2));
      double a[3] = {uniform(-1, 1), uniform(-1, 1), d == 3 ? uniform(-1, 1) : 0};
      if (d == 2) deformation[p * 9 + 2] = deformation[p * 9 + 5] = deformation[p * 9 + 6] = deformation[p * 9 + 7] = 0;
      const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
      for (double component : a) fiber.push_back(component / length);
      for (unsigned n = 0; n < stencil; n++) {
        std::vector<int> at;
        double w = 1;
        for (unsigned axis = 0; axis < d; axis++) {
          const unsigned power = d - 1 - axis;
          const int k = int(n / unsigned(std::lround(std::pow(3, power)))) % 3;
          at.push_back(int(std::floor(x[axis] - 0.5)) + k);
          const double distance = std::abs(x[axis] - at.back());
          w *= distance < 0.5 ? 0.75 - distance * distance : 0.5 * (1.5 - distance) * (1.5 - distance);
        }
        const auto [it, fresh] = row.try_emplace(at, row.size());
        if (fresh) {
          mass.push_back(0);
          cell.insert(cell.end(), at.begin(), at.end());
        }
        mass[it->second] += 1000 * volume[p] * w;
        nodes.push_back(it->second);
      }
    }
    for (std::size_t k = 0; k < mass.size() * d; k++) velocity.push_back(uniform(-1, 1));
    prescribed.assign(mass.size(), 0);
    normal.assign(velocity.size(), 0.0);
    gradient.assign(std::size_t(particles) * d * d, 0.0);
    abi = {sizeof abi,
           d,
           dx,
           1e-3,
           mass.size(),
           mass.data(),
           velocity.data(),
           cell.data(),
           prescribed.data(),
           normal.data(),
           volume.size(),
           position.data(),
           volume.data(),
           deformation.data(),
           fiber.data(),
           gradient.data(),
           nodes.data(),
           nullptr,
           nullptr};
  }

  void fix(std::uint64_t node) { prescribed[node] = 1; }
  void fix_along_normal(std::uint64_t node) {
    prescribed[node] = 2;
    double squared = 0;
    for (unsigned a = 0; a < abi.dimension; a++) {
      normal[node * abi.dimension + a] = uniform(-1, 1);
      squared += std::pow(normal[node * abi.dimension + a], 2);
    }
    for (unsigned a = 0; a < abi.dimension; a++) normal[node * abi.dimension + a] /= std::sqrt(squared);
  }
  Eigen::VectorXd velocities() const {
    return Eigen::Map<const Eigen::VectorXd>(velocity.data(), Eigen::Index(velocity.size()));
  }
  Eigen::VectorXd masses() const {
    Eigen::VectorXd m(velocity.size());
    for (std::size_t k = 0; k < velocity.size(); k++) m[Eigen::Index(k)] = mass[k / abi.dimension];
    return m;
  }
};

/// a . (grad v) a = value for each particle, into the projection and, if given, as dense rows.
void stretch_rows(System& s, Projection& projection, double value, Rows* dense = nullptr) {
  const unsigned d = s.abi.dimension;
  for (std::uint64_t p = 0; p < s.abi.particle_count; p++) {
    const auto a = current_fiber(s.abi, p);
    const GradientWeights grad = gradient_weights(s.abi, p);
    Eigen::VectorXd row = Eigen::VectorXd::Zero(Eigen::Index(s.velocity.size()));
    projection.begin_row(value);
    for (unsigned n = 0; n < grad.count; n++) {
      const double along = a[0] * grad.value[n][0] + a[1] * grad.value[n][1] + a[2] * grad.value[n][2];
      projection.add(grad.node[n], {along * a[0], along * a[1], along * a[2]});
      for (unsigned k = 0; k < d; k++) row[Eigen::Index(grad.node[n] * d + k)] += along * a[k];
    }
    if (dense) dense->emplace_back(row, value);
  }
}

struct Dense {
  Eigen::VectorXd velocity;
  double residual;
};

/// By the pseudoinverse of S B' M^-1/2.
Dense reference(const System& s, const Rows& rows) {
  const unsigned d = s.abi.dimension;
  const Eigen::VectorXd before = s.velocities(), m = s.masses();
  Eigen::MatrixXd B(rows.size(), before.size());
  Eigen::VectorXd c(rows.size());
  for (std::size_t i = 0; i < rows.size(); i++) {
    B.row(Eigen::Index(i)) = rows[i].first;
    c[Eigen::Index(i)] = rows[i].second;
  }
  Eigen::MatrixXd free = Eigen::MatrixXd::Identity(before.size(), before.size());
  for (std::uint64_t n = 0; n < s.abi.node_count; n++) {
    auto block = free.block(Eigen::Index(n * d), Eigen::Index(n * d), d, d);
    const Eigen::Map<const Eigen::VectorXd> normal(s.normal.data() + n * d, d);
    if (s.prescribed[n] == 1) block.setZero();
    if (s.prescribed[n] == 2) block -= normal * normal.transpose();
  }
  Eigen::MatrixXd A = B * free * m.cwiseSqrt().cwiseInverse().asDiagonal();
  Eigen::VectorXd r = B * before - c;
  const double begun = r.norm();
  for (Eigen::Index i = 0; i < A.rows(); i++) {
    const double length = A.row(i).norm();
    if (length > 0) {
      r[i] /= length;
      A.row(i) /= length;
    }
  }
  Eigen::BDCSVD<Eigen::MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  svd.setThreshold(1e-10);
  const Eigen::VectorXd velocity = before - m.cwiseSqrt().cwiseInverse().asDiagonal() * svd.solve(r);
  return {velocity, (B * velocity - c).norm() / begun};
}

constexpr Projection::Options exact{.tolerance = 1e-13, .maximum_iterations = 3000};

class GridProjection : public testing::TestWithParam<unsigned> {};
INSTANTIATE_TEST_SUITE_P(Dimensions, GridProjection, testing::Values(2u, 3u),
                         [](const auto& info) { return std::to_string(info.param) + "D"; });

TEST_P(GridProjection, WeightsGiveTheGradientOfALinearField) {
  const unsigned d = GetParam();
  System s(d, 20);
  const double gradient[3][3] = {{1, -2, 0.5}, {0.25, 3, -1}, {-4, 0.75, 2}};
  for (std::uint64_t n = 0; n < s.abi.node_count; n++)
    for (unsigned i = 0; i < d; i++) {
      s.velocity[n * d + i] = 5 + i;
      for (unsigned j = 0; j < d; j++) s.velocity[n * d + i] += gradient[i][j] * s.cell[n * d + j] * s.abi.cell_size;
    }
  for (std::uint64_t p = 0; p < s.abi.particle_count; p++) {
    const GradientWeights grad = gradient_weights(s.abi, p);
    EXPECT_EQ(grad.count, d == 3 ? 27u : 9u);
    for (unsigned i = 0; i < d; i++)
      for (unsigned j = 0; j < 3; j++) {
        double sum = 0;
        for (unsigned n = 0; n < grad.count; n++) sum += grad.value[n][j] * s.velocity[grad.node[n] * d + i];
        EXPECT_NEAR(sum, j < d ? gradient[i][j] : 0, 1e-11);
      }
  }
}

TEST_P(GridProjection, AgreesWithThePseudoinverse) {
  for (const bool held : {false, true}) {
    System s(GetParam(), GetParam() == 3 ? 30 : 12);
    if (held) {
      for (std::uint64_t n = 0; n < s.abi.node_count; n += 7) s.fix(n);
      for (std::uint64_t n = 3; n < s.abi.node_count; n += 7) s.fix_along_normal(n);
    }
    Projection projection(s.abi);
    Rows rows;
    stretch_rows(s, projection, 0.3, &rows);
    const Dense wanted = reference(s, rows);
    const ConstraintReport report = projection.solve(exact);
    EXPECT_EQ(report.rows, rows.size());
    EXPECT_LT(report.residual, 1e-12);
    EXPECT_LT((s.velocities() - wanted.velocity).norm(), 1e-8 * wanted.velocity.norm()) << "held: " << held;
  }
}

TEST_P(GridProjection, TakesDependentRowsForOne) {
  System once(GetParam(), 10), thrice(GetParam(), 10);
  Projection one(once.abi), three(thrice.abi);
  stretch_rows(once, one, 0.3);
  for (int k = 0; k < 3; k++) stretch_rows(thrice, three, 0.3);
  one.solve(exact);
  const ConstraintReport report = three.solve(exact);
  EXPECT_EQ(report.rows, 30u);
  EXPECT_LT(report.residual, 1e-12);
  EXPECT_LT((once.velocities() - thrice.velocities()).norm(), 1e-9 * once.velocities().norm());
}

TEST_P(GridProjection, MeetsContradictoryRowsInLeastSquares) {
  System s(GetParam(), 8);
  Projection projection(s.abi);
  Rows rows;
  stretch_rows(s, projection, 0, &rows);
  stretch_rows(s, projection, 1, &rows);
  const Dense wanted = reference(s, rows);
  const ConstraintReport report = projection.solve({.tolerance = 1e-9});
  EXPECT_GT(wanted.residual, 0.01);
  EXPECT_NEAR(report.residual, wanted.residual, 1e-7);
  EXPECT_LT((s.velocities() - wanted.velocity).norm(), 1e-6 * wanted.velocity.norm());
  EXPECT_LT(report.iterations, 500u) << "it ends where nothing can be gained";
}

TEST_P(GridProjection, MeetsContradictoryRowsInLeastSquaresWithAMemoryToo) {
  System s(GetParam(), 8);
  ProjectionMemory memory;
  Projection projection(s.abi, memory);
  Rows rows;
  stretch_rows(s, projection, 0, &rows);
  stretch_rows(s, projection, 1, &rows);
  const Dense wanted = reference(s, rows);
  const ConstraintReport report = projection.solve({.tolerance = 1e-9, .maximum_iterations = 100});
  EXPECT_NEAR(report.residual, wanted.residual, 1e-7);
  EXPECT_LT((s.velocities() - wanted.velocity).norm(), 1e-6 * wanted.velocity.norm());
}

TEST_P(GridProjection, KeepsMomentumAndTakesNoMoreEnergyThanItMust) {
  const unsigned d = GetParam();
  System s(d, 40);
  const Eigen::VectorXd before = s.velocities(), m = s.masses();
  Projection projection(s.abi);
  stretch_rows(s, projection, 0);
  ASSERT_LT(projection.solve(exact).residual, 1e-12);
  const Eigen::VectorXd after = s.velocities();
  const auto momenta = [&](const Eigen::VectorXd& v) {
    Eigen::Vector3d linear = Eigen::Vector3d::Zero(), angular = linear;
    for (std::uint64_t n = 0; n < s.abi.node_count; n++) {
      Eigen::Vector3d x = Eigen::Vector3d::Zero(), p = x;
      for (unsigned a = 0; a < d; a++) {
        x[a] = s.cell[n * d + a] * s.abi.cell_size;
        p[a] = s.mass[n] * v[Eigen::Index(n * d + a)];
      }
      linear += p;
      angular += x.cross(p);
    }
    return std::pair(linear, angular);
  };
  const double scale = m.dot(before.cwiseAbs());
  EXPECT_GT((after - before).norm(), 0.1 * before.norm());
  EXPECT_LT((momenta(after).first - momenta(before).first).norm(), 1e-13 * scale);
  EXPECT_LT((momenta(after).second - momenta(before).second).norm(), 1e-13 * scale);
  EXPECT_NEAR((after - before).dot(m.cwiseProduct(after)), 0, 1e-11 * before.dot(m.cwiseProduct(before)));
}

TEST_P(GridProjection, DoesNotTouchWhatIsPrescribed) {
  const unsigned d = GetParam();
  System s(d, 20);
  for (std::uint64_t n = 0; n < s.abi.node_count; n += 3) s.fix(n);
  for (std::uint64_t n = 1; n < s.abi.node_count; n += 3) s.fix_along_normal(n);
  const std::vector<double> before = s.velocity;
  Projection projection(s.abi);
  stretch_rows(s, projection, 0);
  projection.solve();
  double largest = 1;
  for (const double v : s.velocity) largest = std::max(largest, std::abs(v));
  bool moved = false;
  for (std::uint64_t n = 0; n < s.abi.node_count; n++) {
    double along = 0;
    for (unsigned a = 0; a < d; a++) {
      const std::size_t k = n * d + a;
      along += (s.velocity[k] - before[k]) * s.normal[k];
      if (n % 3 == 0) {
        EXPECT_EQ(s.velocity[k], before[k]);
      }
      moved = moved || s.velocity[k] != before[k];
    }
    if (n % 3 == 1) {
      EXPECT_NEAR(along, 0, 1e-14 * largest);
    }
  }
  EXPECT_TRUE(moved);
}

TEST_P(GridProjection, SaysThatNothingCanBeDoneWhereEverythingIsHeld) {
  System s(GetParam(), 5);
  for (std::uint64_t n = 0; n < s.abi.node_count; n++) s.fix(n);
  const std::vector<double> before = s.velocity;
  Projection projection(s.abi);
  stretch_rows(s, projection, 0);
  const ConstraintReport report = projection.solve();
  EXPECT_EQ(report.residual, 1);
  EXPECT_EQ(report.iterations, 0u);
  EXPECT_EQ(s.velocity, before);
}

TEST_P(GridProjection, DoesNotActWithTheRoundingOfARowAlongAHeldNormal) {
  const unsigned d = GetParam();
  System s(d, 5);
  Projection projection(s.abi);
  for (std::uint64_t n = 0; n < s.abi.node_count; n++) {
    s.fix_along_normal(n);
    std::array<double, 3> coefficients{};
    for (unsigned a = 0; a < d; a++) coefficients[a] = 3 * s.normal[n * d + a];
    projection.begin_row(5);
    projection.add(n, coefficients);
  }
  const std::vector<double> before = s.velocity;
  EXPECT_EQ(projection.solve().residual, 1);
  EXPECT_EQ(s.velocity, before);
}

TEST_P(GridProjection, LeavesTheRoundingOfARotationAlone) {
  const unsigned d = GetParam();
  System s(d, 30);
  for (std::uint64_t n = 0; n < s.abi.node_count; n++) {
    s.velocity[n * d] = -3e5 - 7 * s.cell[n * d + 1] * s.abi.cell_size;
    s.velocity[n * d + 1] = 7 * s.cell[n * d] * s.abi.cell_size;
    if (d == 3) s.velocity[n * d + 2] = 0.125;
  }
  const std::vector<double> before = s.velocity;
  Projection projection(s.abi);
  stretch_rows(s, projection, 0);
  const ConstraintReport report = projection.solve();
  EXPECT_EQ(s.velocity, before);
  EXPECT_EQ(report.residual, 0);
  EXPECT_EQ(report.rows, 30u);
}

TEST_P(GridProjection, HasNoRowsWithoutFibres) {
  System s(GetParam(), 6);
  std::fill(s.fiber.begin(), s.fiber.end(), 0.0);
  EXPECT_EQ(current_fiber(s.abi, 0), (std::array<double, 3>{}));
  const std::vector<double> before = s.velocity;
  Projection projection(s.abi);
  for (int k = 0; k < 4; k++) projection.begin_row(1);
  EXPECT_EQ(projection.solve().rows, 0u);
  EXPECT_EQ(s.velocity, before);
}

TEST_P(GridProjection, RefusesNumbersThatAreNotFinite) {
  System s(GetParam(), 6);
  s.deformation[0] = std::numeric_limits<double>::quiet_NaN();
  Projection projection(s.abi);
  stretch_rows(s, projection, 0);
  EXPECT_THROW(projection.solve(), std::runtime_error);
}

TEST_P(GridProjection, FindsTheParticlesOfACell) {
  const unsigned d = GetParam();
  System s(d, 60);
  std::size_t particles = 0;
  std::map<std::vector<long>, int> seen;
  for (const auto& cell : particles_by_cell(s.abi)) {
    particles += cell.size();
    std::vector<long> first;
    for (const std::uint64_t p : cell) {
      std::vector<long> cell_of_particle;
      for (unsigned a = 0; a < d; a++) cell_of_particle.push_back(std::lround(std::floor(s.position[p * d + a])));
      if (first.empty()) first = cell_of_particle;
      EXPECT_EQ(cell_of_particle, first);
    }
    EXPECT_EQ(seen[first]++, 0) << "one row for each cell";
  }
  EXPECT_EQ(particles, 60u);
}

}  // namespace
}  // namespace cleave
