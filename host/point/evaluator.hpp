#pragma once

#include "common/types.hpp"
#include "point/laws.hpp"

#include <memory>
#include <span>
#include <vector>

namespace cleave::point {

/// What goes into the laws at one material point.
struct State {
  Matrix3 deformation = Matrix3::Identity();  ///< F of the elastic trial state
  double damage = 0;                          ///< d, as the damage law sees it
  double degrading_damage = 0;                ///< d that degrades the stress
  std::vector<double> variables;              ///< of the plasticity law, then of the damage law
};

/// What comes out of them. Everything but `status` is meaningless unless usable().
struct Response {
  cleave_status status = CLEAVE_STATUS_OK;
  double energy = 0, tensile_energy = 0;      ///< psi and psi_plus [J/m^3] if the elastic law offers energy
  double volume_ratio = 1;                    ///< J of the returned state
  Matrix3 first_piola = Matrix3::Zero();      ///< P = tau F_e^-T [Pa]; NaN where F_e is singular
  Matrix3 kirchhoff = Matrix3::Zero();        ///< tau of the returned state, degraded [Pa]
  bool yielded = false;                       ///< the return mapping moved the point
  Matrix3 deformation = Matrix3::Identity();  ///< F_e, the returned elastic deformation gradient
  std::vector<double> variables;              ///< as in State, at the end
  double driving_force = 0;                   ///< D, of a damage law that is not local
  double damage = 0;                          ///< d, of one that is; of others whoever lets time pass fills it in

  bool usable() const { return status < CLEAVE_STATUS_RETRY; }
};

/// Evaluates the laws at material points: return mapping, then elasticity, then damage on the returned state, in batches and
/// in the precision of `Laws`, through the same entry points as a simulation.
///
/// If all laws accept b they are given b; otherwise those that accept F get F. Where a return mapping gives b_new alone,
/// F_e = b_new^(1/2) R with the orthogonal R of the polar decomposition F = V R of the trial state.
///
/// A point whose det F <= 0 is not shown to an elastic law that is not inversion safe: b would hide the inversion from it.
class Evaluator {
 public:
  virtual ~Evaluator() = default;
  /// `responses` is as long as `states`. Throws SimulationError if a plugin gives up.
  virtual void evaluate(std::span<const State> states, std::span<Response> responses) = 0;
  /// Unit roundoff of the precision the laws work in.
  virtual double epsilon() const = 0;

  static constexpr std::size_t batch_size = 64;
};

/// `laws` must outlive the evaluator.
std::unique_ptr<Evaluator> make_evaluator(const Laws& laws);

/// The state variables a point starts with: of the plasticity law, then of the damage law.
std::vector<double> initial_variables(const Laws&);

}  // namespace cleave::point
