// Rows of inextensible fibres and their projection with a memory, against dense linear algebra.

#include "inextensibility/fiber_rows.hpp"

#include <cleave/testkit/grid_system.hpp>

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>
#include <span>

namespace cleave {
namespace {
namespace kit = testkit;
using inextensibility::FiberRows;
using inextensibility::Multipliers;

cleave_constraint_system seen(kit::GridSystem& s) {
  const auto data = [](auto& values) { return values.empty() ? nullptr : values.data(); };
  return {sizeof(cleave_constraint_system),
          std::uint32_t(s.dimension),
          s.cell_size,
          s.time_step,
          s.node_count(),
          data(s.mass),
          data(s.velocity),
          data(s.node_cell),
          data(s.prescribed),
          data(s.normal),
          s.particle_count(),
          data(s.position),
          data(s.volume),
          data(s.deformation),
          data(s.fiber),
          data(s.velocity_gradient),
          data(s.nodes),
          nullptr,
          nullptr};
}

ConstraintReport hold_fibers(kit::GridSystem& s, ProjectionMemory& memory, const Projection::Options& options,
                             Multipliers multipliers = Multipliers::staggered, double strain = 0, double rate = 0) {
  const cleave_constraint_system system = seen(s);
  Projection projection(system, memory);
  const auto add_all = [&](auto rows) {
    for (std::uint64_t p = 0; p < system.particle_count; ++p) rows.add(p, current_fiber(system, p), 0, strain);
    rows.write(projection, rate);
  };
  if (s.dimension == 3)
    add_all(FiberRows<3>(system, multipliers));
  else
    add_all(FiberRows<2>(system, multipliers));
  return projection.solve(options);
}

double hat(double x) { return std::max(0.0, 1 - std::abs(x)); }
double spline(double x) {
  const double r = std::abs(x);
  return r < 0.5 ? 0.75 - r * r : r < 1.5 ? 0.5 * (1.5 - r) * (1.5 - r) : 0;
}
double spline_slope(double x) {
  return std::abs(x) < 0.5 ? -2 * x : std::abs(x) < 1.5 ? (x < 0 ? 1 : -1) * (1.5 - std::abs(x)) : 0;
}

/// Where multipliers are staggered, the fibres of these systems are to be nearest to one axis everywhere.
std::size_t axis_of(kit::GridSystem& s) {
  const auto a = current_fiber(seen(s), 0);
  return std::size_t(std::max_element(a.begin(), a.end(), [](double x, double y) { return std::abs(x) < std::abs(y); }) -
                     a.begin());
}

/// B_(z, i alpha) = sum_p V_p Gamma_z(x_p) a_alpha (a . grad N_i(x_p)), term by term.
Eigen::MatrixXd equation_22(kit::GridSystem& s, Multipliers multipliers) {
  const cleave_constraint_system system = seen(s);
  const auto d = std::size_t(s.dimension);
  const std::size_t axis = axis_of(s);
  std::map<std::vector<int>, Eigen::VectorXd> rows;
  for (std::uint64_t p = 0; p < s.particle_count(); ++p) {
    const auto a = current_fiber(system, p);
    const double* x = &s.position[p * d];
    const auto linear = [&](std::size_t k) { return multipliers == Multipliers::centred || k == axis; };
    for (int corner = 0; corner < 1 << d; ++corner) {
      std::vector<int> z;
      double weight = s.volume[p];
      for (std::size_t k = 0; k < d; ++k)
        if (linear(k)) {
          z.push_back(int(std::floor(x[k] - 0.5)) + (corner >> k & 1));
          weight *= hat(x[k] - z[k] - 0.5);
        } else {
          z.push_back(int(std::floor(x[k] + 0.5)));
          weight *= (corner >> k & 1) == 0;
        }
      if (weight == 0) continue;
      auto& row = rows.try_emplace(z, Eigen::VectorXd::Zero(Eigen::Index(d * s.node_count()))).first->second;
      for (std::size_t i = 0; i < s.node_count(); ++i) {
        double along = 0;
        for (std::size_t j = 0; j < d; ++j) {
          double slope = a[j] / s.cell_size;
          for (std::size_t k = 0; k < d; ++k) {
            const double distance = x[k] - s.node_cell[i * d + k];
            slope *= j == k ? spline_slope(distance) : spline(distance);
          }
          along += slope;
        }
        for (std::size_t k = 0; k < d; ++k) row[Eigen::Index(i * d + k)] += weight * along * a[k];
      }
    }
  }
  // No staggered row between two nodes that are prescribed along the fibre
  const auto held = [&](const std::vector<int>& at) {
    for (std::size_t i = 0; i < s.node_count(); ++i) {
      if (!std::equal(at.begin(), at.end(), s.node_cell.begin() + std::ptrdiff_t(i * d))) continue;
      double along = 0;
      if (s.prescribed[i] == 2)
        for (std::size_t k = 0; k < d; ++k) along += current_fiber(system, 0)[k] * s.normal[i * d + k];
      return s.prescribed[i] == 1 || along * along >= 0.5;
    }
    return false;
  };
  std::erase_if(rows, [&](const auto& row) {
    std::vector<int> end = row.first;
    ++end[axis];
    return multipliers == Multipliers::staggered && held(row.first) && held(end);
  });
  Eigen::MatrixXd B(rows.size(), d * s.node_count());
  Eigen::Index r = 0;
  for (const auto& [z, row] : rows) B.row(r++) = row;
  return B;
}

Eigen::Map<Eigen::VectorXd> vector(std::vector<double>& values) { return {values.data(), Eigen::Index(values.size())}; }

/// v* - M^-1 B'^T S (S B' M^-1 B'^T S + epsilon)^-1 S B v*
Eigen::VectorXd relaxed_projection(kit::GridSystem& s, double epsilon, Multipliers multipliers) {
  const Eigen::MatrixXd B = equation_22(s, multipliers);
  const auto d = Eigen::Index(s.dimension);
  Eigen::MatrixXd A = B;
  for (std::size_t i = 0; i < s.node_count(); ++i) {
    auto block = A.middleCols(Eigen::Index(i) * d, d);
    if (s.prescribed[i] == 1) block.setZero();
    if (s.prescribed[i] == 2) {
      const Eigen::Map<const Eigen::VectorXd> normal(&s.normal[i * std::size_t(d)], d);
      block -= (block * normal * normal.transpose()).eval();
    }
    block /= std::sqrt(s.mass[i]);
  }
  Eigen::VectorXd rest = B * vector(s.velocity);
  for (Eigen::Index r = 0; r < A.rows(); ++r) {
    const double length = A.row(r).norm();
    rest[r] /= length;
    A.row(r) /= length;
  }
  const Eigen::MatrixXd S = A * A.transpose() + epsilon * Eigen::MatrixXd::Identity(A.rows(), A.rows());
  Eigen::VectorXd u = A.transpose() * S.ldlt().solve(rest);
  for (Eigen::Index k = 0; k < u.size(); ++k) u[k] /= std::sqrt(s.mass[std::size_t(k / d)]);
  return vector(s.velocity) - u;
}

class InextensibleFibers : public testing::TestWithParam<int> {
 protected:
  kit::Random random{11};
};
INSTANTIATE_TEST_SUITE_P(Dimensions, InextensibleFibers, testing::Values(2, 3),
                         [](const auto& info) { return std::to_string(info.param) + "D"; });

TEST_P(InextensibleFibers, AreHeldByTheRowsOfEquation22) {
  for (const auto multipliers : {Multipliers::staggered, Multipliers::centred})
    for (const auto held : {kit::Block::free, kit::Block::walls})
      for (const double epsilon : {1e-2, 1e-4, 1e-7}) {
        const auto fibers = multipliers == Multipliers::centred ? kit::Block::random : kit::Block::uniform;
        kit::GridSystem s = random_block(random, {GetParam(), 4, 2, fibers, kit::Block::strained, held});
        const Eigen::VectorXd wanted = relaxed_projection(s, epsilon, multipliers);
        ProjectionMemory memory;
        const ConstraintReport report = hold_fibers(s, memory, {.tolerance = 1e-11, .relaxation = epsilon}, multipliers);
        EXPECT_LE(report.residual, 1e-11);
        EXPECT_EQ(report.rows, std::uint64_t(equation_22(s, multipliers).rows()));
        EXPECT_LT((vector(s.velocity) - wanted).norm(), 1e-6 * wanted.norm()) << epsilon;
        EXPECT_LT(report.iterations, 40u);
      }
}

TEST_P(InextensibleFibers, AreHeldWithoutRelaxation) {
  for (const auto& [multipliers, most] : {std::pair(Multipliers::staggered, 8u), std::pair(Multipliers::centred, 100u)}) {
    kit::GridSystem s = random_block(random, {GetParam(), 4, 2, kit::Block::uniform, kit::Block::strained, kit::Block::free});
    const Eigen::MatrixXd B = equation_22(s, multipliers);
    const double before = (B * vector(s.velocity)).norm();
    ProjectionMemory memory;
    const ConstraintReport report = hold_fibers(s, memory, {.tolerance = 1e-8}, multipliers);
    EXPECT_LT((B * vector(s.velocity)).norm(), 1.01e-8 * before);
    EXPECT_LT(report.iterations, most);
  }
}

/// B M^-1 B^T of staggered rows of unit length has no small eigenvalues, wherever the fibres point to; that of centred rows has
/// those of tensions which alternate.
TEST_P(InextensibleFibers, HaveIndependentStaggeredRows) {
  const int d = GetParam();
  std::vector<double> places;
  for (int p = 0; p < (d == 3 ? 12 * 10 * 10 : 12 * 10); ++p) {
    const std::array<int, 3> lattice{p % 12, p / 12 % 10, p / 120};
    for (int k = 0; k < d; ++k) places.push_back((lattice[std::size_t(k)] + 0.5 + random.uniform(-0.3, 0.3)) / 2);
  }
  const auto smallest = [&](Multipliers multipliers) {
    kit::GridSystem s = particles_at(random, d, places);
    const double angle = random.uniform(0, 3);
    for (std::size_t p = 0; p < s.particle_count(); ++p) {
      const std::array<double, 3> a{std::cos(angle), std::sin(angle), 0};
      std::copy(a.begin(), a.end(), &s.fiber[3 * p]);
    }
    Eigen::MatrixXd A = equation_22(s, multipliers);
    for (std::size_t i = 0; i < s.node_count(); ++i)
      A.middleCols(Eigen::Index(i) * s.dimension, s.dimension) /= std::sqrt(s.mass[i]);
    A.rowwise().normalize();
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(A * A.transpose(), Eigen::EigenvaluesOnly).eigenvalues()[0];
  };
  for (int i = 0; i < 4; ++i) EXPECT_GT(smallest(Multipliers::staggered), 1e-3);
  EXPECT_LT(smallest(Multipliers::centred), 1e-4);
}

/// Beyond the memory that complete factors may take, incomplete ones come to the same velocities.
TEST_P(InextensibleFibers, AreHeldTheSameWithIncompleteFactors) {
  kit::GridSystem first = random_block(random, {GetParam(), 6, 2, kit::Block::uniform, kit::Block::strained, kit::Block::free});
  kit::GridSystem second = first;
  ProjectionMemory complete, incomplete;
  const ConstraintReport with = hold_fibers(first, complete, {.tolerance = 1e-10});
  const ConstraintReport without = hold_fibers(second, incomplete, {.tolerance = 1e-10, .factor_bytes = 1000});
  EXPECT_LE(without.residual, 1e-10);
  EXPECT_GT(without.iterations, with.iterations);
  EXPECT_LT(without.iterations, 80u);
  EXPECT_LT((vector(second.velocity) - vector(first.velocity)).norm(), 1e-8 * vector(first.velocity).norm());
}

/// Drift is taken back by velocities that the rows see, and at no more than the kinetic energy that the projection frees.
TEST_P(InextensibleFibers, AreShortenedWithoutMakingEnergy) {
  for (const double speed : {0.0, 1e-6, 1e-3, 1.0}) {
    kit::GridSystem s = random_block(random, {GetParam(), 4, 2, kit::Block::uniform, kit::Block::rest, kit::Block::free});
    for (double& v : s.velocity) v *= speed;
    const double before = s.product(s.velocity, s.velocity);
    const Eigen::MatrixXd B = equation_22(s, Multipliers::staggered);
    ProjectionMemory memory;
    hold_fibers(s, memory, {.tolerance = 1e-9}, Multipliers::staggered, 0.01, 10);
    const double after = s.product(s.velocity, s.velocity), rate = (B * vector(s.velocity)).sum();
    EXPECT_LE(after, before * (1 + 1e-12)) << speed;
    if (speed == 0) {
      EXPECT_EQ(after, 0);
    } else {
      EXPECT_LT(rate, 0) << "they shorten";
    }
    if (speed == 1) {
      double volume = 0;
      for (const double v : s.volume) volume += v;
      EXPECT_NEAR(rate / volume, -0.1, 0.02) << "at the rate that is asked for";
    }
  }
}

TEST_P(InextensibleFibers, AreHeldTheSameWithFactorsOfAnotherStep) {
  kit::GridSystem first = random_block(random, {GetParam(), 5, 2, kit::Block::uniform, kit::Block::rest, kit::Block::free});
  kit::GridSystem second = first;
  std::vector<bool> keep(second.particle_count());  // rows go and come
  for (std::size_t p = 0; p < keep.size(); ++p) keep[p] = second.position[p * std::size_t(GetParam())] < second.position[0] + 4;
  kit::GridSystem part = first;
  part.keep_particles(keep);
  const Projection::Options options{.tolerance = 1e-10, .relaxation = 1e-4};
  ProjectionMemory used, unused;
  kit::GridSystem again = part;
  hold_fibers(part, used, options);
  const ConstraintReport with = hold_fibers(second, used, options);
  hold_fibers(first, unused, options);
  EXPECT_LE(with.residual, 1e-10);
  EXPECT_LT((vector(second.velocity) - vector(first.velocity)).norm(), 1e-6 * vector(first.velocity).norm());
  EXPECT_LE(hold_fibers(again, used, options).residual, 1e-10);
}

TEST_P(InextensibleFibers, AreHeldTheSameToTheBitWithARestoredMemory) {
  for (const std::size_t factor_bytes : {std::size_t(1) << 20, std::size_t(0)}) {
    kit::GridSystem first =
        random_block(random, {GetParam(), 4, 2, kit::Block::uniform, kit::Block::strained, kit::Block::free});
    kit::GridSystem second = first;
    for (double& v : second.velocity) v = random.uniform(-1, 1);
    kit::GridSystem again = second;
    const Projection::Options options{.tolerance = 1e-9, .factor_bytes = factor_bytes};
    ProjectionMemory memory, restored;
    hold_fibers(first, memory, options);
    const std::vector<std::byte> saved = memory.save();
    restored.restore(saved);
    EXPECT_EQ(restored.save(), saved);
    hold_fibers(second, memory, options);
    hold_fibers(again, restored, options);
    EXPECT_EQ(second.velocity, again.velocity);
    EXPECT_EQ(restored.save(), memory.save());
    EXPECT_THROW(restored.restore(std::span(saved).first(saved.size() - 1)), std::invalid_argument);
    EXPECT_THROW(restored.restore({}), std::invalid_argument);
  }
}

}  // namespace
}  // namespace cleave
