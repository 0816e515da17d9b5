/// Where a body comes to rest, or to the end of an implicit step: Newton's method on an incremental potential.
#ifndef CLEAVE_FEM_NEWTON_HPP
#define CLEAVE_FEM_NEWTON_HPP

#include "solid.hpp"
#include "tangent.hpp"

namespace cleave::fem {

/// sum V psi(F(x)) + sum_v (inertia/2 |x - target|^2 - load . (x - rest))
struct Potential {
  std::vector<double> inertia;  ///< kg/s^2, 1 per vertex
  std::vector<double> target;   ///< m, 3 per vertex
  std::vector<double> load;     ///< N, 3 per vertex
};

/// Newton directions come from conjugate gradients on the exact tangent, preconditioned by a factor of the one whose elements
/// are made positive; where they meet negative curvature, from the factor alone. Steps are halved until the potential
/// falls, or the forces out of balance where the law offers no energy.
class Newton {
 public:
  struct Settings {
    double tolerance;  ///< of the forces that meet at the vertices, what may be left of them
    int maximum_iterations;
  };

  Newton(const Threads&, const Solid&, const Settings&);

  /// From x, where the law is defined, to a minimum in the directions that the constraints leave. `guess` is where to begin,
  /// and where constraints hold vertices; `predict`: rather begin where the tangent at x leads from there. Throws if there
  /// is none to be found.
  void solve(const Threads&, const Potential&, std::span<const Constraint>, std::vector<double>& x,
             const std::vector<double>& guess, bool predict);

 private:
  struct State {
    std::vector<double> x, gradient;
    Response response;
    double energy = 0, energy_size = 0, residual = 0;
  };
  struct Problem {
    const Threads& threads;
    const Potential& potential;
    std::span<const Constraint> constraints;
  };

  /// False, and a reason in refusal_, where the law is not defined at state.x.
  bool evaluate(const Problem&, State&);
  double balance(const Problem&, const State&) const;
  void factor(const Problem&, const State&);
  /// p with tangent p = right-hand side, nearly, in the directions left; iterations, or 0 if it is of the factor alone.
  int direction(const Problem&, const State&, const std::vector<double>& right, double tolerance, std::vector<double>& p);
  void multiply(const Problem&, const State&, const std::vector<double>& u, std::vector<double>& product);
  bool predicted(const Problem&, const State& from, const std::vector<double>& guess, State& to);
  bool search(const Problem&, const State& from, const std::vector<double>& p, State& to);

  const Solid& solid_;
  Settings settings_;
  // What rounding leaves of forces [N] per m of the largest coordinate, and of the energy [J].
  double force_rounding_, energy_rounding_;
  Tangent tangent_;
  State state_, trial_;
  Response scratch_;
  std::vector<double> tangents_;
  std::string refusal_;
};

}  // namespace cleave::fem

#endif
