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
#include <cstring>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <utility>
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

/// Numbers and lists of them, one after another, as bytes.
class StateBytes {
 public:
  template <class Value>
  void put(const Value& value) {
    static_assert(std::is_trivially_copyable_v<Value>);
    const auto* begin = reinterpret_cast<const std::byte*>(&value);
    bytes_.insert(bytes_.end(), begin, begin + sizeof value);
  }
  template <class Value>
  void put(const std::vector<Value>& list) {
    put(std::uint64_t(list.size()));
    const auto* begin = reinterpret_cast<const std::byte*>(list.data());
    bytes_.insert(bytes_.end(), begin, begin + list.size() * sizeof(Value));
  }
  std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  std::vector<std::byte> bytes_;
};
class StateOfBytes {
 public:
  explicit StateOfBytes(std::span<const std::byte> bytes) : rest_(bytes) {}
  template <class Value>
  void get(Value& value) {
    std::memcpy(&value, next(1, sizeof value), sizeof value);
  }
  template <class Value>
  void get(std::vector<Value>& list) {
    std::uint64_t size = 0;
    get(size);
    const std::byte* from = next(size, sizeof(Value));
    list.resize(size);
    if (size > 0) std::memcpy(list.data(), from, size * sizeof(Value));
  }
  void end() const { require(rest_.empty()); }
  static void require(bool condition) {
    if (!condition) throw std::invalid_argument("these are not the bytes that a projection has saved");
  }

 private:
  const std::byte* next(std::uint64_t count, std::size_t size) {
    require(count <= rest_.size() / size);
    const std::byte* from = rest_.data();
    rest_ = rest_.subspan(count * size);
    return from;
  }
  std::span<const std::byte> rest_;
};

/// What stands for (S B' M^-1 B'^T S)^-1 in the iterations of a step and of those after it: Cholesky factors, complete ones as
/// long as they are small enough.
template <class S>
class ProjectionFactors {
 public:
  using Cell = std::array<std::int32_t, 3>;

  bool any() const { return !cells_.empty(); }
  /// Whether another iteration with them costs more, with those there were too many of since they were made, than new ones.
  bool worn(std::uint32_t iterations) const {
    return excess_ + double(iterations) - fresh_ > making_seconds_ / iteration_seconds_;
  }
  /// Whether a step is to begin with new ones: the present ones are worn, or the last that were tried in another step than
  /// their own came to nothing and it is not yet the time to try again.
  bool make_at_once() {
    if (!any() || worn(0)) return true;
    if (wait_ == 0) return false;
    --wait_;
    return true;
  }
  /// Iterations of a step with those that it ended with; `replaced`: it began with older ones, which did not do.
  void took(std::uint32_t iterations, bool replaced) {
    if (replaced) {
      patience_ = std::min(2 * patience_, longest_patience);
      wait_ = patience_;
    }
    if (fresh_ < 0) {
      fresh_ = iterations;
    } else {
      excess_ += std::max(0.0, double(iterations) - fresh_);
      patience_ = 1;
    }
  }

  template <class Run>
  void make(SymmetricRows<S> matrix, const std::vector<Cell>& cells, S shift, std::size_t coefficients, std::size_t most_bytes,
            Run run) {
    if (cells != cells_ || matrix.begin != pattern_.begin || matrix.column != pattern_.column) {
      cells_ = cells;
      analyze(matrix);
    }
    complete_ = cholesky_.entries() * sizeof(S) <= most_bytes;
    double numbers = double(matrix.column.size());
    // Seconds of a processor core; only their ratio matters, and not to more than a factor of two.
    making_seconds_ = 1e-8 * (double(coefficients) + numbers);
    if (complete_) {
      cholesky_.factor(matrix, shift, run);
      making_seconds_ += 1.3e-11 * cholesky_.work() * sizeof(S);
      numbers = double(cholesky_.entries());
    } else {
      incomplete_.factor(matrix, shift);
      making_seconds_ += 1e-9 * incomplete_.work();
    }
    iteration_seconds_ = 1e-10 * numbers * sizeof(S) + 1.5e-9 * double(coefficients);
    pattern_ = std::move(matrix);
    pattern_.value = {};
    match(cells);
    excess_ = 0;
    fresh_ = -1;
  }
  /// The rows of another step. Those that were not there stand for themselves.
  void match(const std::vector<Cell>& cells) {
    number_of_row_.assign(cells.size(), none);
    if (cells == cells_) {
      for (std::size_t i = 0; i < cells.size(); ++i) number_of_row_[i] = std::uint32_t(i);
      return;
    }
    std::vector<bool> taken(cells_.size(), false);
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
    local_.assign(cells_.size(), 0);
    for (std::size_t i = 0; i < r.size(); ++i)
      if (number_of_row_[i] != none) local_[number_of_row_[i]] = S(r[i] / largest);
    if (complete_)
      cholesky_.solve(local_, run);
    else
      incomplete_.solve(local_);
    for (std::size_t i = 0; i < r.size(); ++i)
      z[i] = number_of_row_[i] != none ? double(local_[number_of_row_[i]]) * largest : r[i];
  }

  void save(StateBytes& to) const {
    to.put(cells_);
    if (!any()) return;
    to.put(pattern_.begin);
    to.put(pattern_.column);
    to.put(complete_);
    to.put(complete_ ? cholesky_.values() : incomplete_.values());
    for (const double value : {fresh_, excess_, making_seconds_, iteration_seconds_}) to.put(value);
    for (const std::uint32_t value : {wait_, patience_}) to.put(value);
  }
  void restore(StateOfBytes& from) {
    from.get(cells_);
    if (!any()) return;
    from.get(pattern_.begin);
    from.get(pattern_.column);
    StateOfBytes::require(pattern_.size() == cells_.size() && pattern_.is_lower_triangle());
    analyze(pattern_);
    from.get(complete_);
    std::vector<S> values;
    from.get(values);
    StateOfBytes::require(complete_ ? cholesky_.take(std::move(values)) : incomplete_.take(pattern_, std::move(values)));
    for (double* value : {&fresh_, &excess_, &making_seconds_, &iteration_seconds_}) from.get(*value);
    for (std::uint32_t* value : {&wait_, &patience_}) from.get(*value);
  }

 private:
  void analyze(const SymmetricRows<S>& matrix) {
    std::vector<std::array<float, 3>> place(cells_.size());
    numbers_.clear();
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      place[i] = {float(cells_[i][0]), float(cells_[i][1]), float(cells_[i][2])};
      numbers_.emplace(key(cells_[i]), std::uint32_t(i));
    }
    cholesky_.analyze(matrix, place);
  }
  static constexpr std::uint32_t none = ~std::uint32_t(0);
  static std::uint64_t key(const Cell& cell) {
    std::uint64_t k = 0;
    for (const std::int32_t c : cell) k = k << 21 | (std::uint64_t(c) & 0x1fffff);
    return k;
  }

  SparseCholesky<S> cholesky_;
  IncompleteCholesky<S> incomplete_;
  bool complete_ = true;
  std::vector<Cell> cells_;   // of its rows
  SymmetricRows<S> pattern_;  // that was analyzed
  std::unordered_map<std::uint64_t, std::uint32_t> numbers_;
  std::vector<std::uint32_t> number_of_row_;
  std::vector<S> local_;
  double fresh_ = -1, excess_ = 0;  // iterations with the factors when they were new; more than those, since then
  double making_seconds_ = 0, iteration_seconds_ = 1;
  static constexpr std::uint32_t longest_patience = 32;
  std::uint32_t wait_ = 0,
                patience_ = 1;  // steps that begin with factors of their own; how many after the next failure, halved
};

}  // namespace detail

/// What a law keeps from step to step: the same results up to the tolerance, sooner.
class ProjectionMemory {
 public:
  std::vector<std::byte> save() const {
    detail::StateBytes to;
    single_.save(to);
    double_.save(to);
    return to.take();
  }
  /// Another one goes on as this one would have. Throws where save() has not written that.
  void restore(std::span<const std::byte> bytes) {
    detail::StateOfBytes from(bytes);
    ProjectionMemory found;
    found.single_.restore(from);
    found.double_.restore(from);
    from.end();
    *this = std::move(found);
  }

 private:
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
    /// Rows give way to combinations of them that are of less than sqrt(epsilon) of their length.
    double relaxation = 0;
    /// With a memory: what complete factors may take. Beyond it they are incomplete.
    std::size_t factor_bytes = std::size_t(256) << 20;
  };

  struct Row {
    double value = 0;  ///< c
    /// With a memory: a rate that is added to c, in so far as that does not make kinetic energy: to undo drift.
    double correction = 0;
    std::array<std::int32_t, 3> cell{};  ///< where the row is; different for each
  };

  /// One of the rows that are written at the same time.
  class RowWriter {
   public:
    Row row;
    /// Coefficients for the velocity of a node, once for each. In 2D the last one is not read.
    void add(std::uint64_t node, const std::array<double, 3>& coefficients) {
      if (end_ == last_) throw std::length_error("a row of the constraint has more entries than were announced");
      to_.column_[end_] = std::uint32_t(node);
      std::copy_n(coefficients.begin(), to_.d_, to_.coefficient_.data() + end_++ * to_.d_);
    }

   private:
    friend class Projection;
    RowWriter(Projection& to, std::size_t begin, std::size_t most) : to_(to), end_(begin), last_(begin + most) {}
    Projection& to_;
    std::size_t end_, last_;
  };

  /// The system has to outlive this object, and so has the memory.
  explicit Projection(const cleave_constraint_system& system) : system_(system), d_(system.dimension) {}
  Projection(const cleave_constraint_system& system, ProjectionMemory& memory) : Projection(system) { memory_ = &memory; }

  /// Begins a row whose right-hand side is `value`. A row to which nothing is added is none.
  void begin_row(double value = 0) { begin_row(Row{.value = value}); }
  void begin_row(const Row& row) {
    row_.push_back(row);
    begin_.push_back(column_.size());
    end_.push_back(column_.size());
  }

  /// Adds to the coefficients that the present row has for the velocity of a node. In 2D the last one is not read.
  void add(std::uint64_t node, const std::array<double, 3>& coefficients) {
    entry_of_node_.resize(system_.node_count, 0);
    std::size_t& entry = entry_of_node_[node];
    if (!(entry >= begin_.back() && entry < column_.size() && column_[entry] == node)) {
      entry = column_.size();
      column_.push_back(std::uint32_t(node));
      coefficient_.resize(coefficient_.size() + d_, 0.0);
      end_.back() = column_.size();
    }
    double* to = coefficient_.data() + entry * d_;
    for (unsigned a = 0; a < d_; ++a) to[a] += coefficients[a];
  }

  /// Adds `count` rows of at most `most` entries each: write(i, writer) fills row i, on whichever thread. The next row of
  /// others begins with begin_row().
  template <class Write>
  void add_rows(std::size_t count, std::size_t most, const Write& write) {
    const std::size_t first = row_.size(), entries = column_.size();
    row_.resize(first + count);
    begin_.resize(first + count);
    end_.resize(first + count);
    column_.resize(entries + count * most);
    coefficient_.resize((entries + count * most) * d_);
    threads_of(system_).for_ranges(count, 64, [&](std::uint64_t from, std::uint64_t to) {
      for (std::uint64_t i = from; i < to; ++i) {
        RowWriter writer(*this, entries + i * most, most);
        write(std::size_t(i), writer);
        row_[first + i] = writer.row;
        begin_[first + i] = entries + i * most;
        end_[first + i] = writer.end_;
      }
    });
  }

  /// Changes the velocities of the system, once. Rows that contradict each other, or what is prescribed, are met in the sense
  /// of least squares, each in units of its diagonal (B' M^-1 B'^T)^(1/2); the residual of the report tells.
  ///
  /// Conjugate gradients on the normal equations (CGLS; Bjoerck, Numerical Methods for Least Squares Problems, 1996, 7.4) of
  /// A = S B' M^-1/2, where S gives the rows unit length. Its spectrum is that of B' M^-1 B'^T with the Jacobi preconditioner,
  /// and so are its iterations, but neither dependent nor contradictory rows disturb it.
  ///
  /// With a memory, conjugate gradients on A A^T itself, preconditioned by its factors; should that come to nothing without
  /// relaxation, as with contradictory rows, the above.
  ConstraintReport solve(const Options& options) { return d_ == 3 ? solve<3>(options) : solve<2>(options); }
  ConstraintReport solve() { return solve(Options()); }

 private:
  /// |B v* - c| that is no more than this part of the terms it is the sum of is their rounding.
  static constexpr double rounding = 1e-14;
  /// With factors no less than this part of them is asked for: rows that hardly see velocities would make much of the rounding.
  static constexpr double least_left = 1e-12;
  /// A row of whose length no more than this part is free to act is held as a whole: it would act with its rounding.
  static constexpr double held = 1e-6;
  /// The least epsilon with which single precision can make factors, and double precision.
  static constexpr double single_relaxation = 1e-6, double_relaxation = 1e-11;
  /// Iterations that in so many do not halve what is left will not.
  static constexpr std::uint32_t patience = 60;

  template <unsigned D>
  ConstraintReport solve(const Options& options) {
    finish_rows<D>();
    ConstraintReport report;
    report.rows = row_.size();
    const double begun = norm(residual_);
    if (!std::isfinite(begun)) throw std::runtime_error("a row of the constraint has numbers that are not finite");
    double magnitude = 0;
    bool corrected = false;
    for (std::size_t i = 0; i < row_.size(); ++i) {
      magnitude += squared_magnitude_[i];
      corrected = corrected || row_[i].correction != 0;
    }
    if (begun <= rounding * std::sqrt(magnitude) && !corrected) return report;
    by_root_mass_.resize(system_.node_count);
    for (std::size_t n = 0; n < by_root_mass_.size(); ++n) by_root_mass_[n] = 1 / std::sqrt(system_.mass[n]);
    scale_rows<D>();

    if (memory_) {
      bool solved = false;
      const auto by_factors = [&](auto& factors) {
        solved = solve_by_factors<D>(factors, options, least_left * std::sqrt(magnitude), report);
      };
      if (options.relaxation >= single_relaxation)
        by_factors(memory_->single_);
      else
        by_factors(memory_->double_);
      if (solved) return report;
    }
    return solve_least_squares<D>(options, report);
  }

  /// Takes away rows without entries. Then, of each row: B v* - c with all of it, and what acts on the velocities that are
  /// free.
  template <unsigned D>
  void finish_rows() {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < row_.size(); ++i)
      if (end_[i] > begin_[i]) {
        row_[kept] = row_[i];
        begin_[kept] = begin_[i];
        end_[kept++] = end_[i];
      }
    row_.resize(kept);
    begin_.resize(kept);
    end_.resize(kept);
    residual_.resize(kept);
    length_.resize(kept);
    squared_magnitude_.resize(kept);
    for_rows([&](std::size_t i) {
      double residual = -row_[i].value, magnitude = std::abs(row_[i].value), whole = 0, free = 0;
      const auto squared_length = [&](std::uint64_t node, const double* b) {
        double sum = 0;
        for (unsigned a = 0; a < D; ++a) sum += b[a] * b[a];
        return sum / system_.mass[node];
      };
      for (std::size_t e = begin_[i]; e < end_[i]; ++e) {
        const std::uint64_t node = column_[e];
        double* b = coefficient_.data() + e * D;
        for (unsigned a = 0; a < D; ++a) {
          const double term = b[a] * system_.velocity[node * D + a];
          residual += term;
          magnitude += std::abs(term);
        }
        const double length = squared_length(node, b);
        whole += length;
        if (system_.prescribed[node] != 0) {
          release<D>(node, b);
          free += squared_length(node, b);
        } else {
          free += length;
        }
      }
      if (!(free > held * held * whole)) {
        free = 0;
        std::fill(coefficient_.begin() + std::ptrdiff_t(begin_[i] * D), coefficient_.begin() + std::ptrdiff_t(end_[i] * D),
                  0.0);
        row_[i].correction = 0;
      }
      residual_[i] = residual;
      length_[i] = std::sqrt(free);
      squared_magnitude_[i] = magnitude * magnitude;
    });
  }

  /// Takes from b what acts on prescribed parts of the node's velocity.
  template <unsigned D>
  void release(std::uint64_t node, double* b) const {
    if (system_.prescribed[node] == 1) {
      std::fill_n(b, D, 0.0);
      return;
    }
    const double* normal = system_.normal + node * D;
    double along = 0;
    for (unsigned a = 0; a < D; ++a) along += b[a] * normal[a];
    for (unsigned a = 0; a < D; ++a) b[a] -= along * normal[a];
  }

  /// From B' to A = S B' M^-1/2
  template <unsigned D>
  void scale_rows() {
    for_rows([&](std::size_t i) {
      const double scale = this->scale(i);
      for (std::size_t e = begin_[i]; e < end_[i]; ++e)
        for (unsigned a = 0; a < D; ++a) coefficient_[e * D + a] *= scale * by_root_mass_[column_[e]];
    });
  }
  double scale(std::size_t row) const { return length_[row] > 0 ? 1 / length_[row] : 0; }

  template <unsigned D>
  ConstraintReport solve_least_squares(const Options& options, ConstraintReport report) {
    const std::size_t rows = row_.size(), unknowns = system_.node_count * D;
    std::vector<double> change(unknowns, 0.0), slope(unknowns), direction, r(rows), q(rows);
    for (std::size_t i = 0; i < rows; ++i) r[i] = scale(i) * residual_[i];
    const double enough = options.tolerance * norm_in_full(r);
    const std::uint32_t last = report.iterations + options.maximum_iterations;
    transposed_product<D>(r, slope);
    direction = slope;
    double steepness = dot(slope, slope);
    while (report.iterations < last && norm_in_full(r) > enough) {
      // Nothing that can be changed reduces what is left of rows that contradict each other.
      if (std::sqrt(steepness) <= 1e-3 * options.tolerance * norm(r)) break;
      product<D>(direction, q);
      const double step = steepness / dot(q, q);
      if (!std::isfinite(step)) break;
      for (std::size_t k = 0; k < unknowns; ++k) change[k] += step * direction[k];
      for (std::size_t i = 0; i < rows; ++i) r[i] -= step * q[i];
      transposed_product<D>(r, slope);
      const double next = dot(slope, slope), turn = next / steepness;
      steepness = next;
      for (std::size_t k = 0; k < unknowns; ++k) direction[k] = slope[k] + turn * direction[k];
      ++report.iterations;
    }
    take_from_velocities<D>(change);
    product<D>(change, q);
    for (std::size_t i = 0; i < rows; ++i) r[i] = residual_[i] - length_[i] * q[i];
    report.residual = norm(r) / norm(residual_);
    return report;
  }

  /// v = v* - M^-1/2 y
  template <unsigned D>
  void take_from_velocities(const std::vector<double>& y) {
    for (std::size_t n = 0; n < system_.node_count; ++n)
      for (unsigned a = 0; a < D; ++a)
        if (y[n * D + a] != 0) system_.velocity[n * D + a] -= by_root_mass_[n] * y[n * D + a];
  }

  // ---- with factors

  /// Whether the velocities have been changed. What is left is not asked to be less than `least`.
  template <unsigned D, class S>
  bool solve_by_factors(detail::ProjectionFactors<S>& factors, const Options& options, double least, ConstraintReport& report) {
    const std::size_t rows = row_.size();
    std::vector<std::array<std::int32_t, 3>> cells(rows);
    for (std::size_t i = 0; i < rows; ++i) cells[i] = row_[i].cell;
    const auto run = [threads = threads_of(system_)](std::size_t count, auto&& task) {
      threads.for_each(count, [&](std::uint64_t i) { task(std::size_t(i)); });
    };
    const double shift = std::max(options.relaxation, std::is_same_v<S, float> ? single_relaxation : double_relaxation);
    std::size_t coefficients = 0;
    for (std::size_t i = 0; i < rows; ++i) coefficients += (end_[i] - begin_[i]) * D;
    const auto renew = [&] { factors.make(matrix<D, S>(), cells, S(shift), coefficients, options.factor_bytes, run); };
    bool fresh = factors.make_at_once(), replaced = false;  // the factors are of this step
    std::uint32_t since = 0;                                // iterations of this step with the factors
    if (fresh)
      renew();
    else
      factors.match(cells);

    // (A A^T + relaxation) x = b until nothing but `enough` is left, rows in their own units; what is left is in b then.
    std::vector<double> p, u(system_.node_count * D), q(rows), z(rows);
    const auto iterate = [&](std::vector<double>& b, std::vector<double>& x, double relaxation, double enough,
                             std::uint32_t most) {
      double rz = 0, left = norm_in_full(b), best = left;
      std::uint32_t without_success = 0;
      bool begun = false;
      while (report.iterations < options.maximum_iterations && left > enough) {
        if ((fresh || most < patience) && without_success >= most) break;
        if (!fresh && since > 0 && (factors.worn(since) || without_success >= most)) {
          renew();
          fresh = replaced = true;
          since = without_success = 0;
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
        transposed_product<D>(p, u);
        product<D>(u, q);
        for (std::size_t i = 0; i < rows; ++i) q[i] += relaxation * p[i];
        const double step = rz / dot(p, q);
        if (!std::isfinite(step)) break;
        for (std::size_t i = 0; i < rows; ++i) x[i] += step * p[i], b[i] -= step * q[i];
        ++report.iterations;
        ++since;
        left = norm_in_full(b);
        ++without_success;
        if (left < 0.5 * best) {
          best = left;
          without_success = 0;
        }
      }
      return left <= enough;
    };

    std::vector<double> rest(rows), lambda(rows, 0.0), y(u.size());
    for (std::size_t i = 0; i < rows; ++i) rest[i] = scale(i) * residual_[i];
    const double begun = norm(residual_);
    const bool met =
        iterate(rest, lambda, options.relaxation, std::max(least, options.tolerance * norm_in_full(rest)), patience);
    transposed_product<D>(lambda, y);

    // v = v* - y + theta w in units of M^-1/2, A w the correction but for a hundredth: as much of w as keeps the kinetic energy
    // at or below that of v*.
    std::vector<double> correction(rows);
    for (std::size_t i = 0; i < rows; ++i) correction[i] = scale(i) * row_[i].correction;
    if (const double wanted = norm_in_full(correction); met && wanted > 0) {
      std::vector<double> w(u.size());
      std::fill(lambda.begin(), lambda.end(), 0.0);
      iterate(correction, lambda, shift, 0.01 * wanted, 3);
      transposed_product<D>(lambda, w);
      double taken = 0, mixed = 0, own = 0;
      for_unknowns<D>([&](std::size_t k, double v) {
        taken += (2 * v - y[k]) * y[k];
        mixed += w[k] * (v - y[k]);
        own += w[k] * w[k];
      });
      const double theta = own > 0 ? std::min(1.0, (std::sqrt(mixed * mixed + own * std::max(taken, 0.0)) - mixed) / own) : 0;
      for (std::size_t k = 0; k < y.size(); ++k) y[k] -= theta * w[k];
    }
    if (since > 0) factors.took(since, replaced);
    if (!met && options.relaxation == 0) return false;
    report.residual = begun > 0 ? std::hypot(norm_in_full(rest), held_norm()) / begun : 0;
    take_from_velocities<D>(y);
    return true;
  }

  /// Calls visit(k, k-th component of M^1/2 v*).
  template <unsigned D, class Visit>
  void for_unknowns(Visit visit) const {
    for (std::size_t n = 0; n < system_.node_count; ++n)
      for (unsigned a = 0; a < D; ++a) visit(n * D + a, system_.velocity[n * D + a] / by_root_mass_[n]);
  }

  /// A A^T, lower triangle
  template <unsigned D, class S>
  SymmetricRows<S> matrix() const {
    const std::size_t rows = row_.size();
    struct Entry {
      std::uint32_t row;
      std::array<S, D> value;
    };
    // The entries of each node, in the order of the rows
    std::vector<std::size_t> begin(system_.node_count + 1, 0);
    for (std::size_t i = 0; i < rows; ++i)
      for (std::size_t e = begin_[i]; e < end_[i]; ++e) ++begin[column_[e] + 1];
    for (std::size_t n = 0; n + 1 < begin.size(); ++n) begin[n + 1] += begin[n];
    std::vector<Entry> of_node(begin.back());
    std::vector<std::size_t> end(begin.begin(), begin.end() - 1);
    for (std::size_t i = 0; i < rows; ++i)
      for (std::size_t e = begin_[i]; e < end_[i]; ++e) {
        Entry entry{std::uint32_t(i), {}};
        bool any = false;
        for (unsigned a = 0; a < D; ++a) {
          entry.value[a] = S(coefficient_[e * D + a]);
          any = any || entry.value[a] != 0;
        }
        if (any) of_node[end[column_[e]]++] = entry;
      }

    constexpr std::size_t pieces = 16;
    struct Piece {
      std::vector<std::size_t> end;
      std::vector<std::uint32_t> column;
      std::vector<S> value;
    };
    std::array<Piece, pieces> piece;
    threads_of(system_).for_each(pieces, [&](std::uint64_t k) {
      Piece& own = piece[k];
      constexpr std::uint32_t never = ~std::uint32_t(0);
      std::vector<S> sum(rows, 0);
      std::vector<std::uint32_t> reached, seen(rows, never);
      for (std::size_t i = rows * k / pieces; i < rows * (k + 1) / pieces; ++i) {
        reached.assign(1, std::uint32_t(i));
        seen[i] = std::uint32_t(i);
        for (std::size_t e = begin_[i]; e < end_[i]; ++e) {
          const std::uint32_t n = column_[e];
          std::array<S, D> mine;
          bool any = false;
          for (unsigned a = 0; a < D; ++a) {
            mine[a] = S(coefficient_[e * D + a]);
            any = any || mine[a] != 0;
          }
          if (!any) continue;
          for (std::size_t o = begin[n]; o < end[n] && of_node[o].row <= i; ++o) {
            const Entry& other = of_node[o];
            S product = 0;
            for (unsigned a = 0; a < D; ++a) product += mine[a] * other.value[a];
            sum[other.row] += product;
            if (seen[other.row] != i) {
              seen[other.row] = std::uint32_t(i);
              reached.push_back(other.row);
            }
          }
        }
        std::sort(reached.begin(), reached.end());
        for (const std::uint32_t j : reached) {
          own.column.push_back(j);
          own.value.push_back(sum[j]);
          sum[j] = 0;
        }
        own.end.push_back(own.column.size());
      }
    });
    SymmetricRows<S> result;
    result.begin.push_back(0);
    for (const Piece& own : piece) {
      const std::size_t before = result.column.size();
      for (const std::size_t e : own.end) result.begin.push_back(before + e);
      result.column.insert(result.column.end(), own.column.begin(), own.column.end());
      result.value.insert(result.value.end(), own.value.begin(), own.value.end());
    }
    return result;
  }

  /// work(row), in parallel
  template <class Work>
  void for_rows(Work work) const {
    threads_of(system_).for_ranges(row_.size(), 256, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t i = first; i < last; ++i) work(std::size_t(i));
    });
  }
  /// out = A in
  template <unsigned D>
  void product(const std::vector<double>& in, std::vector<double>& out) const {
    for_rows([&](std::size_t i) {
      std::array<double, D> sum{};
      for (std::size_t e = begin_[i]; e < end_[i]; ++e)
        for (unsigned a = 0; a < D; ++a) sum[a] += coefficient_[e * D + a] * in[column_[e] * D + a];
      double whole = 0;
      for (unsigned a = 0; a < D; ++a) whole += sum[a];
      out[i] = whole;
    });
  }
  /// out = A^T in, as a few sums one after another whatever the number of threads
  template <unsigned D>
  void transposed_product(const std::vector<double>& in, std::vector<double>& out) {
    const std::size_t rows = row_.size();
    threads_of(system_).for_each(parts, [&](std::uint64_t part) {
      std::vector<double>& sum = part_sums_[part];
      sum.assign(out.size(), 0);
      for (std::size_t i = rows * part / parts; i < rows * (part + 1) / parts; ++i)
        for (std::size_t e = begin_[i]; e < end_[i]; ++e)
          for (unsigned a = 0; a < D; ++a) sum[column_[e] * D + a] += coefficient_[e * D + a] * in[i];
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
  std::vector<std::size_t> entry_of_node_;  // the last that a node had
  std::vector<Row> row_;
  std::vector<std::size_t> begin_, end_;  // of each row, its entries: a node, and d coefficients
  std::vector<std::uint32_t> column_;
  std::vector<double> coefficient_;
  std::vector<double> residual_, length_, squared_magnitude_;  // B v* - c and 1/S, of each row, and what it is the sum of
  std::vector<double> by_root_mass_;                           // of each node
  static constexpr std::size_t parts = 4;
  std::array<std::vector<double>, parts> part_sums_;
  ProjectionMemory* memory_ = nullptr;
};

}  // namespace cleave

#endif
