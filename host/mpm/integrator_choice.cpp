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

void IntegratorChoice::add(double cost, double time_step) {
  cost_ = forgetting * cost_ + cost;
  seconds_ = forgetting * seconds_ + time_step;
}

void IntegratorChoice::took_implicit_step(const SolveWork& work, double time_step) { add(implicit_cost(work), time_step); }

std::optional<std::string> IntegratorChoice::choose(const Steps& steps, const Trial& trial) {
  const double worth = steps.implicit.seconds / steps.symplectic.seconds;  // symplectic steps in the time of an implicit one
  const bool was_implicit = implicit_;
  double cost = least_cost;
  const char* bound = "at least ";
  if (implicit_) {
    cost = cost_ / seconds_ * steps.implicit.seconds;
    bound = "";
    implicit_ = cost < worth;
  } else if (least_cost * margin < worth && since_trial_ >= wait_) {
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
  if (!implicit_) {
    since_trial_ = 0;
    wait_ = trial_share * cost;
  }
  if (std::exchange(told_, true) && implicit_ == was_implicit) return std::nullopt;
  return fmt::format(
      "{} steps: predicted to cost {}{:.3g} symplectic steps per simulated second if implicit (of {:.3g} s, bounded by {}; "
      "{}{:.3g} each), {:.3g} if symplectic (of {:.3g} s, bounded by {})",
      implicit_ ? "implicit" : "symplectic", bound, cost / steps.implicit.seconds, steps.implicit.seconds, steps.implicit.name,
      bound, cost, 1 / steps.symplectic.seconds, steps.symplectic.seconds, steps.symplectic.name);
}

}  // namespace cleave::mpm
