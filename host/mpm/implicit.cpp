#include "mpm/implicit.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace cleave::mpm {

namespace {
constexpr int most_rounds = 8;         // of contact
constexpr int most_trials = 30;        // of a line search
constexpr int most_doublings = 6;      // of a step in which the energy curves down
constexpr double sufficient = 1e-4;    // part of the slope that a step has to go down by (Armijo)
constexpr double flat_enough = 0.8;    // part of the slope that is left where energies cannot be told apart
constexpr double loosest = 0.5;        // forcing term: conjugate gradients go down by at least this
constexpr double rounded_strains = 4;  // in units of the precision
}  // namespace

template <class T, int D>
auto ImplicitStep<T, D>::solve(Grid<T, D>& grid, const std::vector<Part>& parts, ImplicitBoundary<T, D>& boundary,
                               double time_step, const Vector3& gravity_change, double most) -> Outcome {
  outcome_ = {};
  grid_ = &grid;
  boundary_ = &boundary;
  time_step_ = time_step;
  most_ = most;
  particles_ = 0;
  for (const Part& part : parts) particles_ += part.particles->size();
  prepared_ = meshed_ = false;
  potential_.begin(grid, parts, time_step, cell_size_, reference_density_);
  for (Buffer* b : {&velocity_, &trial_, &gradient_, &direction_, &residual_, &preconditioned_, &search_, &product_})
    b->reserve(potential_.numbers() * sizeof(T));

  start(gravity_change);
  for (int round = 0; value_.valid; round++) {
    if (!minimise()) break;
    outcome_.solved = true;
    const T* v = numbers(velocity_);
    if (boundary.empty() || round == most_rounds ||
        !boundary.update(v, numbers(gradient_), potential_.target(), residual_norm_))
      break;
    outcome_.solved = false;
    boundary.impose(numbers(velocity_));
    value_ = evaluate(v);
    if (prepared_) invert_diagonal();
  }
  if (!value_.valid) fail_by_law("no velocities to start from at which the laws are defined");
  if (outcome_.solved) {
    boundary.close(numbers(velocity_));
    const T* target = potential_.target();
    const T* v = numbers(velocity_);
    potential_.for_blocks([&](std::size_t first) {
      for (std::size_t n = first; n < first + GridShape<D>::block_nodes; n++)
        if (target[4 * n] > T(0)) std::memcpy(grid.node(n) + 1, v + 4 * n + 1, 3 * sizeof(T));
    });
  }
  return std::move(outcome_);
}

template <class T, int D>
void ImplicitStep<T, D>::fail_by_law(const char* what) {
  outcome_.problem = what;
  outcome_.failed_law = true;
  outcome_.part = potential_.failed_part();
  outcome_.report = potential_.failure();
}

template <class T, int D>
auto ImplicitStep<T, D>::evaluate(const T* velocity) -> typename IncrementalPotential<T, D>::Value {
  outcome_.work.evaluations++;
  failed_.clear();
  auto value = potential_.evaluate(velocity, numbers(gradient_));
  value.energy += boundary_->friction_energy(velocity);
  boundary_->add_friction(numbers(gradient_));
  return value;
}

/// From v*, or from the velocities before gravity, whichever has the lower energy: what lies still stays where it is, what
/// falls goes on to fall.
template <class T, int D>
void ImplicitStep<T, D>::start(const Vector3& gravity_change) {
  T* v = numbers(velocity_);
  const T* target = potential_.target();
  std::memcpy(v, target, potential_.numbers() * sizeof(T));
  boundary_->impose(v);
  value_ = evaluate(v);
  // A free body has the momentum of v*, which no direction changes.
  if (boundary_->empty() || gravity_change.isZero()) return;
  T* other = numbers(trial_);
  potential_.for_blocks([&](std::size_t first) {
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4)
      for (int a = 0; a < 3; a++)
        other[i + 1 + std::size_t(a)] = target[i + 1 + std::size_t(a)] - (a < D ? T(gravity_change[a]) : T(0));
  });
  boundary_->impose(other);
  const auto value = evaluate(other);
  const bool better = value.valid && (!value_.valid || (potential_.has_energy()
                                                            ? value.energy < value_.energy
                                                            : value.inertia + value.stress < value_.inertia + value_.stress));
  if (better) {
    std::swap(velocity_, trial_);
    value_ = value;
  } else {
    value_ = evaluate(numbers(velocity_));  // its gradient again
  }
}

template <class T, int D>
double ImplicitStep<T, D>::dot(const T* a, const T* b) const {
  return potential_.template sum_blocks<double>([&](std::size_t first) {
    double sum = 0;
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4)
      for (std::size_t c = 1; c <= D; c++) sum += double(a[i + c]) * double(b[i + c]);
    return sum;
  });
}

/// |r| in the norm of 1/m.
template <class T, int D>
double ImplicitStep<T, D>::norm(const T* r) const {
  const T* target = potential_.target();
  return std::sqrt(potential_.template sum_blocks<double>([&](std::size_t first) {
    double sum = 0;
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4) {
      if (!(target[i] > T(0))) continue;
      double square = 0;
      for (std::size_t c = 1; c <= D; c++) square += double(r[i + c]) * double(r[i + c]);
      sum += square / double(target[i]);
    }
    return sum;
  }));
}

/// residual = -gradient where velocities are free; its norm.
template <class T, int D>
double ImplicitStep<T, D>::find_residual() {
  const T* g = numbers(gradient_);
  T* r = numbers(residual_);
  potential_.for_blocks([&](std::size_t first) {
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i++) r[i] = -g[i];
  });
  boundary_->project(r);
  return norm(r);
}

template <class T, int D>
bool ImplicitStep<T, D>::minimise() {
  const double precision = double(std::numeric_limits<T>::epsilon());
  double before = 0;
  for (int iteration = 0;; iteration++) {
    residual_norm_ = find_residual();
    // Impulses that balance, and what rounding makes of velocities.
    const double relative = solver_.tolerance * (value_.inertia + value_.stress);
    if (residual_norm_ <= relative || residual_norm_ == 0) return true;
    if (!prepared_) prepare();
    const double enough = std::max(relative, rounding_);
    if (residual_norm_ <= enough) return true;
    if (iteration == solver_.maximum_iterations) {
      outcome_.problem = fmt::format("{} Newton iterations leave {:.1e} of the impulses out of balance, not {:.1e}", iteration,
                                     residual_norm_ / (value_.inertia + value_.stress), solver_.tolerance);
      return false;
    }
    // Eisenstat & Walker 1996, choice 2, and no better than what ends the iteration.
    double forcing = iteration == 0 ? loosest : 0.9 * std::pow(residual_norm_ / before, 2);
    forcing = std::clamp(forcing, std::max(0.5 * enough / residual_norm_, precision), loosest);
    before = residual_norm_;
    if (dear()) return give_up();
    find_direction(forcing);
    if (dear()) return give_up();
    outcome_.newton_iterations++;
    const double slope = dot(numbers(gradient_), numbers(direction_));
    if (!search(slope)) {
      // As good as this precision allows.
      if (residual_norm_ <= 30 * std::max(rounding_, relative)) {
        value_ = evaluate(numbers(velocity_));
        return true;
      }
      return false;
    }
  }
}

template <class T, int D>
bool ImplicitStep<T, D>::give_up() {
  outcome_.problem = "costs more than it is worth";
  return false;
}

/// Tangents of the present velocities, for this step.
template <class T, int D>
void ImplicitStep<T, D>::prepare() {
  outcome_.work.tangents++;
  potential_.find_tangents(false);
  prepared_ = true;
  const T* target = potential_.target();
  const T* diagonal = potential_.diagonal();
  struct Sums {
    double stiffness = 0, squares = 0, motion = 0;
    void operator+=(const Sums& o) {
      stiffness += o.stiffness;
      squares += o.squares;
      motion += o.motion;
    }
  };
  const T* v = numbers(velocity_);
  const Sums sums = potential_.template sum_blocks<Sums>([&](std::size_t first) {
    Sums s;
    for (std::size_t n = first; n < first + GridShape<D>::block_nodes; n++) {
      const double mass = double(target[4 * n]);
      if (!(mass > 0)) continue;
      double trace = 0, square = 0;
      for (int a = 0, at = 0; a < D; at += D - a, a++) {
        trace += std::abs(double(diagonal[n * diagonal_numbers + std::size_t(at)]));
        square += double(v[4 * n + 1 + std::size_t(a)]) * double(v[4 * n + 1 + std::size_t(a)]);
      }
      s.stiffness += trace;
      s.squares += trace * trace / mass;
      s.motion += mass * square;
    }
    return s;
  });
  // A velocity of dx/dt strains a cell by 1.
  const double unit = cell_size_ / time_step_, precision = double(std::numeric_limits<T>::epsilon());
  energy_rounding_ = precision * sums.stiffness * unit * unit;
  rounding_ = precision * (rounded_strains * unit * std::sqrt(sums.squares) + std::sqrt(sums.motion));
  invert_diagonal();
  if (coarse_.ready()) coarse_.find_nodes(*grid_, potential_);
}

/// On what is free.
template <class T, int D>
void ImplicitStep<T, D>::invert_diagonal() {
  using Block = Eigen::Matrix<double, D, D>;
  inverse_.reserve(potential_.numbers() / 4 * diagonal_numbers * sizeof(T));
  T* inverse = numbers(inverse_);
  const T* target = potential_.target();
  const T* diagonal = potential_.diagonal();
  potential_.for_blocks([&](std::size_t first) {
    for (std::size_t n = first; n < first + GridShape<D>::block_nodes; n++) {
      T* to = inverse + n * diagonal_numbers;
      std::fill_n(to, diagonal_numbers, T(0));
      const double mass = double(target[4 * n]);
      if (!(mass > 0)) continue;
      Block block;
      const T* from = diagonal + n * diagonal_numbers;
      for (int r = 0, at = 0; r < D; r++)
        for (int c = r; c < D; c++, at++) block(r, c) = block(c, r) = double(from[at]);
      const double trace = block.diagonal().cwiseAbs().sum();
      block.diagonal().array() += mass;
      Block result = Block::Identity();
      const Eigen::LLT<Block> factor(block);
      if (factor.info() == Eigen::Success && block.determinant() > 0)
        factor.solveInPlace(result);
      else
        result /= mass + trace;
      for (int r = 0, at = 0; r < D; r++)
        for (int c = r; c < D; c++, at++) to[at] = T(result(r, c));
    }
  });
  boundary_->for_projectors([&](std::size_t n, const Matrix3& free) {
    T* to = inverse + n * diagonal_numbers;
    Block block;
    for (int r = 0, at = 0; r < D; r++)
      for (int c = r; c < D; c++, at++) block(r, c) = block(c, r) = double(to[at]);
    const Block f = free.template topLeftCorner<D, D>();
    block = (f * block * f).eval();
    for (int r = 0, at = 0; r < D; r++)
      for (int c = r; c < D; c++, at++) to[at] = T(block(r, c));
  });
}

/// What a product costs, with what else an iteration of conjugate gradients does.
template <class T, int D>
double ImplicitStep<T, D>::iteration_cost() const {
  return solve_cost({.products = 1, .substitution = coarse_.ready() ? coarse_.solve_work() / double(particles_) : 0});
}

/// Makes the coarse space from the tangents of the present velocities, if it is due after so many products. Returns true if the
/// preconditioner has changed.
template <class T, int D>
bool ImplicitStep<T, D>::make_coarse(int products) {
  const double cost = iteration_cost();
  if (!coarse_choice_.due(products, cost)) return false;
  if (!meshed_) {
    meshed_ = true;
    outcome_.work.tangents++;
    potential_.find_tangents(true);
    invert_diagonal();
    coarse_.make_mesh(*grid_, potential_);
    coarse_choice_.set_price(solve_cost({.tangents = 1, .factorisation = coarse_.factor_work() / double(particles_)}));
    if (!coarse_choice_.due(products, cost)) return true;
  }
  outcome_.work.factorisation += coarse_.factor_work() / double(particles_);
  coarse_.factorise(potential_, *boundary_);
  coarse_choice_.made(products);
  meshed_ = false;
  return true;
}

/// z = B r; returns r . z. Where nothing is held, the momentum of r is zero and so is that of M z: conjugate gradients keep
/// momentum to rounding, however early they end.
template <class T, int D>
double ImplicitStep<T, D>::apply_preconditioner() {
  const T *r = numbers(residual_), *inverse = numbers(inverse_), *target = potential_.target();
  T* z = numbers(preconditioned_);
  double rz = potential_.template sum_blocks<double>([&](std::size_t first) {
    double sum = 0;
    for (std::size_t n = first; n < first + GridShape<D>::block_nodes; n++) {
      const T *in = r + 4 * n + 1, *d = inverse + n * diagonal_numbers;
      T* out = z + 4 * n + 1;
      out[-1] = out[2] = 0;
      if constexpr (D == 3) {
        out[0] = d[0] * in[0] + d[1] * in[1] + d[2] * in[2];
        out[1] = d[1] * in[0] + d[3] * in[1] + d[4] * in[2];
        out[2] = d[2] * in[0] + d[4] * in[1] + d[5] * in[2];
      } else {
        out[0] = d[0] * in[0] + d[1] * in[1];
        out[1] = d[1] * in[0] + d[2] * in[1];
      }
      for (std::size_t a = 0; a < D; a++) sum += double(in[a]) * double(out[a]);
    }
    return sum;
  });
  if (coarse_.ready()) {
    outcome_.work.substitution += coarse_.solve_work() / double(particles_);
    rz += coarse_.solve(r);
    coarse_.add_to(z);
    boundary_->project(z);
  }
  if (!boundary_->empty()) return rz;
  struct Momentum {
    double p[3] = {};
    void operator+=(const Momentum& o) {
      for (int a = 0; a < 3; a++) p[a] += o.p[a];
    }
  };
  const Momentum sum = potential_.template sum_blocks<Momentum>([&](std::size_t first) {
    Momentum s;
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4)
      for (std::size_t a = 0; a < D; a++) s.p[a] += double(target[i]) * double(z[i + 1 + a]);
    return s;
  });
  T mean[3];
  for (int a = 0; a < 3; a++) mean[a] = T(sum.p[a] / potential_.mass());
  potential_.for_blocks([&](std::size_t first) {
    for (std::size_t i = 4 * first, end = i + 4 * GridShape<D>::block_nodes; i < end; i += 4)
      for (std::size_t a = 0; a < D; a++)
        if (target[i] > T(0)) z[i + 1 + a] -= mean[a];
  });
  return rz;
}

/// Conjugate gradients from 0 on H d = r, until r is `forcing` of what it was in the norm of the preconditioner, or until the
/// curvature along the search direction is not positive (Nocedal & Wright 2006, algorithm 7.1): d then is what there is and as
/// much again along that direction, or the first search direction. Either way it goes down.
template <class T, int D>
void ImplicitStep<T, D>::find_direction(double forcing) {
  T *d = numbers(direction_), *p = numbers(search_), *Ap = numbers(product_), *r = numbers(residual_);
  const T* z = numbers(preconditioned_);
  potential_.for_blocks([&](std::size_t first) { std::memset(d + 4 * first, 0, 4 * GridShape<D>::block_nodes * sizeof(T)); });
  curves_down_ = false;
  double rz = apply_preconditioner(), enough = forcing * forcing * rz;
  T beta = 0;
  int products = 0, since = 0;  // the preconditioner changed
  while (products < solver_.maximum_linear_iterations && rz > enough) {
    if (make_coarse(products - since)) {  // conjugate gradients anew, from where they are to the same part of the residual
      if (coarse_.ready()) since = products;
      const double before = rz;
      rz = apply_preconditioner();
      enough *= rz / before;
      beta = 0;
    }
    potential_.for_blocks([&](std::size_t first) {
      for (std::size_t k = 4 * first, end = k + 4 * GridShape<D>::block_nodes; k < end; k++)
        p[k] = beta == T(0) ? z[k] : z[k] + beta * p[k];
    });
    potential_.multiply(p, Ap);
    boundary_->project(Ap);
    products++;
    outcome_.work.products++;
    outcome_.linear_iterations++;
    const double pAp = dot(p, Ap);
    if (!(pAp > 0)) {
      curves_down_ = true;
      const double size = dot(d, d), size_of_p = dot(p, p);
      const T length = size > 0 ? T(std::min(std::sqrt(size / size_of_p), rz / -pAp)) : T(1);
      potential_.for_blocks([&](std::size_t first) {
        for (std::size_t k = 4 * first, end = k + 4 * GridShape<D>::block_nodes; k < end; k++) d[k] += length * p[k];
      });
      break;
    }
    const T alpha = T(rz / pAp);
    potential_.for_blocks([&](std::size_t first) {
      for (std::size_t k = 4 * first, end = k + 4 * GridShape<D>::block_nodes; k < end; k++) {
        d[k] += alpha * p[k];
        r[k] -= alpha * Ap[k];
      }
    });
    if (dear()) break;
    const double next = apply_preconditioner();
    if (!(next > 0)) break;
    beta = T(next / rz);
    rz = next;
  }
  if (!coarse_choice_.took(products - since, coarse_.ready(), iteration_cost(), solve_cost({.products = 1}))) coarse_.forget();
}

/// On along a direction in which the energy curves down: twice as far, and again, as long as that is lower. Steps of the size
/// of the gradient alone would take long to leave a saddle.
template <class T, int D>
void ImplicitStep<T, D>::go_on() {
  const T* d = numbers(direction_);
  T length = 1;
  for (int i = 0; i < most_doublings; i++, length *= 2) {
    const T* v = numbers(velocity_);
    T* trial = numbers(trial_);
    potential_.for_blocks([&](std::size_t first) {
      for (std::size_t k = 4 * first, end = k + 4 * GridShape<D>::block_nodes; k < end; k++) trial[k] = v[k] + length * d[k];
    });
    const auto value = evaluate(trial);
    if (!value.valid || value.energy > value_.energy - energy_rounding_) {
      value_ = evaluate(v);  // its gradient again
      return;
    }
    std::swap(velocity_, trial_);
    value_ = value;
  }
}

/// Along the direction: the energy goes down enough (Armijo) or, where its change drowns in rounding, its slope has flattened
/// (Hager & Zhang 2005, approximate Wolfe conditions). Without energies the residual goes down. Velocities at which a law is
/// not defined are too far.
template <class T, int D>
bool ImplicitStep<T, D>::search(double slope) {
  const T *v = numbers(velocity_), *d = numbers(direction_);
  T* trial = numbers(trial_);
  const double precision = double(std::numeric_limits<T>::epsilon());
  bool invalid = false;
  double length = 1;
  for (int i = 0; i < most_trials; i++) {
    const T factor = T(length);
    potential_.for_blocks([&](std::size_t first) {
      for (std::size_t k = 4 * first, end = k + 4 * GridShape<D>::block_nodes; k < end; k++) trial[k] = v[k] + factor * d[k];
    });
    const auto value = evaluate(trial);
    invalid = !value.valid;
    if (invalid) {
      length *= 0.5;
      continue;
    }
    bool accepted;
    double next = 0.5;
    if (potential_.has_energy()) {
      const double there = dot(numbers(gradient_), d), change = value.energy - value_.energy;
      const double noise = energy_rounding_ + precision * (std::abs(value.energy) + std::abs(value_.energy));
      accepted = change <= sufficient * length * slope || (change <= noise && there <= -flat_enough * slope);
      if (there > slope) next = std::clamp(slope / (slope - there), 0.1, 0.5);
    } else {
      T* r = numbers(preconditioned_);
      std::memcpy(r, numbers(gradient_), potential_.numbers() * sizeof(T));
      boundary_->project(r);
      accepted = norm(r) <= (1 - sufficient * length) * residual_norm_;
    }
    if (accepted) {
      std::swap(velocity_, trial_);
      value_ = value;
      if (curves_down_ && i == 0 && potential_.has_energy()) go_on();
      return true;
    }
    length *= next;
  }
  if (invalid)
    fail_by_law("the laws are not defined wherever the solution is sought");
  else
    outcome_.problem = "the line search finds no lower energy";
  return false;
}

template class ImplicitStep<float, 2>;
template class ImplicitStep<float, 3>;
template class ImplicitStep<double, 2>;
template class ImplicitStep<double, 3>;

}  // namespace cleave::mpm
