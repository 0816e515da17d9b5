#pragma once

#include "config/scene.hpp"
#include "mpm/coarse_choice.hpp"
#include "mpm/coarse_space.hpp"
#include "mpm/implicit_boundary.hpp"
#include "mpm/incremental_potential.hpp"
#include "mpm/integrator_choice.hpp"
#include "mpm/law_watch.hpp"

#include <string>
#include <vector>

namespace cleave::mpm {

/// Minimises the incremental potential over the node velocities, subject to the boundary: Newton's method with truncated
/// conjugate gradients and a line search (docs/implicit.md).
template <class T, int D>
class ImplicitStep {
 public:
  using Part = typename IncrementalPotential<T, D>::Part;
  struct Outcome {
    bool solved = false;
    std::string problem;  ///< why not
    SolveWork work;
    std::int64_t newton_iterations = 0, linear_iterations = 0;
    bool failed_law = false;  ///< the report counts
    std::size_t part = 0;
    BlockReport report;
  };

  /// `failed` are those of the watched laws that parts have: it then holds what failed in the last evaluation alone.
  ImplicitStep(const config::ImplicitSolver& solver, double cell_size, double reference_density, FailedBatches& failed)
      : solver_(solver), cell_size_(cell_size), reference_density_(reference_density), failed_(failed) {}

  /// The grid holds masses and velocities without forces of the material, v*, of which the last time step's gravity made
  /// `gravity_change`; it then holds the velocities at the end of the step. Gives up where that would cost more than `most`
  /// (see implicit_cost), and leaves the grid as it was if there is no solution. Particles are only read.
  Outcome solve(Grid<T, D>&, const std::vector<Part>&, ImplicitBoundary<T, D>&, double time_step, const Vector3& gravity_change,
                double most);

  /// Later steps start with nothing of those before.
  void forget() {
    coarse_.forget();
    coarse_choice_ = CoarseChoice(least_price());
  }
  /// What is kept from step to step: preconditioners, of which the same numbers come only up to the tolerance.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.coarse_choice_);
    self.coarse_.list(self.coarse_, archive);
  }
  /// The rest of it, after these.
  void restore() { coarse_.restore(); }

 private:
  /// Of coarse factors: the mesh takes tangents, whatever comes after.
  static double least_price() { return solve_cost({.tangents = 1}); }
  void start(const Vector3& gravity_change);
  typename IncrementalPotential<T, D>::Value evaluate(const T* velocity);
  double find_residual();
  bool minimise();
  void prepare();
  void invert_diagonal();
  double iteration_cost() const;
  bool make_coarse(int products);
  double apply_preconditioner();
  void find_direction(double forcing);
  bool search(double slope);
  void go_on();
  double dot(const T*, const T*) const;
  double norm(const T*) const;
  bool dear() const { return implicit_cost(outcome_.work) > most_; }
  bool give_up();
  void fail_by_law(const char* what);
  T* numbers(const Buffer& b) const { return reinterpret_cast<T*>(b.data()); }

  config::ImplicitSolver solver_;
  double cell_size_, reference_density_;
  FailedBatches& failed_;
  IncrementalPotential<T, D> potential_;
  CoarseSpace<T, D> coarse_;

  // of the solve that goes on
  const Grid<T, D>* grid_ = nullptr;
  ImplicitBoundary<T, D>* boundary_ = nullptr;
  double time_step_ = 0, most_ = 0;
  std::size_t particles_ = 0;
  Outcome outcome_;
  Buffer velocity_, trial_, gradient_, direction_, residual_, preconditioned_, search_, product_;
  Buffer inverse_;  // of the diagonal blocks, diagonal_numbers per node
  typename IncrementalPotential<T, D>::Value value_;
  double residual_norm_ = 0;
  bool prepared_ = false;
  CoarseChoice coarse_choice_{least_price()};
  bool curves_down_ = false;    // along the direction
  bool meshed_ = false;         // coarse space, of this step
  double rounding_ = 0;         // norm of the gradient that rounded strains and velocities make
  double energy_rounding_ = 0;  // what rounded strains can make of the energy
};

}  // namespace cleave::mpm
