#pragma once

#include "config/scene.hpp"
#include "mpm/buffer.hpp"
#include "mpm/grid.hpp"
#include "mpm/kernels/kernels.hpp"
#include "mpm/material.hpp"
#include "mpm/particle_blocks.hpp"
#include "mpm/particles.hpp"

#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// Evolves the damage d of the particles of one material (Wolper et al. 2019, eq. 6; Wolper et al. 2020, section 4):
///
///   eta dd/dt = < (1 - d) D - (d - l^2 lap d) >        D, eta, l from the damage law
///
/// Implicit: (M_i (eta/dt + 1) + T_i) d_i + l^2 sum_j K_ij d_j = T_i + eta/dt S_i with M = sum V w, S = sum V w d_p,
/// T = sum V w D on the nodes of the transfers and K of the weak form (natural Neumann boundary), by conjugate gradients for
/// the change d_i - S_i/M_i; then d_p <- clamp(max(d_p, d_p + sum w (d_i - S_i/M_i))). V is the current volume.
/// Explicit: d_p <- min(1, d_p + dt/eta <(1 - d_p) D_p - (d_p - l^2 lap d_p)>), in equal parts of the step where D has grown so
/// much that the whole would be above the stable one.
///
/// Only blocks that damage can reach in this step take part: those with D > 0 or d > 0 and what the kernels reach from there.
/// Everywhere else all terms are exactly zero, so that the result has the same bits as that of the whole body.
template <class T, int D>
class DamageEvolution {
 public:
  /// `inputs` and `law` are the material's damage_inputs() and driving_force(), as they are to be called.
  DamageEvolution(const Material&, const BoundLaw& inputs, const BoundLaw& law, const config::DamageSolver&, double cell_size);

  /// Calls the laws on all particles: driving forces and history from the present strain. Local laws are done with this.
  /// One report per block.
  void drive(const ParticleView&, Particles<T, D>&, double time_step, std::vector<BlockReport>&);
  /// Driving forces belong to slots: keep them over a restored state, not over a sort.
  void evolve(const ParticleView&, Particles<T, D>&, const Grid<T, D>&, double time_step);

  /// Largest step an explicit evolution takes without overshooting, s; infinite otherwise. With lambda the largest eigenvalue
  /// of -dx^2 lap (4 for the weak form, 4 per axis for cubic splines): eta/(1 + D + l^2 lambda/dx^2). A point driven harder
  /// than D = 99 ends between d = 0.99 and 1 whatever the step: D counts up to there, and not at all of points that have passed
  /// it.
  double stable_step() const { return step_bound(largest_driving_force_); }
  double step_bound(double driving_force) const;

  bool local() const { return local_; }
  bool needs_sorted_particles() const { return cubic_; }
  struct Statistics {
    std::int64_t solves = 0, iterations = 0, most_iterations = 0, unconverged = 0;
    double active_blocks = 0;  ///< sum over steps of the fraction of blocks
    std::int64_t steps = 0;

    template <class Self, class Archive>
    static void list(Self& self, Archive& archive) {
      archive(self.solves, self.iterations, self.most_iterations, self.unconverged, self.active_blocks, self.steps);
    }
  };
  /// Since the last call of take_statistics().
  const Statistics& statistics() const { return statistics_; }
  Statistics take_statistics();

  /// What is kept from step to step beside the particles, to be saved and restored.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.largest_driving_force_, self.statistics_);
  }

 private:
  using Flags = std::vector<std::uint8_t>;
  using Blocks = std::vector<typename Particles<T, D>::Block>;

  void integrate(const ParticleView&, Particles<T, D>&, double time_step);
  void solve(const ParticleView&, Particles<T, D>&, double time_step);
  DamageView damage_view(double time_step) const {
    return {inputs_, law_, local_, time_step, driving_force_.data(), volume_.data()};
  }
  /// Blocks up to `distance` blocks away.
  Flags dilated(const Blocks&, const Flags&, int distance) const;
  Flags grid_blocks_of(const Blocks&, const Flags& home) const;
  Flags homes_touching(const Blocks&, const Flags& grid) const;
  template <class F>
  void for_coloured(const Particles<T, D>&, const Flags&, F&&);
  template <class F>
  void for_homes(const Flags&, F&&);
  /// Finds the grid blocks that particles of this material can reach. Those of others alone are never looked at.
  void reach(const Blocks&, std::size_t grid_blocks);
  /// Calls f(first node) for each block, f(node) for each node; sums are in block order.
  template <class F>
  void for_blocks(const Flags& grid, F&&);
  template <class F>
  void for_nodes(const Flags& grid, F&&);
  template <class F>
  double sum_nodes(const Flags& grid, F&&);
  void clear(const Flags& grid, T* field, int numbers = 1);
  T* numbers(Buffer& b) const { return reinterpret_cast<T*>(b.data()); }
  void* scratch() { return scratch_.local().data(); }

  const DamageKernels<T, D>& kernels_;
  config::DamageSolver solver_;
  BoundLaw inputs_, law_;
  double viscosity_, length_;  ///< s, cells
  bool local_, explicit_, cubic_;
  double largest_driving_force_ = 0;
  std::size_t grid_size_ = 0;
  Flags active_;                        ///< home blocks
  std::vector<std::uint32_t> reached_;  ///< grid blocks, ascending
  Buffer driving_force_, volume_;       ///< per slot
  Buffer collected_, initial_, change_, residual_, direction_, product_;
  std::vector<double> partial_;
  std::vector<DamageReport> reports_;
  ThreadScratch scratch_;
  Statistics statistics_;
};

}  // namespace cleave::mpm
