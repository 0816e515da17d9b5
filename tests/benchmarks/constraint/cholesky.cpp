// The matrix of the rows of inextensible fibres, factored by the multifrontal method of the SDK and by Eigen's SimplicialLLT
// (AMD order): cholesky_benchmark [cells along a block of 5:4:4, default 20]. One thread, which is what Eigen uses.
#include <cleave/sparse_cholesky.hpp>

#include <time.h>

#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <vector>

namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Index3 = std::array<int, 3>;

/// S B M^-1 B^T S of staggered rows in a block of cells with eight particles each, fibres along its length, rows of unit
/// length.
struct Block {
  std::vector<Index3> place;  // of each row, in halves of a cell
  Sparse matrix;

  explicit Block(const Index3& cells) {
    std::map<Index3, int> node, row;
    std::vector<double> mass;
    std::map<std::pair<int, int>, double> B;
    const auto number = [](std::map<Index3, int>& of, const Index3& at) {
      return of.try_emplace(at, int(of.size())).first->second;
    };
    for (int x = 0; x < 2 * cells[0]; x++)
      for (int y = 0; y < 2 * cells[1]; y++)
        for (int z = 0; z < 2 * cells[2]; z++) {
          const double at[3] = {(x + 0.5) / 2, (y + 0.5) / 2, (z + 0.5) / 2};
          double N[3][3], dN[3], f[3];
          int base[3];
          for (int a = 0; a < 3; a++) {
            base[a] = int(std::floor(at[a] - 0.5));
            f[a] = at[a] - 0.5 - base[a];
            N[a][0] = 0.5 * (1 - f[a]) * (1 - f[a]);
            N[a][1] = 0.5 + f[a] * (1 - f[a]);
            N[a][2] = 0.5 * f[a] * f[a];
          }
          dN[0] = f[0] - 1;
          dN[1] = 1 - 2 * f[0];
          dN[2] = f[0];
          for (int end = 0; end < 2; end++) {
            const double gamma = end ? f[0] : 1 - f[0];
            const int r = number(row, {2 * (base[0] + end) + 1, 2 * (base[1] + 1), 2 * (base[2] + 1)});
            for (int n = 0; n < 27; n++) {
              const int i = n / 9, j = n / 3 % 3, k = n % 3, c = number(node, {base[0] + i, base[1] + j, base[2] + k});
              mass.resize(node.size());
              if (end == 0) mass[std::size_t(c)] += N[0][i] * N[1][j] * N[2][k];
              B[{r, c}] += gamma * dN[i] * N[1][j] * N[2][k];
            }
          }
        }
    place.resize(row.size());
    for (const auto& [at, r] : row) place[std::size_t(r)] = at;
    std::vector<double> squared(row.size());
    std::vector<Eigen::Triplet<double>> entries;
    for (auto& [at, value] : B) {
      value /= std::sqrt(mass[std::size_t(at.second)]);
      squared[std::size_t(at.first)] += value * value;
    }
    for (const auto& [at, value] : B)
      entries.emplace_back(at.first, at.second, value / std::sqrt(squared[std::size_t(at.first)]));
    Sparse A(Eigen::Index(row.size()), Eigen::Index(node.size()));
    A.setFromTriplets(entries.begin(), entries.end());
    matrix = A * Sparse(A.transpose());
  }
};

double processor_seconds() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}
double seconds(const auto& work) {
  double least = 1e300;
  for (int i = 0; i < 3; i++) {
    const double before = processor_seconds();
    work();
    least = std::min(least, processor_seconds() - before);
  }
  return least;
}

void report(const char* method, double analyze, double factor, double solve, double entries, double residual) {
  std::printf("%-28s analyze %8.1f ms  factor %8.1f ms  solve %6.2f ms  %6.2f million numbers  residual %.1e\n", method,
              1e3 * analyze, 1e3 * factor, 1e3 * solve, 1e-6 * entries, residual);
}

template <class S>
void measure_sdk(const Block& block, const char* name) {
  cleave::SymmetricRows<S> rows;
  rows.begin.push_back(0);
  for (Eigen::Index i = 0; i < block.matrix.rows(); i++) {
    for (Sparse::InnerIterator e(block.matrix, i); e; ++e)
      if (e.index() <= i) {
        rows.column.push_back(std::uint32_t(e.index()));
        rows.value.push_back(S(e.value()));
      }
    rows.begin.push_back(rows.column.size());
  }
  std::vector<std::array<float, 3>> place;
  for (const Index3& p : block.place) place.push_back({float(p[0]), float(p[1]), float(p[2])});
  const auto alone = [](std::size_t count, auto&& task) {
    for (std::size_t i = 0; i < count; i++) task(i);
  };
  cleave::SparseCholesky<S> cholesky;
  std::vector<S> x;
  const double analyze = seconds([&] { cholesky.analyze(rows, place); });
  const double factor = seconds([&] { cholesky.factor(rows, S(1e-6), alone); });
  const double solve = seconds([&] {
    x.assign(rows.size(), S(1));
    cholesky.solve(x, alone);
  });
  Eigen::VectorXd found(block.matrix.rows());
  for (std::size_t i = 0; i < x.size(); i++) found[Eigen::Index(i)] = double(x[i]);
  const Eigen::VectorXd one = Eigen::VectorXd::Ones(found.size());
  report(name, analyze, factor, solve, double(cholesky.entries()), (block.matrix * found - one).norm() / one.norm());
}

template <class S>
void measure_eigen(const Block& block, const char* name) {
  using Matrix = Eigen::SparseMatrix<S>;
  const Matrix matrix = block.matrix.cast<S>();
  Eigen::SimplicialLLT<Matrix> cholesky;
  cholesky.setShift(S(1e-6));
  Eigen::Matrix<S, Eigen::Dynamic, 1> x;
  const Eigen::Matrix<S, Eigen::Dynamic, 1> one = Eigen::Matrix<S, Eigen::Dynamic, 1>::Ones(matrix.rows());
  const double analyze = seconds([&] { cholesky.analyzePattern(matrix); });
  const double factor = seconds([&] { cholesky.factorize(matrix); });
  const double solve = seconds([&] { x = cholesky.solve(one); });
  report(name, analyze, factor, solve, double(Matrix(cholesky.matrixL()).nonZeros()),
         (block.matrix * x.template cast<double>() - one.template cast<double>()).norm() / double(one.norm()));
}

}  // namespace

int main(int count, char** arguments) {
  const int length = count > 1 ? std::atoi(arguments[1]) : 20;
  const Block block({length, length * 4 / 5, length * 4 / 5});
  std::printf("%td rows, %td entries in the lower triangle\n", block.matrix.rows(),
              (block.matrix.nonZeros() + block.matrix.rows()) / 2);
  measure_sdk<float>(block, "multifrontal, single");
  measure_sdk<double>(block, "multifrontal, double");
  measure_eigen<float>(block, "Eigen SimplicialLLT, single");
  measure_eigen<double>(block, "Eigen SimplicialLLT, double");
}
