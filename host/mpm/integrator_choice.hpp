#pragma once

#include "mpm/time_step.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace cleave::mpm {

/// How often the solve of an implicit step went over all particles, and what does not grow with them.
struct SolveWork {
  std::int64_t evaluations = 0;  ///< of the incremental potential and its gradient
  std::int64_t products = 0;     ///< with its Hessian
  std::int64_t tangents = 0;     ///< for preconditioners
  double factorisation = 0;      ///< of coarse operators: multiplications, per particle
  double substitution = 0;       ///< solutions with these: the same

  void operator+=(const SolveWork& o) {
    evaluations += o.evaluations;
    products += o.products;
    tangents += o.tangents;
    factorisation += o.factorisation;
    substitution += o.substitution;
  }
};

/// What an implicit step costs, in symplectic steps of the same scene; and its solve alone.
double implicit_cost(const SolveWork&);
double solve_cost(const SolveWork&);

/// What a step of either integrator pays for beside the transfers and the solve, in parts of all particles.
struct SharedWork {
  double driven = 0;             ///< of which driving forces of damage are evaluated, once for each pass
  double damaged = 0;            ///< that damage can reach, once for each pass
  double damage_iterations = 0;  ///< of solves for damage, times the part of the particles they go over
  double projected = 0;          ///< that are constrained, once for each projection
  double projection_iterations = 0;

  void operator+=(const SharedWork& o) {
    driven += o.driven;
    damaged += o.damaged;
    damage_iterations += o.damage_iterations;
    projected += o.projected;
    projection_iterations += o.projection_iterations;
  }
};
double shared_cost(const SharedWork&);

/// The choice of integrator = "auto": the integrator that is predicted to cost less per simulated second. The unit is a
/// symplectic step without damage and constraints; these are paid by steps of either kind, so that fewer of them save it. It
/// hangs on counts alone, never on a clock, so that a scene takes the same steps wherever it runs.
///
/// What an implicit step costs is known once one has been solved for. Those that are taken tell; while steps are symplectic, a
/// trial tells from time to time, which leaves no trace. Trials cost at most a twentieth of the steps between them.
/// Implicit steps have to be a quarter cheaper to be chosen, and are kept until they are dearer.
class IntegratorChoice {
 public:
  /// The largest step that each integrator can take from the present state.
  struct Steps {
    Bound symplectic, implicit;
  };
  /// Solves for an implicit step from the present state, and gives up, with no result, where it would cost more than `most`.
  using Trial = std::function<std::optional<SolveWork>(double most)>;

  /// Chooses for the next step. Says what and why the first time and whenever that changes.
  std::optional<std::string> choose(const Steps&, const Trial&);
  bool implicit() const { return implicit_; }

  void took_symplectic_step(const SharedWork& = {});
  void took_implicit_step(const SolveWork&, double time_step, const SharedWork& = {});

  /// To be saved and restored.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.implicit_, self.told_, self.since_trial_, self.wait_, self.cost_, self.seconds_, self.shared_, self.steps_);
  }

 private:
  void add(double cost, double time_step);
  void share(const SharedWork&);
  double shared_per_step() const { return steps_ > 0 ? shared_ / steps_ : 0; }

  bool implicit_ = false, told_ = false;
  double since_trial_ = 0, wait_ = 0;  ///< symplectic steps
  double cost_ = 0, seconds_ = 0;      ///< of implicit steps, sums that forget
  double shared_ = 0, steps_ = 0;      ///< the same of shared costs, of all steps
};

}  // namespace cleave::mpm
