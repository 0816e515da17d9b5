#include "mpm/coarse_space.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace cleave::mpm {

namespace {
/// Corners that are cheap to factorise beside a step; more make for larger groups.
constexpr std::size_t most_corners = 4000;

int floor_divide(int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }
}  // namespace

template <class T, int D>
void CoarseSpace<T, D>::hats(const Block& block, double (&high)[3][8]) const {
  for (int a = 0; a < D; a++)
    for (int i = 0; i < GridShape<D>::block_edge; i++) high[a][i] = double(block.offset[std::size_t(a)] + i) / edge_;
}

/// f(node, weights of the corners)
template <class T, int D>
template <class F>
void CoarseSpace<T, D>::for_nodes(const Block& block, F&& f) const {
  constexpr int n = GridShape<D>::block_edge;
  double high[3][8], weight[corners];
  hats(block, high);
  std::size_t node = block.first_node;
  for (int i = 0; i < n; i++)
    for (int j = 0; j < n; j++)
      for (int k = 0; k < (D == 3 ? n : 1); k++, node++) {
        for (int c = 0; c < corners; c++) {
          const int bits[3] = {c >> (D - 1) & 1, c >> (D - 2) & 1, D == 3 ? c & 1 : 0};
          weight[c] = (bits[0] ? high[0][i] : 1 - high[0][i]) * (bits[1] ? high[1][j] : 1 - high[1][j]);
          if constexpr (D == 3) weight[c] *= bits[2] ? high[2][k] : 1 - high[2][k];
        }
        f(node, weight);
      }
}

template <class T, int D>
void CoarseSpace<T, D>::build(const Grid<T, D>& grid, const IncrementalPotential<T, D>& potential,
                              const ImplicitBoundary<T, D>& boundary) {
  constexpr int edge = GridShape<D>::block_edge, n = D * D, packed = tangent_numbers<D>, size = corners * D;
  blocks_.resize(potential.blocks().size());
  BlockDirectory directory;
  for (int blocks_per_edge = 1;; blocks_per_edge *= 2) {
    directory.reset(2 * blocks_.size());
    corner_count_ = 0;
    edge_ = edge * blocks_per_edge;
    for (std::size_t i = 0; i < blocks_.size(); i++) {
      const BlockCoordinate& at = grid.coordinate(potential.blocks()[i]);
      Block& b = blocks_[i];
      b.first_node = std::size_t(potential.blocks()[i]) * GridShape<D>::block_nodes;
      BlockCoordinate group{};
      for (std::size_t a = 0; a < D; a++) {
        group[a] = floor_divide(at[a], blocks_per_edge);
        b.offset[a] = (at[a] - group[a] * blocks_per_edge) * edge;
      }
      for (int c = 0; c < corners; c++) {
        BlockCoordinate corner = group;
        for (int a = 0; a < D; a++) corner[std::size_t(a)] += c >> (D - 1 - a) & 1;
        const std::uint32_t number = directory.insert(morton_key(corner), std::uint32_t(corner_count_));
        b.corner[std::size_t(c)] = number;
        if (number == corner_count_) corner_count_++;
      }
    }
    if (corner_count_ <= most_corners) break;
  }

  // Held nodes, each with the size of its diagonal block and what is not free, in the order of the blocks.
  struct Held {
    std::size_t node;
    Eigen::Matrix<double, D, D> resistance;
  };
  std::vector<Held> held;
  boundary.for_projectors([&](std::size_t node, const Matrix3& free) {
    const T* d = potential.diagonal() + node * diagonal_numbers;
    double stiffness = double(potential.target()[4 * node]);
    for (int a = 0, at = 0; a < D; at += D - a, a++) stiffness += std::abs(double(d[at])) / D;
    held.push_back({node, stiffness * (Matrix3::Identity() - free).template topLeftCorner<D, D>()});
  });
  std::sort(held.begin(), held.end(), [](const Held& a, const Held& b) { return a.node < b.node; });

  using Element = Eigen::Matrix<double, size, size>;
  std::vector<Element> elements(blocks_.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks_.size(), 8), [&](const auto& range) {
    using Tangent = Eigen::Matrix<double, n, n>;
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const Block& block = blocks_[i];
      Element& K = elements[i];
      K.setZero();
      const T* octants = potential.octants() + block.first_node / GridShape<D>::block_nodes * std::size_t((1 << D) * packed);
      for (int octant = 0; octant < 1 << D; octant++) {
        Tangent tangent;
        for (int r = 0, at = octant * packed; r < n; r++)
          for (int c = r; c < n; c++, at++) tangent(r, c) = tangent(c, r) = double(octants[at]) / 16;
        const double trace = tangent.trace();
        if (trace == 0 && tangent.isZero()) continue;
        if (Eigen::LLT<Tangent>(tangent + 1e-6 * std::abs(trace) * Tangent::Identity()).info() != Eigen::Success) {
          const Eigen::SelfAdjointEigenSolver<Tangent> eigen(tangent);
          tangent = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * eigen.eigenvectors().transpose();
        }
        double x[D];
        for (int a = 0; a < D; a++)
          x[a] = (block.offset[std::size_t(a)] + (0.25 + 0.5 * (octant >> (D - 1 - a) & 1)) * edge) / edge_;
        // gradient of the velocities, D*D, by those of the corners
        Eigen::Matrix<double, n, size> gradient;
        gradient.setZero();
        for (int c = 0; c < corners; c++)
          for (int along = 0; along < D; along++) {
            double slope = 1.0 / edge_;
            for (int a = 0; a < D; a++) {
              const bool high = c >> (D - 1 - a) & 1;
              slope *= a == along ? (high ? 1 : -1) : high ? x[a] : 1 - x[a];
            }
            for (int component = 0; component < D; component++) gradient(component * D + along, c * D + component) = slope;
          }
        K += gradient.transpose() * tangent * gradient;
      }
      const T* target = potential.target();
      auto resists = std::lower_bound(held.begin(), held.end(), block.first_node,
                                      [](const Held& h, std::size_t node) { return h.node < node; });
      for_nodes(block, [&](std::size_t node, const double* weight) {
        const double mass = double(target[4 * node]);
        if (!(mass > 0)) return;
        Eigen::Matrix<double, D, D> D_i = mass * Eigen::Matrix<double, D, D>::Identity();
        for (; resists != held.end() && resists->node <= node; ++resists)
          if (resists->node == node) D_i += resists->resistance;
        for (int c = 0; c < corners; c++)
          for (int d = 0; d < corners; d++) K.template block<D, D>(c * D, d * D) += weight[c] * weight[d] * D_i;
      });
    }
  });

  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(blocks_.size() * std::size_t(size * (size + 1) / 2));
  for (std::size_t i = 0; i < blocks_.size(); i++)
    for (int r = 0; r < size; r++)
      for (int c = 0; c < size; c++) {
        const int row = int(blocks_[i].corner[std::size_t(r / D)]) * D + r % D;
        const int column = int(blocks_[i].corner[std::size_t(c / D)]) * D + c % D;
        if (row >= column && elements[i](r, c) != 0) entries.emplace_back(row, column, elements[i](r, c));
      }
  const auto unknowns = Eigen::Index(corner_count_) * D;
  Eigen::SparseMatrix<double> A(unknowns, unknowns);
  A.setFromTriplets(entries.begin(), entries.end());
  factor_.compute(A);
  ready_ = factor_.info() == Eigen::Success && factor_.vectorD().minCoeff() > 0;
  right_.resize(unknowns);
  parts_.resize(blocks_.size() * std::size_t(size));
}

template <class T, int D>
double CoarseSpace<T, D>::solve(const T* residual) {
  constexpr std::size_t size = corners * D;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks_.size(), 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      double* sum = parts_.data() + i * size;
      std::fill_n(sum, size, 0.0);
      for_nodes(blocks_[i], [&](std::size_t node, const double* weight) {
        for (std::size_t c = 0; c < corners; c++)
          for (std::size_t a = 0; a < D; a++) sum[c * D + a] += weight[c] * double(residual[4 * node + 1 + a]);
      });
    }
  });
  right_.setZero();
  for (std::size_t i = 0; i < blocks_.size(); i++)
    for (std::size_t c = 0; c < corners; c++)
      for (std::size_t a = 0; a < D; a++)
        right_[Eigen::Index(std::size_t(blocks_[i].corner[c]) * D + a)] += parts_[i * size + c * D + a];
  solution_ = factor_.solve(right_);
  return right_.dot(solution_);
}

template <class T, int D>
void CoarseSpace<T, D>::add_to(T* vector) const {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks_.size(), 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++)
      for_nodes(blocks_[i], [&](std::size_t node, const double* weight) {
        for (std::size_t a = 0; a < D; a++) {
          double sum = 0;
          for (std::size_t c = 0; c < corners; c++)
            sum += weight[c] * solution_[Eigen::Index(std::size_t(blocks_[i].corner[c]) * D + a)];
          vector[4 * node + 1 + a] += T(sum);
        }
      });
  });
}

template class CoarseSpace<float, 2>;
template class CoarseSpace<float, 3>;
template class CoarseSpace<double, 2>;
template class CoarseSpace<double, 3>;

}  // namespace cleave::mpm
