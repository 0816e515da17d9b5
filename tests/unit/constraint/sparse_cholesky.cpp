// Sparse Cholesky factors against dense ones.

#include <cleave/sparse_cholesky.hpp>

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

namespace cleave {
namespace {

const auto in_order = [](std::size_t count, auto&& task) {
  for (std::size_t i = 0; i < count; ++i) task(i);
};
const auto backwards = [](std::size_t count, auto&& task) {
  for (std::size_t i = count; i-- > 0;) task(i);
};

/// G G^T + I, where the rows of G reach the neighbours of a point on a lattice, some of the points left out.
template <class S>
struct Lattice {
  SymmetricRows<S> rows;
  std::vector<std::array<float, 3>> place;
  Eigen::MatrixXd dense;

  explicit Lattice(std::array<int, 3> size) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int x = 0; x < size[0]; ++x)
      for (int y = 0; y < size[1]; ++y)
        for (int z = 0; z < size[2]; ++z)
          if (uniform(random) < 0.8) place.push_back({float(x), float(y), float(z)});
    std::shuffle(place.begin(), place.end(), random);
    const auto n = Eigen::Index(place.size());
    Eigen::MatrixXd G = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index i = 0; i < n; ++i)
      for (Eigen::Index j = 0; j < n; ++j) {
        float distance = 0;
        for (unsigned a = 0; a < 3; ++a)
          distance = std::max(distance, std::abs(place[std::size_t(i)][a] - place[std::size_t(j)][a]));
        if (distance <= 1) G(i, j) = uniform(random);
      }
    dense = G * G.transpose() + Eigen::MatrixXd::Identity(n, n);
    rows.begin.push_back(0);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j <= i; ++j)
        if (dense(i, j) != 0) {
          rows.column.push_back(std::uint32_t(j));
          rows.value.push_back(S(dense(i, j)));
        }
      rows.begin.push_back(rows.column.size());
    }
  }
};

template <class S>
class SparseFactors : public testing::Test {};
using Scalars = testing::Types<float, double>;
TYPED_TEST_SUITE(SparseFactors, Scalars, );

TYPED_TEST(SparseFactors, SolveWhatDenseOnesDo) {
  using S = TypeParam;
  for (const std::array<int, 3>& size :
       {std::array{7, 7, 7}, std::array{60, 4, 2}, std::array{18, 18, 1}, std::array{2, 2, 2}}) {
    const Lattice<S> lattice(size);
    const std::size_t n = lattice.place.size();
    const S shift = S(0.25);
    SparseCholesky<S> cholesky;
    cholesky.analyze(lattice.rows, lattice.place);
    cholesky.factor(lattice.rows, shift, in_order);
    std::vector<S> x(n);
    for (std::size_t i = 0; i < n; ++i) x[i] = S(std::sin(double(i)));
    Eigen::VectorXd b(n);
    for (std::size_t i = 0; i < n; ++i) b[Eigen::Index(i)] = x[i];
    cholesky.solve(x, in_order);
    Eigen::VectorXd found(n);
    for (std::size_t i = 0; i < n; ++i) found[Eigen::Index(i)] = x[i];
    const Eigen::MatrixXd shifted = lattice.dense + shift * Eigen::MatrixXd::Identity(Eigen::Index(n), Eigen::Index(n));
    EXPECT_LT((shifted.llt().solve(b) - found).norm(), 2e3 * std::numeric_limits<S>::epsilon() * found.norm());
  }
}

TYPED_TEST(SparseFactors, AreTheSameInWhateverOrderTheTasksRun) {
  const Lattice<TypeParam> lattice({12, 9, 8});
  std::vector<TypeParam> x(lattice.place.size(), 1), y = x;
  SparseCholesky<TypeParam> one, other;
  one.analyze(lattice.rows, lattice.place);
  other.analyze(lattice.rows, lattice.place);
  one.factor(lattice.rows, 1, in_order);
  other.factor(lattice.rows, 1, backwards);
  one.solve(x, in_order);
  other.solve(y, backwards);
  EXPECT_EQ(x, y);
}

TYPED_TEST(SparseFactors, OfARopeGrowWithItsLength) {
  SparseCholesky<TypeParam> shorter, longer;
  const Lattice<TypeParam> half({80, 3, 3}), whole({160, 3, 3});
  shorter.analyze(half.rows, half.place);
  longer.analyze(whole.rows, whole.place);
  EXPECT_LT(longer.work(), 3 * shorter.work());
  EXPECT_LT(longer.entries(), 3 * double(shorter.entries()));
}

}  // namespace
}  // namespace cleave
