/// Systems of grid velocities for constraints: a block of particles on a grid, as the material point method hands it over.
#ifndef CLEAVE_TESTKIT_GRID_SYSTEM_HPP
#define CLEAVE_TESTKIT_GRID_SYSTEM_HPP

#include <cleave/constraint.h>
#include <cleave/testkit/plugin.hpp>
#include <cleave/testkit/random.hpp>

#include <array>
#include <string>
#include <vector>

namespace cleave::testkit {

/// The arrays of cleave_constraint_system.
struct GridSystem {
  int dimension = 3;
  double cell_size = 0.01, time_step = 1e-4;
  std::vector<double> mass, velocity, normal;
  std::vector<std::int32_t> node_cell;
  std::vector<std::uint8_t> prescribed;
  std::vector<double> position, volume, deformation, fiber, velocity_gradient;
  std::vector<std::uint64_t> nodes;
  const cleave_threads* threads = nullptr;

  std::size_t node_count() const { return mass.size(); }
  std::size_t particle_count() const { return volume.size(); }
  std::size_t stencil() const { return dimension == 2 ? 9 : 27; }

  /// Velocity gradients of the particles from the node velocities: sum_i v_i (grad N_i)^T.
  void gather_gradients();
  /// Keeps the particles of which `keep` holds, and all nodes.
  void keep_particles(const std::vector<bool>& keep);
  /// Nodes that are in the stencil of one of the particles of which `which` holds.
  std::vector<bool> near(const std::vector<bool>& which) const;

  /// sum_i m_i u_i . v_i
  double product(const std::vector<double>& u, const std::vector<double>& v) const;
};

struct Block {
  int dimension = 3;
  int cells = 3;     ///< along each edge
  int per_edge = 2;  ///< particles of a cell along each edge, at random places of its sub-cells
  /// The fibres: one direction, directions at random, or none (zero vectors).
  enum Fibers { uniform, random, none } fibers = random;
  /// F of the particles: I, a rotation for each, or one small strain after one rotation.
  enum Strain { rest, rotated, strained } strain = rotated;
  /// Nodes that cannot move freely: none; the lowest two layers fixed and one side fixed along oblique normals, all of it
  /// moving with one velocity; or every node.
  enum Held { free, walls, everything } held = free;
};

/// Masses are gathered with quadratic B-splines, base node floor(x - 1/2); velocities are random and of the order of 1 m/s.
/// `carried` gets the velocity of the walls.
GridSystem random_block(Random&, const Block&, std::array<double, 3>* carried = nullptr);

/// The same of particles at given places (in cells, `dimension` each), with random fibres and F = I.
GridSystem particles_at(Random&, int dimension, const std::vector<double>& places);

/// An instance for grids of this dimension.
class ConstraintInstance {
 public:
  ConstraintInstance(const Plugin&, const Settings&, int dimension);  ///< throws Failed with the plugin's words if it refuses
  ~ConstraintInstance();
  ConstraintInstance(const ConstraintInstance&) = delete;
  ConstraintInstance& operator=(const ConstraintInstance&) = delete;

  cleave_instance* handle() const { return handle_; }
  const cleave_constraint& table() const { return *static_cast<const cleave_constraint*>(plugin_.kind_table()); }
  bool reads_fibers() const { return reads_fibers_; }

 private:
  const Plugin& plugin_;
  Material material_;
  bool reads_fibers_;
  cleave_instance* handle_ = nullptr;
};

struct Projection {
  cleave_result result = CLEAVE_OK;
  std::string words;
  cleave_constraint_report report{};
  std::vector<double> velocity;
};

/// Calls project() with copies of the arrays.
Projection project(const ConstraintInstance&, const GridSystem&);

}  // namespace cleave::testkit

#endif
