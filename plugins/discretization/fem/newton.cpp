#include "newton.hpp"

#include <cmath>
#include <cstdio>

namespace cleave::fem {
namespace {

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
  return sum;
}

std::vector<double> identities(std::size_t count) {
  std::vector<double> F(9 * count);
  for (std::size_t k = 0; k < count; ++k) F[9 * k] = F[9 * k + 4] = F[9 * k + 8] = 1;
  return F;
}

}  // namespace

Newton::Newton(const Threads& threads, const Solid& solid, const Settings& settings)
    : solid_(solid), settings_(settings), tangent_(solid.mesh()) {
  constexpr double rounding = 16 * std::numeric_limits<double>::epsilon();
  const Mesh& mesh = solid.mesh();
  const auto rest = solid.stiffness(threads, identities(mesh.tetrahedra()));
  double volume = 0;
  for (const double v : mesh.volume) volume += v;
  force_rounding_ = rounding * rest.square_frequency * std::sqrt(dot(mesh.mass, mesh.mass));
  energy_rounding_ = rounding * rest.modulus * volume;
}

bool Newton::evaluate(const Problem& problem, State& state) {
  try {
    solid_.evaluate(problem.threads, state.x, state.response);
  } catch (const std::exception& error) {
    refusal_ = error.what();
    return false;
  }
  const auto& [inertia, target, load] = problem.potential;
  const auto& rest = solid_.mesh().rest;
  state.energy = solid_.energy(state.response);
  state.energy_size = std::abs(state.energy);
  state.gradient.resize(state.x.size());
  for (std::size_t k = 0; k < state.x.size(); ++k) {
    const double away = state.x[k] - target[k], push = inertia[k / 3] * away, work = load[k] * (state.x[k] - rest[k]);
    state.gradient[k] = push - load[k] - state.response.force[k];
    state.energy += 0.5 * push * away - work;
    state.energy_size += 0.5 * push * away + std::abs(work);
  }
  project(problem.constraints, state.gradient);
  state.residual = std::sqrt(dot(state.gradient, state.gradient));
  if (std::isfinite(state.residual)) return true;
  refusal_ = "forces are not finite";
  return false;
}

/// The forces that count as none: part of those that cancel, and what rounding of positions makes of stiffness.
double Newton::balance(const Problem& problem, const State& state) const {
  const auto& mesh = solid_.mesh();
  const auto& [inertia, target, load] = problem.potential;
  const auto elastic = solid_.force_magnitudes(state.response);
  double square = 0, farthest = 0;
  for (std::size_t v = 0; v < mesh.vertices(); ++v) {
    for (std::size_t k = 3 * v; k < 3 * v + 3; ++k) farthest = std::max(farthest, std::abs(state.x[k]));
    if (problem.constraints[v].kind == Constraint::fixed) continue;
    const double *x = &state.x[3 * v], *t = &target[3 * v], *f = &load[3 * v];
    const double all =
        elastic[v] + inertia[v] * std::hypot(x[0] - t[0], x[1] - t[1], x[2] - t[2]) + std::hypot(f[0], f[1], f[2]);
    square += all * all;
  }
  return settings_.tolerance * std::sqrt(square) + force_rounding_ * farthest;
}

void Newton::factor(const Problem& problem, const State& state) {
  solid_.positive_tangents(problem.threads, state.response.F, tangents_);
  tangent_.factor(problem.threads, solid_.mesh(), tangents_, problem.potential.inertia, problem.constraints);
}

void Newton::multiply(const Problem& problem, const State& state, const std::vector<double>& u, std::vector<double>& product) {
  solid_.stiffness_product(problem.threads, state.response.F, u, scratch_, product);
  for (std::size_t k = 0; k < u.size(); ++k) product[k] += problem.potential.inertia[k / 3] * u[k];
}

int Newton::direction(const Problem& problem, const State& state, const std::vector<double>& right, double tolerance,
                      std::vector<double>& p) {
  constexpr int most = 100;
  std::vector<double> r = right, z = r, q, product;
  tangent_.solve(problem.threads, problem.constraints, z);
  double rz = dot(r, z);
  const double enough = tolerance * tolerance * rz;
  p.assign(r.size(), 0);
  q = z;
  for (int n = 1; n <= most; ++n) {
    multiply(problem, state, q, product);
    project(problem.constraints, product);
    const double curvature = dot(q, product);
    if (!(curvature > 0)) {
      if (n == 1) p = q;
      return n == 1 ? 0 : n;
    }
    const double length = rz / curvature;
    for (std::size_t k = 0; k < p.size(); ++k) {
      p[k] += length * q[k];
      r[k] -= length * product[k];
    }
    z = r;
    tangent_.solve(problem.threads, problem.constraints, z);
    const double before = rz;
    rz = dot(r, z);
    if (!(rz > enough)) return n;
    for (std::size_t k = 0; k < q.size(); ++k) q[k] = z[k] + rz / before * q[k];
  }
  return most;
}

/// Moves what is held to where it is held, and the rest to where it then balances by the tangent.
bool Newton::predicted(const Problem& problem, const State& from, const std::vector<double>& guess, State& to) {
  std::vector<double> held(guess.size()), left, right, p;
  for (std::size_t k = 0; k < guess.size(); ++k) held[k] = guess[k] - from.x[k];
  left = held;
  project(problem.constraints, left);
  for (std::size_t k = 0; k < guess.size(); ++k) held[k] -= left[k];
  factor(problem, from);
  multiply(problem, from, held, right);
  project(problem.constraints, right);
  for (std::size_t k = 0; k < right.size(); ++k) right[k] = -right[k] - from.gradient[k];
  direction(problem, from, right, 1e-3, p);
  to.x = from.x;
  for (std::size_t k = 0; k < p.size(); ++k) to.x[k] += held[k] + p[k];
  return evaluate(problem, to);
}

bool Newton::search(const Problem& problem, const State& from, const std::vector<double>& p, State& to) {
  const double slope = dot(from.gradient, p);
  const bool has_energy = std::isfinite(from.energy);
  const double rounding = 1e-15 * from.energy_size + energy_rounding_;
  for (double length = 1; length > 1e-12; length *= 0.5) {
    to.x = from.x;
    for (std::size_t k = 0; k < p.size(); ++k) to.x[k] += length * p[k];
    if (!evaluate(problem, to)) continue;
    const bool balances = to.residual <= (1 - 1e-4 * length) * from.residual;
    if (has_energy ? to.energy <= from.energy + 1e-4 * length * slope || (balances && to.energy <= from.energy + rounding)
                   : balances)
      return true;
  }
  return false;
}

void Newton::solve(const Threads& threads, const Potential& potential, std::span<const Constraint> constraints,
                   std::vector<double>& x, const std::vector<double>& guess, bool predict) {
  const Problem problem{threads, potential, constraints};
  state_.x = guess;
  if (const bool guessed = evaluate(problem, state_); predict || !guessed) {
    const std::string refusal = refusal_;
    State here;
    here.x = x;
    const bool better =
        evaluate(problem, here) && predicted(problem, here, guess, trial_) && !(guessed && trial_.energy > state_.energy);
    if (!guessed && !better) throw std::runtime_error(refusal + "; take smaller steps");
    if (better) std::swap(state_, trial_);
  }
  constexpr int many = 6;  // iterations of conjugate gradients after which another factor is worth its cost
  bool fresh = false;
  int iterations = many;
  std::vector<double> right, p;
  for (int n = 0;; ++n) {
    const double enough = balance(problem, state_);
    if (state_.residual <= enough) break;
    char text[200];
    if (n == settings_.maximum_iterations) {
      std::snprintf(text, sizeof text,
                    "forces of %.2g N are out of balance after %d iterations of Newton's method, should be %.2g N",
                    state_.residual, n, enough);
      throw std::runtime_error(std::string(text) + "; take smaller steps or allow more maximum_iterations");
    }
    right = state_.gradient;
    for (double& value : right) value = -value;
    fresh = iterations >= many || iterations == 0;
    if (fresh) factor(problem, state_);
    const double accuracy = std::clamp(state_.residual / enough * settings_.tolerance, 1e-8, 0.03);
    iterations = direction(problem, state_, right, accuracy, p);
    bool found = search(problem, state_, p, trial_);
    if (!found && !fresh) {
      factor(problem, state_);
      iterations = direction(problem, state_, right, accuracy, p);
      found = search(problem, state_, p, trial_);
    }
    if (!found) {  // along the factor's own direction, which goes down whatever the tangent is
      p = right;
      tangent_.solve(threads, constraints, p);
      found = search(problem, state_, p, trial_);
      iterations = 0;
    }
    if (!found) {
      if (state_.residual <= 100 * enough) break;
      std::snprintf(text, sizeof text, "forces of %.2g N stay out of balance, should be %.2g N", state_.residual, enough);
      throw std::runtime_error(std::string(text) + "; take smaller steps");
    }
    std::swap(state_, trial_);
  }
  x = state_.x;
}

}  // namespace cleave::fem
