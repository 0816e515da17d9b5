#pragma once

#include "checkpoint/state.hpp"
#include "mpm/colliders.hpp"
#include "mpm/grid.hpp"
#include "mpm/particles.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <utility>
#include <vector>

namespace cleave::mpm {

/// Constraint laws: each changes the grid velocities after forces, handles and colliders so that its constraint holds for the
/// particles of its material. Laws of several materials act one after another, in the order of the scene, and where they share
/// nodes again and again, until hardly anything changes.
///
/// A law gets the nodes that its particles reach, in SI units and double precision. Others cost nothing.
template <class T, int D>
class Constraints {
 public:
  Constraints(double cell_size, double reference_density) : cell_size_(cell_size), reference_density_(reference_density) {}

  /// `set`: which of the particles handed to project() the law is of. They have to store F, and fibers if the law reads them.
  void add(const plugins::Instance& law, std::size_t set) { laws_.push_back({&law, set}); }

  /// Projects the velocities of the grid. Throws SimulationError naming the plugin.
  void project(Grid<T, D>&, const std::vector<const Particles<T, D>*>&, const std::vector<HeldNode>&, double time_step);

  struct Statistics {
    std::int64_t projections = 0, iterations = 0;
    double largest_residual = 0;
    std::int64_t particles = 0, particle_iterations = 0;  ///< of all projections; times the iterations of each

    template <class Self, class Archive>
    static void list(Self& self, Archive& archive) {
      archive(self.projections, self.iterations, self.largest_residual, self.particles, self.particle_iterations);
    }
  };
  /// Since the last call.
  const Statistics& statistics() const { return statistics_; }
  Statistics take_statistics() { return std::exchange(statistics_, {}); }

  /// What laws keep from step to step, where they can save it. Throws InputError if a law refuses what is restored.
  void save(checkpoint::StateWriter&, const std::string& prefix) const;
  void restore(checkpoint::StateReader&, const std::string& prefix);
  /// A line for each law that cannot.
  std::vector<std::string> not_saved() const;

  /// What the arrays handed to a law take.
  static std::size_t bytes_per_particle(const TileLayout&);

 private:
  static constexpr int stencil = D == 3 ? 27 : 9;
  struct Law {
    const plugins::Instance* instance;
    std::size_t set;
    bool spoke = false;  // what it had to tell has been said
  };
  void collect_particles(const Grid<T, D>&, const Particles<T, D>&);
  void collect_nodes(const Grid<T, D>&);
  void mark(const std::vector<HeldNode>&);
  void call(Law&, double time_step);
  /// The squared change of velocity, weighed by mass.
  double write_back(Grid<T, D>&) const;
  bool share_nodes(const Grid<T, D>&, const std::vector<const Particles<T, D>*>&) const;

  double cell_size_, reference_density_;
  std::vector<Law> laws_;
  Statistics statistics_;
  std::vector<std::uint8_t> reached_;  // of each node of the grid: whether a particle reaches it; in these blocks only
  std::vector<std::uint32_t> reached_blocks_;
  std::vector<std::uint32_t> row_of_node_;
  std::vector<std::size_t> node_of_row_;
  std::vector<double> mass_, velocity_, normal_;
  std::vector<std::int32_t> node_cell_;
  std::vector<std::uint8_t> prescribed_;
  bool any_normal_ = false;
  std::vector<double> position_, volume_, deformation_, fiber_, velocity_gradient_, damage_;
  std::vector<std::uint64_t> nodes_;
};

}  // namespace cleave::mpm
