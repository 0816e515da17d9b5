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
/// that is B' M^-1 B'^T lambda = B v* - c, u = M^-1 B'^T lambda, without ever forming that matrix. Each row acts with equal and
/// opposite impulses wherever its coefficients sum to zero over the nodes, as those of a velocity gradient do: momentum is
/// kept.
#ifndef CLEAVE_PROJECTION_HPP
#define CLEAVE_PROJECTION_HPP

#include <cleave/constraint.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
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

/// Rows of B v = c, and the projection onto them. Nodes with a prescribed velocity keep it, those that are fixed along a normal
/// keep that part; what they give to the rows is met by the others.
class Projection {
 public:
  struct Options {
    double tolerance = 1e-6;  ///< of |B v - c| relative to |B v* - c|
    std::uint32_t maximum_iterations = 1000;
  };

  /// The system has to outlive this object.
  explicit Projection(const cleave_constraint_system& system)
      : system_(system), d_(system.dimension), number_of_node_(system.node_count, absent) {}

  /// Begins a row whose right-hand side is `value`. A row to which nothing is added is none.
  void begin_row(double value = 0) {
    end_row();
    value_ = value;
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
  ConstraintReport solve(Options options) {
    end_row();
    const std::size_t rows = row_end_.size(), unknowns = nodes_.size() * d_;
    ConstraintReport report;
    report.rows = rows;
    const double begun = norm(residual_);
    if (!std::isfinite(begun)) throw std::runtime_error("a row of the constraint has numbers that are not finite");
    if (begun <= rounding * std::sqrt(squared_magnitude_)) return report;

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

  std::size_t row_begin() const { return row_end_.empty() ? 0 : row_end_.back(); }
  double& velocity(std::size_t unknown) const { return system_.velocity[nodes_[unknown / d_] * d_ + unknown % d_]; }

  /// Closes the present row: B v* - c with all of it, then what acts on the velocities that are free.
  void end_row() {
    const std::size_t begin = row_begin(), end = column_.size();
    if (begin == end) return;
    double residual = -value_, magnitude = std::abs(value_), whole = 0, free = 0;
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
  double value_ = 0;
  std::vector<std::size_t> row_end_;  // rows as entries one after another: a column, and d coefficients
  std::vector<std::uint32_t> column_;
  std::vector<double> coefficient_;
  std::vector<double> residual_, length_;  // B v* - c and 1/S, of each row
  double squared_magnitude_ = 0;
  std::vector<double> mass_;  // of each unknown
};

}  // namespace cleave

#endif
