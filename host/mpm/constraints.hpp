#pragma once

#include "mpm/colliders.hpp"
#include "mpm/grid.hpp"
#include "mpm/particles.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <utility>
#include <vector>

namespace cleave::mpm {

/// Constraint laws: each changes the grid velocities after forces, handles and colliders so that its constraint holds for the
/// particles of its material. Laws of several materials act one after another, in the order of the scene.
///
/// The nodes that carry mass, of whatever material, are handed over in SI units and double precision.
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
  };
  /// Since the last call.
  Statistics take_statistics() { return std::exchange(statistics_, {}); }

  /// What the arrays handed to a law take.
  static std::size_t bytes_per_particle(const TileLayout&);

 private:
  static constexpr int stencil = D == 3 ? 27 : 9;
  struct Law {
    const plugins::Instance* instance;
    std::size_t set;
  };
  void collect_nodes(const Grid<T, D>&);
  void mark(const std::vector<HeldNode>&);
  void collect_particles(const Particles<T, D>&);
  void call(const plugins::Instance&, double time_step);
  void write_back(Grid<T, D>&) const;

  double cell_size_, reference_density_;
  std::vector<Law> laws_;
  Statistics statistics_;
  std::vector<std::uint32_t> row_of_node_;  // of each node of the grid
  std::vector<std::size_t> node_of_row_;
  std::vector<double> mass_, velocity_, normal_;
  std::vector<std::int32_t> node_cell_;
  std::vector<std::uint8_t> prescribed_;
  bool any_normal_ = false;
  std::vector<double> position_, volume_, deformation_, fiber_, velocity_gradient_;
  std::vector<std::uint64_t> nodes_;
};

}  // namespace cleave::mpm
