/// Linear constraints on grid velocities: an author writes the rows of B, the projection is found here.
///
///   Projection projection(system);
///   for (...) {
///     projection.begin_row(c);              // a row of B v = c
///     projection.add(node, coefficients);   // d numbers: the part of one node's velocity
///   }
///   return projection.solve();
///
/// finds, with u = v* - v and B' the part of B that acts on what is not prescribed,
///
///   minimise  1/2 u^T M u   subject to   B' u = B v* - c
///
/// that is B' M^-1 B'^T lambda = B v* - c, u = M^-1 B'^T lambda. Each row acts with equal and opposite impulses wherever its
/// coefficients sum to zero over the nodes, as those of a velocity gradient do: momentum is kept.
///
/// Many rows on a grid are nearly dependent, and iterations then need thousands of steps. With a ProjectionMemory, a member of
/// the law, the matrix is factored, and the factors serve as the preconditioner of later steps as long as they are good:
///
///   Projection projection(system, memory);
///   projection.begin_row({.value = c, .cell = {i, j, k}});   // the cell tells rows apart from step to step
#ifndef CLEAVE_PROJECTION_HPP
#define CLEAVE_PROJECTION_HPP

#include <cleave/constraint.hpp>
#include <cleave/sparse_cholesky.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <vector>

namespace cleave {

/// Gradients of the quadratic B-splines around a particle: (grad v)_ij = sum_n v_i(node[n]) value[n][j].
struct GradientWeights {
  unsigned count = 0;                             ///< 3^d
  std::array<std::uint64_t, 27> node{};           ///< rows of the system
  std::array<std::array<double, 3>, 27> value{};  ///< grad N at the particle [1/m]; in 2D the last component is 0
};

inline GradientWeights gradient_weights(const cleave_constraint_system& system, std::uint64_t particle) {
  const unsigned d = system.dimension;
  const double* x = system.position + particle * d;
  std::array<std::array<double, 3>, 3> N{}, dN{};  // of each axis
  for (unsigned a = 0; a < d; ++a) {
    const double q = x[a] - std::floor(x[a] - 0.5) - 1;  // from the middle node, in [-1/2, 1/2)
    N[a] = {0.5 * (0.5 - q) * (0.5 - q), 0.75 - q * q, 0.5 * (0.5 + q) * (0.5 + q)};
    dN[a] = {(q - 0.5) / system.cell_size, -2 * q / system.cell_size, (q + 0.5) / system.cell_size};
  }
  GradientWeights weights;
  weights.count = d == 3 ? 27 : 9;
  for (unsigned n = 0; n < weights.count; ++n) {
    weights.node[n] = system.nodes[particle * weights.count + n];
    const std::array<unsigned, 3> k =
        d == 3 ? std::array<unsigned, 3>{n / 9, n / 3 % 3, n % 3} : std::array<unsigned, 3>{n / 3, n % 3, 0};
    for (unsigned j = 0; j < d; ++j) {
      double value = 1;
      for (unsigned a = 0; a < d; ++a) value *= a == j ? dN[a][k[a]] : N[a][k[a]];
      weights.value[n][j] = value;
    }
  }
  return weights;
}

/// The unit vector along F fiber: where fibres that move with the material point. Zero where there is none.
inline std::array<double, 3> current_fiber(const cleave_constraint_system& system, std::uint64_t particle) {
  const double *F = system.deformation + particle * 9, *fiber = system.fiber + particle * 3;
  std::array<double, 3> a{};
  double squared = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) a[i] += F[i * 3 + j] * fiber[j];
    squared += a[i] * a[i];
  }
  const double scale = squared > 0 ? 1 / std::sqrt(squared) : 0;
  for (double& component : a) component *= scale;
  return a;
}

/// The particles of each grid cell. One row for all particles of a cell leaves the nodes room to move where one for each
/// particle would lock them; and as cells lie between nodes, no row is blind to velocities that alternate from node to node.
inline std::vector<std::vector<std::uint64_t>> particles_by_cell(const cleave_constraint_system& system) {
  constexpr std::uint64_t none = ~std::uint64_t(0);
  const unsigned d = system.dimension;
  const std::uint64_t stencil = d == 3 ? 27 : 9;
  std::vector<std::uint64_t> cell_of_node(system.node_count, none);  // by the node at the cell's lower corner
  std::vector<std::vector<std::uint64_t>> cells;
  for (std::uint64_t p = 0; p < system.particle_count; ++p) {
    std::uint64_t corner = 0;
    for (unsigned a = 0; a < d; ++a) {
      const double x = system.position[p * d + a];
      corner = corner * 3 + std::uint64_t(std::floor(x) - std::floor(x - 0.5));
    }
    std::uint64_t& cell = cell_of_node[system.nodes[p * stencil + corner]];
    if (cell == none) {
      cell = cells.size();
      cells.emplace_back();
    }
    cells[cell].push_back(p);
  }
  return cells;
}

namespace detail {

/// Factors of S B' M^-1 B'^T S + shift I of a step, and what the steps since then took with them.
template <class S>
class ProjectionFactors {
 public:
  using Cell = std::array<std::int32_t, 3>;

  bool any() const { return cholesky_.size() > 0; }
  /// Whether another iteration with them costs more, with those there were too many of since they were made, than new ones.
  bool worn(std::uint32_t iterations) const {
    return excess_ + double(iterations) - fresh_ > (cholesky_.work() * 4e-11 + pairs_ * 2e-9) / iteration_seconds_;
  }
  void took(std::uint32_t iterations) {
    if (fresh_ < 0)
      fresh_ = iterations;
    else
      excess_ += std::max(0.0, double(iterations) - fresh_);
  }

  template <class Run>
  void make(const SymmetricRows<S>& matrix, const std::vector<Cell>& cells, S shift, std::size_t coefficients, Run run) {
    std::vector<std::array<float, 3>> place(cells.size());
    for (std::size_t i = 0; i < cells.size(); ++i) place[i] = {float(cells[i][0]), float(cells[i][1]), float(cells[i][2])};
    cholesky_.analyze(matrix, place);
    cholesky_.factor(matrix, shift, run);
    numbers_.clear();
    for (std::size_t i = 0; i < cells.size(); ++i) numbers_.emplace(key(cells[i]), std::uint32_t(i));
    match(cells);
    excess_ = 0;
    fresh_ = -1;
    pairs_ = double(matrix.column.size());
    iteration_seconds_ = double(cholesky_.entries() * sizeof(S)) * 2e-10 + double(coefficients) * 1e-9;
  }
  /// The rows of another step. Those that were not there stand for themselves.
  void match(const std::vector<Cell>& cells) {
    number_of_row_.assign(cells.size(), none);
    std::vector<bool> taken(cholesky_.size(), false);
    for (std::size_t i = 0; i < cells.size(); ++i)
      if (const auto found = numbers_.find(key(cells[i])); found != numbers_.end() && !taken[found->second]) {
        taken[found->second] = true;
        number_of_row_[i] = found->second;
      }
  }
  /// z = (...)^-1 r
  template <class Run>
  void apply(const std::vector<double>& r, std::vector<double>& z, Run run) {
    double largest = 0;
    for (const double value : r) largest = std::max(largest, std::abs(value));
    if (largest == 0) largest = 1;
    local_.assign(cholesky_.size(), 0);
    for (std::size_t i = 0; i < r.size(); ++i)
      if (number_of_row_[i] != none) local_[number_of_row_[i]] = S(r[i] / largest);
    cholesky_.solve(local_, run);
    for (std::size_t i = 0; i < r.size(); ++i)
      z[i] = number_of_row_[i] != none ? double(local_[number_of_row_[i]]) * largest : r[i];
  }

 private:
  static constexpr std::uint32_t none = ~std::uint32_t(0);
  static std::uint64_t key(const Cell& cell) {
    std::uint64_t k = 0;
    for (const std::int32_t c : cell) k = k << 21 | (std::uint64_t(c) & 0x1fffff);
    return k;
  }

  SparseCholesky<S> cholesky_;
  std::unordered_map<std::uint64_t, std::uint32_t> numbers_;
  std::vector<std::uint32_t> number_of_row_;
  std::vector<S> local_;
  double fresh_ = -1, excess_ = 0;  // iterations with the factors when they were new; more than those, since then
  double pairs_ = 0, iteration_seconds_ = 1;
};

}  // namespace detail

/// What a law keeps from step to step: the same results up to the tolerance, sooner.
class ProjectionMemory {
  friend class Projection;
  detail::ProjectionFactors<float> single_;
  detail::ProjectionFactors<double> double_;
};

/// Rows of B v = c, and the projection onto them. Nodes with a prescribed velocity keep it, those that are fixed along a normal
/// keep that part; what they give to the rows is met by the others.
class Projection {
 public:
  struct Options {
    double tolerance = 1e-6;  ///< of |B v - c| relative to |B v* - c|
    std::uint32_t maximum_iterations = 1000;
    /// With a memory: epsilon in B v + epsilon D lambda = c, D the diagonal of B' M^-1 B'^T; the residual is that of this.
    /// Rows give way to combinations of them that are of less than sqrt(epsilon) of their length. From 1e-6 on single precision
    /// does for the factors.
    double relaxation = 0;
  };

  struct Row {
    double value = 0;  ///< c
    /// With a memory: a rate that is added to c, in so far as that does not make kinetic energy: to undo drift.
    double correction = 0;
    std::array<std::int32_t, 3> cell{};  ///< where the row is; different for each
  };

  /// The system has to outlive this object, and so has the memory.
  explicit Projection(const cleave_constraint_system& system)
      : system_(system), d_(system.dimension), number_of_node_(system.node_count, absent) {}
  Projection(const cleave_constraint_system& system, ProjectionMemory& memory) : Projection(system) { memory_ = &memory; }

  /// Begins a row whose right-hand side is `value`. A row to which nothing is added is none.
  void begin_row(double value = 0) { begin_row(Row{.value = value}); }
  void begin_row(const Row& row) {
    end_row();
    row_ = row;
  }

  /// Adds to the coefficients that the present row has for the velocity of a node. In 2D the last one is not read.
  void add(std::uint64_t node, const std::array<double, 3>& coefficients) {
    std::uint32_t& number = number_of_node_[node];
    if (number == absent) {
      number = std::uint32_t(nodes_.size());
      nodes_.push_back(node);
      entry_of_number_.push_back(absent);
    }
    std::uint32_t& entry = entry_of_number_[number];
    if (entry == absent) {
      entry = std::uint32_t(column_.size() - row_begin());
      column_.push_back(number);
      coefficient_.resize(coefficient_.size() + d_, 0.0);
    }
    double* to = coefficient_.data() + (row_begin() + entry) * d_;
    for (unsigned a = 0; a < d_; ++a) to[a] += coefficients[a];
  }

  /// Changes the velocities of the system, once. Rows that contradict each other, or what is prescribed, are met in the sense
  /// of least squares, each in units of its diagonal (B' M^-1 B'^T)^(1/2); the residual of the report tells.
  ///
  /// Conjugate gradients on the normal equations (CGLS; Bjoerck, Numerical Methods for Least Squares Problems, 1996, 7.4) of
  /// S B' M^-1/2, where S gives the rows unit length. Its spectrum is that of B' M^-1 B'^T with the Jacobi preconditioner, and
  /// so are its iterations, but neither dependent nor contradictory rows disturb it.
  ///
  /// With a memory, conjugate gradients on B' M^-1 B'^T itself, preconditioned by its factors; should that come to nothing
  /// without relaxation, as with contradictory rows, the above.
  ConstraintReport solve(Options options) {
    end_row();
    const std::size_t rows = row_end_.size(), unknowns = nodes_.size() * d_;
    ConstraintReport report;
    report.rows = rows;
    const double begun = norm(residual_);
    if (!std::isfinite(begun)) throw std::runtime_error("a row of the constraint has numbers that are not finite");
    const bool corrected = std::any_of(correction_.begin(), correction_.end(), [](double c) { return c != 0; });
    if (begun <= rounding * std::sqrt(squared_magnitude_) && !corrected) return report;
    if (memory_) {
      const auto by_factors = [&](auto& factors) {
        return d_ == 3 ? solve_by_factors<3>(factors, options) : solve_by_factors<2>(factors, options);
      };
      std::vector<double> as_given(unknowns);
      for (std::size_t k = 0; k < unknowns; ++k) as_given[k] = velocity(k);
      report = options.relaxation >= single_relaxation ? by_factors(memory_->single_) : by_factors(memory_->double_);
      if (options.relaxation > 0 || report.residual <= options.tolerance) return report;
      for (std::size_t k = 0; k < unknowns; ++k) velocity(k) = as_given[k];
      options.maximum_iterations += report.iterations;
    }

    std::vector<double> before(unknowns), change(unknowns, 0.0), slope(unknowns), direction, r(rows), q(rows);
    mass_.resize(unknowns);
    for (std::size_t k = 0; k < unknowns; ++k) {
      before[k] = velocity(k);
      mass_[k] = system_.mass[nodes_[k / d_]];
    }
    for (std::size_t i = 0, e = 0; i < rows; ++i) {
      const double scale = length_[i] > 0 ? 1 / length_[i] : 0;
      r[i] = scale * residual_[i];
      for (; e < row_end_[i] * d_; ++e) coefficient_[e] *= scale;
    }
    const double enough = options.tolerance * norm_in_full(r);
    multiply_transposed(r, slope);
    direction = slope;
    double steepness = squared_by_mass(slope);
    while (report.iterations < options.maximum_iterations && norm_in_full(r) > enough) {
      // Nothing that can be changed reduces what is left of rows that contradict each other.
      if (std::sqrt(steepness) <= 1e-3 * options.tolerance * norm(r)) break;
      multiply(direction, q);
      const double squared = dot(q, q), step = steepness / squared;
      if (!(squared > 0)) break;
      for (std::size_t k = 0; k < unknowns; ++k) change[k] += step * direction[k];
      for (std::size_t i = 0; i < rows; ++i) r[i] -= step * q[i];
      multiply_transposed(r, slope);
      const double next = squared_by_mass(slope), turn = next / steepness;
      steepness = next;
      for (std::size_t k = 0; k < unknowns; ++k) direction[k] = slope[k] + turn * direction[k];
      ++report.iterations;
    }

    for (std::size_t k = 0; k < unknowns; ++k)
      if (change[k] != 0) velocity(k) -= change[k];
    for (std::size_t k = 0; k < unknowns; ++k) change[k] = velocity(k) - before[k];
    multiply(change, q);
    for (std::size_t i = 0; i < rows; ++i) r[i] = residual_[i] + length_[i] * q[i];
    report.residual = norm(r) / begun;
    return report;
  }
  ConstraintReport solve() { return solve(Options()); }

 private:
  static constexpr std::uint32_t absent = ~std::uint32_t(0);
  /// |B v* - c| that is no more than this part of the terms it is the sum of is their rounding.
  static constexpr double rounding = 1e-14;
  /// A row of whose length no more than this part is free to act is held as a whole: it would act with its rounding.
  static constexpr double held = 1e-6;
  /// The least epsilon with which single precision can make factors, and double precision.
  static constexpr double single_relaxation = 1e-6, double_relaxation = 1e-11;

  std::size_t row_begin() const { return row_end_.empty() ? 0 : row_end_.back(); }
  double& velocity(std::size_t unknown) const { return system_.velocity[nodes_[unknown / d_] * d_ + unknown % d_]; }

  /// Closes the present row: B v* - c with all of it, then what acts on the velocities that are free.
  void end_row() {
    const std::size_t begin = row_begin(), end = column_.size();
    if (begin == end) return;
    double residual = -row_.value, magnitude = std::abs(row_.value), whole = 0, free = 0;
    const auto squared_length = [&](std::uint64_t node, const double* b) {
      double sum = 0;
      for (unsigned a = 0; a < d_; ++a) sum += b[a] * b[a];
      return sum / system_.mass[node];
    };
    for (std::size_t e = begin; e < end; ++e) {
      entry_of_number_[column_[e]] = absent;
      const std::uint64_t node = nodes_[column_[e]];
      double* b = coefficient_.data() + e * d_;
      for (unsigned a = 0; a < d_; ++a) {
        const double term = b[a] * system_.velocity[node * d_ + a];
        residual += term;
        magnitude += std::abs(term);
      }
      whole += squared_length(node, b);
      release(node, b);
      free += squared_length(node, b);
    }
    if (!(free > held * held * whole)) {
      free = 0;
      std::fill(coefficient_.begin() + std::ptrdiff_t(begin * d_), coefficient_.end(), 0.0);
    }
    row_end_.push_back(end);
    residual_.push_back(residual);
    length_.push_back(std::sqrt(free));
    correction_.push_back(free > 0 ? row_.correction : 0);
    cell_.push_back(row_.cell);
    squared_magnitude_ += magnitude * magnitude;
  }

  /// Takes from b what acts on prescribed parts of the node's velocity.
  void release(std::uint64_t node, double* b) const {
    if (system_.prescribed[node] == 0) return;
    if (system_.prescribed[node] == 1) {
      std::fill_n(b, d_, 0.0);
      return;
    }
    const double* normal = system_.normal + node * d_;
    double along = 0;
    for (unsigned a = 0; a < d_; ++a) along += b[a] * normal[a];
    for (unsigned a = 0; a < d_; ++a) b[a] -= along * normal[a];
  }

  /// out = S B' in; S is in the coefficients
  void multiply(const std::vector<double>& in, std::vector<double>& out) const {
    std::size_t e = 0;
    for (std::size_t i = 0; i < row_end_.size(); ++i) {
      double sum = 0;
      for (; e < row_end_[i]; ++e)
        for (unsigned a = 0; a < d_; ++a) sum += coefficient_[e * d_ + a] * in[column_[e] * d_ + a];
      out[i] = sum;
    }
  }

  /// out = M^-1 B'^T S in
  void multiply_transposed(const std::vector<double>& in, std::vector<double>& out) const {
    std::fill(out.begin(), out.end(), 0.0);
    std::size_t e = 0;
    for (std::size_t i = 0; i < row_end_.size(); ++i)
      for (; e < row_end_[i]; ++e)
        for (unsigned a = 0; a < d_; ++a) out[column_[e] * d_ + a] += coefficient_[e * d_ + a] * in[i];
    for (std::size_t k = 0; k < out.size(); ++k) out[k] /= mass_[k];
  }

  // ---- with factors. A = S B' M^-1/2, by its rows (what is in row_end_, column_ and here) and by its nodes

  template <unsigned D, class S>
  ConstraintReport solve_by_factors(detail::ProjectionFactors<S>& factors, const Options& options) {
    const std::size_t rows = row_end_.size();
    ConstraintReport report;
    report.rows = rows;
    std::vector<double> scale(rows), by_root_mass(nodes_.size()), A(coefficient_.size());
    for (std::size_t i = 0; i < rows; ++i) scale[i] = length_[i] > 0 ? 1 / length_[i] : 0;
    for (std::size_t n = 0; n < nodes_.size(); ++n) by_root_mass[n] = 1 / std::sqrt(system_.mass[nodes_[n]]);
    for (std::size_t i = 0, e = 0; i < rows; ++i)
      for (; e < row_end_[i]; ++e)
        for (unsigned a = 0; a < D; ++a) A[e * D + a] = coefficient_[e * D + a] * scale[i] * by_root_mass[column_[e]];

    const auto run = [threads = threads_of(system_)](std::size_t count, auto&& task) {
      threads.for_each(count, [&](std::uint64_t i) { task(std::size_t(i)); });
    };
    const double shift = std::max(options.relaxation, std::is_same_v<S, float> ? single_relaxation : double_relaxation);
    const auto renew = [&] { factors.make(matrix<D, S>(A), cell_, S(shift), A.size(), run); };
    std::uint32_t since = 0;  // iterations of this step with the factors
    fresh_ = !factors.any() || factors.worn(0);
    if (fresh_)
      renew();
    else
      factors.match(cell_);

    // (A A^T + relaxation) x = b until nothing but `enough` is left, rows in their own units; what is left is in b then.
    std::vector<double> u(nodes_.size() * D), p, q(rows), z(rows);
    const auto iterate = [&](std::vector<double>& b, std::vector<double>& x, double relaxation, double enough,
                             std::uint32_t last) {
      double rz = 0;
      bool begun = false;
      while (report.iterations < last && !(norm_in_full(b) <= enough)) {
        if (since > 0 && factors.worn(since) && !fresh_) {
          renew();
          fresh_ = true;
          since = 0;
          begun = false;
        }
        factors.apply(b, z, run);
        const double next = dot(b, z);
        if (!(next > 0)) break;
        if (begun)
          for (std::size_t i = 0; i < rows; ++i) p[i] = z[i] + next / rz * p[i];
        else
          p = z;
        begun = true;
        rz = next;
        transposed_product<D>(A, p, u);
        product<D>(A, u, q);
        for (std::size_t i = 0; i < rows; ++i) q[i] += relaxation * p[i];
        const double step = rz / dot(p, q);
        if (!std::isfinite(step)) break;
        for (std::size_t i = 0; i < rows; ++i) x[i] += step * p[i], b[i] -= step * q[i];
        ++report.iterations;
        ++since;
      }
    };

    std::vector<double> rest(rows), lambda(rows, 0.0), u1(u.size());
    for (std::size_t i = 0; i < rows; ++i) rest[i] = scale[i] * residual_[i];
    const double begun = norm(residual_);
    iterate(rest, lambda, options.relaxation, options.tolerance * norm_in_full(rest), options.maximum_iterations);
    factors.took(since);
    transposed_product<D>(A, lambda, u1);
    report.residual = begun > 0 ? std::hypot(norm_in_full(rest), held_norm()) / begun : 0;

    // v = v* - u1 + theta w, w = M^-1 B'^T y: as much of w as keeps the kinetic energy at or below that of v*.
    double theta = 0;
    for (std::size_t i = 0; i < rows; ++i) rest[i] = scale[i] * correction_[i];
    if (const double wanted = norm_in_full(rest); wanted > 0) {
      std::vector<double> y(rows, 0.0);
      iterate(rest, y, std::max(options.relaxation, single_relaxation), 0.1 * wanted, report.iterations + 20);
      transposed_product<D>(A, y, u);
      double taken = 0, mixed = 0, own = 0;
      for (std::size_t n = 0; n < nodes_.size(); ++n)
        for (unsigned a = 0; a < D; ++a) {
          const std::size_t k = n * D + a;
          const double v = velocity(k) / by_root_mass[n];
          taken += (2 * v - u1[k]) * u1[k];
          mixed += u[k] * (v - u1[k]);
          own += u[k] * u[k];
        }
      if (own > 0) theta = std::min(1.0, (std::sqrt(mixed * mixed + own * std::max(taken, 0.0)) - mixed) / own);
    } else {
      std::fill(u.begin(), u.end(), 0.0);
    }
    for (std::size_t n = 0; n < nodes_.size(); ++n)
      for (unsigned a = 0; a < D; ++a) {
        const double change = by_root_mass[n] * (theta * u[n * D + a] - u1[n * D + a]);
        if (change != 0) velocity(n * D + a) += change;
      }
    return report;
  }

  /// A A^T, lower triangle
  template <unsigned D, class S>
  SymmetricRows<S> matrix(const std::vector<double>& A) const {
    const std::size_t rows = row_end_.size();
    std::vector<std::size_t> begin(nodes_.size() + 1, 0);
    for (const std::uint32_t n : column_) ++begin[n + 1];
    for (std::size_t n = 0; n < nodes_.size(); ++n) begin[n + 1] += begin[n];
    struct Entry {
      std::uint32_t row;
      std::array<S, D> value;
    };
    std::vector<Entry> of_node(column_.size());  // of those rows that are done, up to `end`
    std::vector<std::size_t> end(begin.begin(), begin.end() - 1);
    SymmetricRows<S> result;
    result.begin.reserve(rows + 1);
    result.begin.push_back(0);
    std::vector<S> sum(rows, 0);
    std::vector<std::uint32_t> reached, seen(rows, absent);
    for (std::uint32_t i = 0, e = 0; i < rows; ++i) {
      reached.clear();
      for (; e < row_end_[i]; ++e) {
        Entry entry{i, {}};
        bool any = false;
        for (unsigned a = 0; a < D; ++a) {
          entry.value[a] = S(A[e * D + a]);
          any = any || entry.value[a] != 0;
        }
        if (!any) continue;
        const std::uint32_t n = column_[e];
        of_node[end[n]++] = entry;
        for (std::size_t k = begin[n]; k < end[n]; ++k) {
          const Entry& other = of_node[k];
          S product = 0;
          for (unsigned a = 0; a < D; ++a) product += entry.value[a] * other.value[a];
          sum[other.row] += product;
          if (seen[other.row] != i) {
            seen[other.row] = i;
            reached.push_back(other.row);
          }
        }
      }
      if (seen[i] != i) reached.push_back(i);
      std::sort(reached.begin(), reached.end());
      for (const std::uint32_t j : reached) {
        result.column.push_back(j);
        result.value.push_back(sum[j]);
        sum[j] = 0;
      }
      result.begin.push_back(result.column.size());
    }
    return result;
  }

  /// Calls part(first row, last row, number of the part) for a few parts of the rows, in parallel.
  template <class Part>
  void for_parts(Part part) const {
    const std::size_t rows = row_end_.size();
    threads_of(system_).for_each(parts,
                                 [&](std::uint64_t k) { part(rows * k / parts, rows * (k + 1) / parts, std::size_t(k)); });
  }
  template <unsigned D>
  void product(const std::vector<double>& A, const std::vector<double>& in, std::vector<double>& out) const {
    for_parts([&](std::size_t first, std::size_t last, std::size_t) {
      for (std::size_t i = first, e = first ? row_end_[first - 1] : 0; i < last; ++i) {
        std::array<double, D> sum{};
        for (; e < row_end_[i]; ++e)
          for (unsigned a = 0; a < D; ++a) sum[a] += A[e * D + a] * in[column_[e] * D + a];
        double whole = 0;
        for (unsigned a = 0; a < D; ++a) whole += sum[a];
        out[i] = whole;
      }
    });
  }
  template <unsigned D>
  void transposed_product(const std::vector<double>& A, const std::vector<double>& in, std::vector<double>& out) {
    for_parts([&](std::size_t first, std::size_t last, std::size_t part) {
      std::vector<double>& sum = part_sums_[part];
      sum.assign(out.size(), 0);
      for (std::size_t i = first, e = first ? row_end_[first - 1] : 0; i < last; ++i)
        for (; e < row_end_[i]; ++e)
          for (unsigned a = 0; a < D; ++a) sum[column_[e] * D + a] += A[e * D + a] * in[i];
    });
    for (std::size_t k = 0; k < out.size(); ++k) {
      out[k] = 0;
      for (const auto& sum : part_sums_) out[k] += sum[k];
    }
  }
  /// Of the residuals of rows that are held.
  double held_norm() const {
    double sum = 0;
    for (std::size_t i = 0; i < length_.size(); ++i)
      if (length_[i] == 0) sum += residual_[i] * residual_[i];
    return std::sqrt(sum);
  }

  double squared_by_mass(const std::vector<double>& u) const {
    double sum = 0;
    for (std::size_t k = 0; k < u.size(); ++k) sum += mass_[k] * u[k] * u[k];
    return sum;
  }
  /// |S^-1 r|, rows that are held left out.
  double norm_in_full(const std::vector<double>& r) const {
    double sum = 0;
    for (std::size_t i = 0; i < r.size(); ++i) sum += length_[i] * r[i] * length_[i] * r[i];
    return std::sqrt(sum);
  }
  static double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  }
  static double norm(const std::vector<double>& a) { return std::sqrt(dot(a, a)); }

  const cleave_constraint_system& system_;
  unsigned d_;
  std::vector<std::uint32_t> number_of_node_;   // among the nodes that occur in rows, absent: none
  std::vector<std::uint64_t> nodes_;            // by number
  std::vector<std::uint32_t> entry_of_number_;  // in the present row
  Row row_;
  std::vector<std::size_t> row_end_;  // rows as entries one after another: a column, and d coefficients
  std::vector<std::uint32_t> column_;
  std::vector<double> coefficient_;
  std::vector<double> residual_, length_, correction_;  // B v* - c and 1/S, of each row
  std::vector<std::array<std::int32_t, 3>> cell_;
  double squared_magnitude_ = 0;
  std::vector<double> mass_;  // of each unknown
  static constexpr std::size_t parts = 4;
  std::array<std::vector<double>, parts> part_sums_;
  ProjectionMemory* memory_ = nullptr;
  bool fresh_ = false;  // the factors are of this step
};

}  // namespace cleave

#endif
