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

/// Points of the stiffness in an octant: its Gauss points, because one in its middle would not feel the twisting of an element.
constexpr double gauss = 0.28867513459481287;
}  // namespace

/// f(node, weights of the corners)
template <class T, int D>
template <class F>
void CoarseSpace<T, D>::for_nodes(const Octant& octant, F&& f) const {
  constexpr int edge = GridShape<D>::block_edge;
  double high[3][half];
  int first = 0;
  for (int a = 0; a < D; a++) {
    first = first * edge + half * (octant.number >> (D - 1 - a) & 1);
    for (int i = 0; i < half; i++) high[a][i] = double(octant.offset[std::size_t(a)] + i) / edge_;
  }
  for (int i = 0; i < half; i++)
    for (int j = 0; j < half; j++) {
      double plane[4];
      for (int c = 0; c < 4; c++) plane[c] = (c & 2 ? high[0][i] : 1 - high[0][i]) * (c & 1 ? high[1][j] : 1 - high[1][j]);
      const std::size_t node = octant.block * GridShape<D>::block_nodes;
      if constexpr (D == 2) {
        f(node + std::size_t(first + i * edge + j), plane);
      } else {
        for (int k = 0; k < half; k++) {
          double weight[8];
          for (int c = 0; c < 8; c++) weight[c] = plane[c / 2] * (c & 1 ? high[2][k] : 1 - high[2][k]);
          f(node + std::size_t(first + (i * edge + j) * edge + k), weight);
        }
      }
    }
}

/// Corners are those of elements with particles. Nodes outside of these follow what corners they have.
template <class T, int D>
void CoarseSpace<T, D>::number_corners(const Grid<T, D>& grid, const IncrementalPotential<T, D>& potential) {
  constexpr int per_block = 1 << D;
  octants_.clear();
  for (const std::size_t block : potential.blocks())
    for (int number = 0; number < per_block; number++) {
      Octant o{block, number, false, {}, {}};
      const T* tangent = potential.octants() + (block * per_block + std::size_t(number)) * tangent_numbers<D>;
      o.stiff = std::any_of(tangent, tangent + tangent_numbers<D>, [](T x) { return x != T(0); });
      bool empty = true;
      for_nodes(o, [&](std::size_t node, const double*) { empty = empty && !(potential.target()[4 * node] > T(0)); });
      if (!empty) octants_.push_back(o);
    }
  BlockDirectory directory;
  for (int group = 1;; group *= 2) {
    directory.reset(octants_.size());
    corner_count_ = 0;
    edge_ = half * group;
    for (const bool stiff : {true, false})
      for (Octant& o : octants_) {
        if (o.stiff != stiff) continue;
        const BlockCoordinate& block = grid.coordinate(o.block);
        BlockCoordinate element{};
        for (std::size_t a = 0; a < D; a++) {
          const int at = 2 * block[a] + (o.number >> (D - 1 - int(a)) & 1);
          element[a] = floor_divide(at, group);
          o.offset[a] = (at - element[a] * group) * half;
        }
        for (int c = 0; c < corners; c++) {
          BlockCoordinate corner = element;
          for (int a = 0; a < D; a++) corner[std::size_t(a)] += c >> (D - 1 - a) & 1;
          std::uint32_t& number = o.corner[std::size_t(c)];
          number =
              stiff ? directory.insert(morton_key(corner), std::uint32_t(corner_count_)) : directory.find(morton_key(corner));
          if (stiff && number == corner_count_) corner_count_++;
        }
      }
    if (corner_count_ <= most_corners) return;
  }
}

template <class T, int D>
void CoarseSpace<T, D>::build(const Grid<T, D>& grid, const IncrementalPotential<T, D>& potential,
                              const ImplicitBoundary<T, D>& boundary) {
  constexpr int n = D * D, packed = tangent_numbers<D>, size = corners * D, points = 1 << D;
  number_corners(grid, potential);

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
  std::vector<Element> elements(octants_.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, octants_.size(), 16), [&](const auto& range) {
    using Tangent = Eigen::Matrix<double, n, n>;
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const Octant& octant = octants_[i];
      Element& K = elements[i];
      K.setZero();
      Tangent tangent;
      const T* from = potential.octants() + (octant.block * (1 << D) + std::size_t(octant.number)) * packed;
      for (int r = 0; r < n; r++)
        for (int c = r; c < n; c++, from++) tangent(r, c) = tangent(c, r) = double(*from) / 16;
      if (!tangent.isZero(0)) {
        const double size_of_tangent = tangent.diagonal().cwiseAbs().sum();
        if (Eigen::LLT<Tangent>(tangent + 1e-6 * size_of_tangent * Tangent::Identity()).info() != Eigen::Success) {
          const Eigen::SelfAdjointEigenSolver<Tangent> eigen(tangent);
          tangent = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * eigen.eigenvectors().transpose();
        }
        tangent /= points;
        for (int point = 0; point < points; point++) {
          double x[D];
          for (int a = 0; a < D; a++)
            x[a] = (octant.offset[std::size_t(a)] + half * (0.5 + gauss * ((point >> a & 1) ? 1 : -1))) / edge_;
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
          K.noalias() += gradient.transpose() * (tangent * gradient);
        }
      }
      const T* target = potential.target();
      for_nodes(octant, [&](std::size_t node, const double* weight) {
        const double mass = double(target[4 * node]);
        if (!(mass > 0)) return;
        Eigen::Matrix<double, D, D> D_i = mass * Eigen::Matrix<double, D, D>::Identity();
        const auto resists =
            std::lower_bound(held.begin(), held.end(), node, [](const Held& h, std::size_t k) { return h.node < k; });
        if (resists != held.end() && resists->node == node) D_i += resists->resistance;
        for (int c = 0; c < corners; c++)
          for (int d = 0; d < corners; d++) K.template block<D, D>(c * D, d * D) += weight[c] * weight[d] * D_i;
      });
    }
  });

  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(octants_.size() * std::size_t(size * (size + 1) / 2));
  for (std::size_t i = 0; i < octants_.size(); i++)
    for (int r = 0; r < size; r++)
      for (int c = 0; c < size; c++) {
        const int row = int(octants_[i].corner[std::size_t(r / D)]) * D + r % D;
        const int column = int(octants_[i].corner[std::size_t(c / D)]) * D + c % D;
        const bool missing = octants_[i].corner[std::size_t(r / D)] == BlockDirectory::none ||
                             octants_[i].corner[std::size_t(c / D)] == BlockDirectory::none;
        if (!missing && row >= column && elements[i](r, c) != 0) entries.emplace_back(row, column, elements[i](r, c));
      }
  const auto unknowns = Eigen::Index(corner_count_) * D;
  Eigen::SparseMatrix<double> A(unknowns, unknowns);
  A.setFromTriplets(entries.begin(), entries.end());
  factor_.compute(A);
  ready_ = factor_.info() == Eigen::Success && factor_.vectorD().minCoeff() > 0;
  multiplications_ = 0;
  const auto& L = factor_.matrixL().nestedExpression();
  for (Eigen::Index column = 0; column < unknowns; column++) {
    const double below = L.outerIndexPtr()[column + 1] - L.outerIndexPtr()[column];
    multiplications_ += below * below;
  }
  right_.resize(unknowns);
  parts_.resize(octants_.size() * std::size_t(size));
}

template <class T, int D>
double CoarseSpace<T, D>::solve(const T* residual) {
  constexpr std::size_t size = corners * D;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, octants_.size(), 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      double* sum = parts_.data() + i * size;
      std::fill_n(sum, size, 0.0);
      for_nodes(octants_[i], [&](std::size_t node, const double* weight) {
        for (std::size_t c = 0; c < corners; c++)
          for (std::size_t a = 0; a < D; a++) sum[c * D + a] += weight[c] * double(residual[4 * node + 1 + a]);
      });
    }
  });
  right_.setZero();
  for (std::size_t i = 0; i < octants_.size(); i++)
    for (std::size_t c = 0; c < corners; c++)
      for (std::size_t a = 0; a < D && octants_[i].corner[c] != BlockDirectory::none; a++)
        right_[Eigen::Index(std::size_t(octants_[i].corner[c]) * D + a)] += parts_[i * size + c * D + a];
  solution_ = factor_.solve(right_);
  return right_.dot(solution_);
}

template <class T, int D>
void CoarseSpace<T, D>::add_to(T* vector) const {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, octants_.size(), 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++)
      for_nodes(octants_[i], [&](std::size_t node, const double* weight) {
        for (std::size_t a = 0; a < D; a++) {
          double sum = 0;
          for (std::size_t c = 0; c < corners; c++)
            if (octants_[i].corner[c] != BlockDirectory::none)
              sum += weight[c] * solution_[Eigen::Index(std::size_t(octants_[i].corner[c]) * D + a)];
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
