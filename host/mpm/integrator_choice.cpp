#include "mpm/integrator_choice.hpp"

#include <fmt/format.h>

#include <utility>

namespace cleave::mpm {
namespace {

// In symplectic steps, of which docs/performance.md says how they are measured.
constexpr double step_cost = 1;  // transfers
constexpr double evaluation_cost = 1.3;
constexpr double product_cost = 1.1;  // with what else an iteration of conjugate gradients does
constexpr double tangent_cost = 5;
constexpr double multiplication_cost = 0.01;
constexpr double substitution_cost = 0.006;  // with carrying residuals to the corners and back

// Of these the order of magnitude: what they cost hangs on laws and on the shapes of bodies.
constexpr double driving_cost = 0.4;
constexpr double damage_cost = 0.7;
constexpr double damage_iteration_cost = 0.8;
constexpr double projection_cost = 3;  // with writing and factoring rows
constexpr double projection_iteration_cost = 2.5;

constexpr double margin = 1.25;     // by which implicit steps have to be cheaper to be chosen
constexpr double trial_share = 20;  // a trial costs at most this part of the symplectic steps that follow it
constexpr double forgetting = 7. / 8;

/// One Newton iteration with one of conjugate gradients: steps that save less than that are not worth a trial.
const double least_cost = implicit_cost({.evaluations = 2, .products = 1, .tangents = 1});

}  // namespace

double solve_cost(const SolveWork& work) {
  return evaluation_cost * double(work.evaluations) + product_cost * double(work.products) +
         tangent_cost * double(work.tangents) + multiplication_cost * work.factorisation +
         substitution_cost * work.substitution;
}

double implicit_cost(const SolveWork& work) { return step_cost + solve_cost(work); }

double shared_cost(const SharedWork& work) {
  return driving_cost * work.driven + damage_cost * work.damaged + damage_iteration_cost * work.damage_iterations +
         projection_cost * work.projected + projection_iteration_cost * work.projection_iterations;
}

void IntegratorChoice::add(double cost, double time_step) {
  cost_ = forgetting * cost_ + cost;
  seconds_ = forgetting * seconds_ + time_step;
}

void IntegratorChoice::share(const SharedWork& work) {
  shared_ = forgetting * shared_ + shared_cost(work);
  steps_ = forgetting * steps_ + 1;
}

void IntegratorChoice::took_symplectic_step(const SharedWork& shared) {
  since_trial_++;
  share(shared);
}

void IntegratorChoice::took_implicit_step(const SolveWork& work, double time_step, const SharedWork& shared) {
  add(implicit_cost(work), time_step);
  share(shared);
}

std::optional<std::string> IntegratorChoice::choose(const Steps& steps, const Trial& trial) {
  // Symplectic steps in the time of an implicit one, and what they cost less what both share
  const double count = steps.implicit.seconds / steps.symplectic.seconds, shared = shared_per_step(),
               worth = count + (count - 1) * shared;
  const bool was_implicit = implicit_;
  double cost = least_cost;
  const char* bound = "at least ";
  if (implicit_) {
    cost = cost_ / seconds_ * steps.implicit.seconds;
    bound = "";
    implicit_ = cost < worth;
  } else if (least_cost * margin < worth &&
             (since_trial_ >= wait_ || cost_ / seconds_ * steps.implicit.seconds * margin < worth)) {
    if (const auto work = trial(worth)) {
      cost = implicit_cost(*work);
      bound = "";
      implicit_ = cost * margin < worth;
    } else {
      cost = worth;
    }
    cost_ = seconds_ = 0;
    add(cost, steps.implicit.seconds);
  } else if (told_) {
    return std::nullopt;
  }
  if (!implicit_ && seconds_ > 0) {
    since_trial_ = 0;
    wait_ = trial_share * cost / (1 + shared);
  }
  if (std::exchange(told_, true) && implicit_ == was_implicit) return std::nullopt;
  return fmt::format(
      "{} steps: predicted to cost {}{:.3g} symplectic steps per simulated second if implicit (of {:.3g} s, bounded by {}; "
      "{}{:.3g} each), {:.3g} if symplectic (of {:.3g} s, bounded by {}){}",
      implicit_ ? "implicit" : "symplectic", bound, (cost + shared) / steps.implicit.seconds, steps.implicit.seconds,
      steps.implicit.name, bound, cost + shared, (1 + shared) / steps.symplectic.seconds, steps.symplectic.seconds,
      steps.symplectic.name,
      shared > 0 ? fmt::format("; of each step {:.3g} are for damage and constraints", shared) : std::string());
}

}  // namespace cleave::mpm
