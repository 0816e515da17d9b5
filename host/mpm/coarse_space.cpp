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

/// Pivots of a diagonal of 1 below which rounding has left nothing.
constexpr double least_pivot = 1e-12;

void run_parallel(std::size_t count, const auto& task) {
  tbb::parallel_for(std::size_t(0), count, [&](std::size_t i) { task(i); });
}
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

template <class T, int D>
template <class F>
void CoarseSpace<T, D>::for_octants(F&& f) const {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, octants_.size(), 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++) f(i);
  });
}

/// The octants with mass, in the order of the blocks.
template <class T, int D>
void CoarseSpace<T, D>::find_octants(const IncrementalPotential<T, D>& potential) {
  constexpr std::size_t per_block = std::size_t(1) << D;
  const auto& blocks = potential.blocks();
  std::vector<char> full(blocks.size() * per_block);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, full.size(), 64), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const Octant octant{blocks[i / per_block], int(i % per_block), {}, {}, {}};
      bool any = false;
      for_nodes(octant, [&](std::size_t node, const double*) { any = any || potential.target()[4 * node] > T(0); });
      full[i] = any;
    }
  });
  octants_.clear();
  for (std::size_t i = 0; i < full.size(); i++)
    if (full[i]) octants_.push_back({blocks[i / per_block], int(i % per_block), {}, {}, {}});
}

/// In the mesh of elements of `edge_`.
template <class T, int D>
void CoarseSpace<T, D>::place(const Grid<T, D>& grid, Octant& o) const {
  const BlockCoordinate& block = grid.coordinate(o.block);
  const int group = edge_ / half;
  o.element = {};
  for (std::size_t a = 0; a < D; a++) {
    const int at = 2 * block[a] + (o.number >> (D - 1 - int(a)) & 1);
    o.element[a] = floor_divide(at, group);
    o.offset[a] = (at - o.element[a] * group) * half;
  }
}

namespace {
template <int D>
BlockCoordinate corner_of(const BlockCoordinate& element, int c, int sign = 1) {
  BlockCoordinate corner = element;
  for (int a = 0; a < D; a++) corner[std::size_t(a)] += sign * (c >> (D - 1 - a) & 1);
  return corner;
}
}  // namespace

template <class T, int D>
void CoarseSpace<T, D>::find_nodes(const Grid<T, D>& grid, const IncrementalPotential<T, D>& potential) {
  find_octants(potential);
  for_octants([&](std::size_t i) {
    Octant& o = octants_[i];
    place(grid, o);
    for (int c = 0; c < corners_of_element; c++)
      o.corner[std::size_t(c)] = directory_.find(morton_key(corner_of<D>(o.element, c)));
  });
  parts_.resize(octants_.size() * std::size_t(corners_of_element * D));
}

/// Corners are those of elements with particles. Nodes outside of these follow what corners they have.
template <class T, int D>
void CoarseSpace<T, D>::make_mesh(const Grid<T, D>& grid, const IncrementalPotential<T, D>& potential) {
  constexpr std::size_t per_block = std::size_t(1) << D;
  ready_ = false;
  find_octants(potential);
  for (edge_ = half;; edge_ *= 2) {
    directory_.reset(octants_.size());
    corners_.clear();
    for (Octant& o : octants_) {
      const T* tangent = potential.octants() + (o.block * per_block + std::size_t(o.number)) * tangent_numbers<D>;
      if (std::all_of(tangent, tangent + tangent_numbers<D>, [](T x) { return x == T(0); })) continue;
      place(grid, o);
      for (int c = 0; c < corners_of_element; c++) {
        const BlockCoordinate corner = corner_of<D>(o.element, c);
        const auto next = std::uint32_t(corners_.size());
        if (directory_.insert(morton_key(corner), next) == next) corners_.push_back(corner);
      }
    }
    if (corners_.size() <= most_corners) break;
  }
  find_nodes(grid, potential);
  make_pattern();
  analyze();
}

/// Rows of each corner, coupled with all corners that may share an element with it.
template <class T, int D>
void CoarseSpace<T, D>::make_pattern() {
  std::vector<std::vector<std::uint32_t>> before(corners_.size());
  tbb::parallel_for(std::size_t(0), corners_.size(), [&](std::size_t i) {
    for (int n = 0; n < GridShape<D>::neighbours; n++) {
      BlockCoordinate other = corners_[i];
      for (int a = 0, rest = n; a < D; a++, rest /= 3) other[std::size_t(a)] += rest % 3 - 1;
      const std::uint32_t j = directory_.find(morton_key(other));
      if (j != BlockDirectory::none && j < i) before[i].push_back(j);
    }
    std::sort(before[i].begin(), before[i].end());
  });
  matrix_.begin.assign(1, 0);
  matrix_.column.clear();
  for (std::size_t i = 0; i < corners_.size(); i++)
    for (std::uint32_t r = 0; r < D; r++) {
      for (const std::uint32_t j : before[i])
        for (std::uint32_t c = 0; c < D; c++) matrix_.column.push_back(j * D + c);
      for (std::uint32_t c = 0; c <= r; c++) matrix_.column.push_back(std::uint32_t(i) * D + c);
      matrix_.begin.push_back(matrix_.column.size());
    }
}

template <class T, int D>
void CoarseSpace<T, D>::analyze() {
  std::vector<std::array<float, 3>> place(corners_.size() * D);
  for (std::size_t i = 0; i < place.size(); i++)
    for (std::size_t a = 0; a < 3; a++) place[i][a] = float(corners_[i / D][a]);
  factor_.analyze(matrix_, place);
  right_.resize(place.size());
  solution_.resize(place.size());
}

template <class T, int D>
void CoarseSpace<T, D>::restore() {
  directory_.reset(corners_.size());
  for (std::size_t i = 0; i < corners_.size(); i++) directory_.insert(morton_key(corners_[i]), std::uint32_t(i));
  if (!ready_) return;
  analyze();
  factor_.factor(matrix_, least_pivot, [](std::size_t count, const auto& task) { run_parallel(count, task); });
}

template <class T, int D>
void CoarseSpace<T, D>::factorise(const IncrementalPotential<T, D>& potential, const ImplicitBoundary<T, D>& boundary) {
  constexpr int n = D * D, packed = tangent_numbers<D>, corners = corners_of_element, size = corners * D, points = 1 << D;

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

  // Mean over an octant of d(weight of corner c)/dx_a d(weight of corner d)/dx_b, for each place of an octant in its element.
  const int group = edge_ / half;
  using Slopes = std::array<double, std::size_t(corners * corners * D * D)>;
  std::vector<Slopes> slopes(std::size_t(std::pow(group, D)));
  tbb::parallel_for(std::size_t(0), slopes.size(), [&](std::size_t which) {
    double x[D];
    Slopes& sum = slopes[which];
    sum.fill(0);
    for (int point = 0; point < points; point++) {
      std::size_t rest = which;
      for (int a = D; a-- > 0; rest /= std::size_t(group))
        x[a] = (double(rest % std::size_t(group)) + 0.5 + gauss * ((point >> a & 1) ? 1 : -1)) / group;
      double slope[corners][D];
      for (int c = 0; c < corners; c++)
        for (int along = 0; along < D; along++) {
          slope[c][along] = 1.0 / edge_;
          for (int a = 0; a < D; a++) {
            const bool high = c >> (D - 1 - a) & 1;
            slope[c][along] *= a == along ? (high ? 1 : -1) : high ? x[a] : 1 - x[a];
          }
        }
      double* to = sum.data();
      for (int c = 0; c < corners; c++)
        for (int d = 0; d < corners; d++)
          for (int a = 0; a < D; a++)
            for (int b = 0; b < D; b++) *to++ += slope[c][a] * slope[d][b] / points;
    }
  });

  // Octants of each element, in their order.
  BlockDirectory element_numbers;
  element_numbers.reset(octants_.size());
  std::vector<std::vector<std::uint32_t>> members;
  for (std::size_t i = 0; i < octants_.size(); i++) {
    const auto next = std::uint32_t(members.size());
    const std::uint32_t element = element_numbers.insert(morton_key(octants_[i].element), next);
    if (element == next) members.emplace_back();
    members[element].push_back(std::uint32_t(i));
  }

  using Element = Eigen::Matrix<double, size, size>;
  std::vector<Element> elements(members.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, elements.size(), 16), [&](const auto& range) {
    using Tangent = Eigen::Matrix<double, n, n>;
    for (std::size_t e = range.begin(); e < range.end(); e++) {
      Element& K = elements[e];
      K.setZero();
      for (const std::uint32_t i : members[e]) {
        const Octant& octant = octants_[i];
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
          std::size_t which = 0;
          for (std::size_t a = 0; a < D; a++) which = which * std::size_t(group) + std::size_t(octant.offset[a] / half);
          const double* slope = slopes[which].data();
          for (int c = 0; c < corners; c++)
            for (int d = 0; d < corners; d++, slope += n)
              for (int r = 0; r < D; r++)
                for (int k = 0; k < D; k++) {
                  double sum = 0;
                  for (int a = 0; a < D; a++)
                    for (int b = 0; b < D; b++) sum += slope[a * D + b] * tangent(r * D + a, k * D + b);
                  K(c * D + r, d * D + k) += sum;
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
    }
  });

  // Each corner takes its rows from the elements around it.
  matrix_.value.assign(matrix_.column.size(), 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, corners_.size(), 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++) {
      const std::uint32_t* columns = matrix_.column.data() + matrix_.begin[i * D];
      const auto end = columns + (matrix_.begin[i * D + 1] - matrix_.begin[i * D]);
      for (int c = 0; c < corners; c++) {
        const std::uint32_t e = element_numbers.find(morton_key(corner_of<D>(corners_[i], c, -1)));
        if (e == BlockDirectory::none) continue;
        const auto& around = octants_[members[e].front()].corner;
        for (int d = 0; d < corners; d++) {
          const std::uint32_t j = around[std::size_t(d)];
          if (j == BlockDirectory::none || j > i) continue;
          const auto at = std::size_t(std::lower_bound(columns, end, j * D) - columns);
          for (std::size_t r = 0; r < D; r++)
            for (std::size_t k = 0; k < (j == i ? r + 1 : D); k++)
              matrix_.value[matrix_.begin[i * D + r] + at + k] += elements[e](c * D + int(r), d * D + int(k));
        }
      }
    }
  });
  const std::size_t rows = matrix_.size();
  scale_.resize(rows);
  for (std::size_t i = 0; i < rows; i++) {
    double& diagonal = matrix_.value[matrix_.begin[i + 1] - 1];
    if (!(diagonal > 0)) diagonal = 1;
    scale_[i] = 1 / std::sqrt(diagonal);
  }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rows, 256), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); i++)
      for (std::size_t at = matrix_.begin[i]; at < matrix_.begin[i + 1]; at++)
        matrix_.value[at] *= scale_[i] * scale_[matrix_.column[at]];
  });
  factor_.factor(matrix_, least_pivot, [](std::size_t count, const auto& task) { run_parallel(count, task); });
  ready_ = true;
}

template <class T, int D>
double CoarseSpace<T, D>::solve(const T* residual) {
  constexpr std::size_t corners = corners_of_element, size = corners * D;
  for_octants([&](std::size_t i) {
    double* sum = parts_.data() + i * size;
    std::fill_n(sum, size, 0.0);
    for_nodes(octants_[i], [&](std::size_t node, const double* weight) {
      for (std::size_t c = 0; c < corners; c++)
        for (std::size_t a = 0; a < D; a++) sum[c * D + a] += weight[c] * double(residual[4 * node + 1 + a]);
    });
  });
  std::fill(right_.begin(), right_.end(), 0.0);
  for (std::size_t i = 0; i < octants_.size(); i++)
    for (std::size_t c = 0; c < corners; c++)
      for (std::size_t a = 0; a < D && octants_[i].corner[c] != BlockDirectory::none; a++)
        right_[std::size_t(octants_[i].corner[c]) * D + a] += parts_[i * size + c * D + a];
  for (std::size_t i = 0; i < right_.size(); i++) solution_[i] = scale_[i] * right_[i];
  factor_.solve(solution_, [](std::size_t count, const auto& task) { run_parallel(count, task); });
  double product = 0;
  for (std::size_t i = 0; i < right_.size(); i++) {
    solution_[i] *= scale_[i];
    product += right_[i] * solution_[i];
  }
  return product;
}

template <class T, int D>
void CoarseSpace<T, D>::add_to(T* vector) const {
  for_octants([&](std::size_t i) {
    for_nodes(octants_[i], [&](std::size_t node, const double* weight) {
      for (std::size_t a = 0; a < D; a++) {
        double sum = 0;
        for (std::size_t c = 0; c < corners_of_element; c++)
          if (octants_[i].corner[c] != BlockDirectory::none)
            sum += weight[c] * solution_[std::size_t(octants_[i].corner[c]) * D + a];
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
