#pragma once

#include "mpm/buffer.hpp"
#include "mpm/grid.hpp"
#include "mpm/implicit_boundary.hpp"
#include "mpm/incremental_potential.hpp"

#include <cleave/sparse_cholesky.hpp>
#include <cstdint>
#include <vector>

namespace cleave::mpm {

/// The slow part of the preconditioner of implicit steps: velocities that are multilinear between the corners of a coarse mesh,
/// and the operator on them, factorised. Diagonal blocks see one node at a time and pass what is out of balance on by one cell
/// per iteration; this carries it through the body at once (two-level additive Schwarz; Toselli & Widlund 2005, chapter 3).
///
/// The mesh is made of octants of grid blocks (2 cells to an edge, in two dimensions 4), or of groups of them where these would
/// be many. The operator has the mass exactly. Its stiffness takes the tangents as they are on average in each octant, made
/// positive semi-definite; held nodes resist with their diagonal block.
///
/// Mesh and factors stay until they are made anew: whatever the step they are of, they make a preconditioner of later ones.
template <class T, int D>
class CoarseSpace {
 public:
  bool ready() const { return ready_; }
  void forget() { ready_ = false; }

  /// The mesh of a step, after IncrementalPotential::find_tangents(octants). What is ready is lost.
  void make_mesh(const Grid<T, D>&, const IncrementalPotential<T, D>&);
  /// The operator on it.
  void factorise(const IncrementalPotential<T, D>&, const ImplicitBoundary<T, D>&);
  std::size_t corner_count() const { return corners_.size(); }
  /// Multiplications of `factorise`, and those of `solve`.
  double factor_work() const { return factor_.work(); }
  double solve_work() const { return 2 * double(factor_.entries()); }

  /// Finds the nodes of another step in the mesh.
  void find_nodes(const Grid<T, D>&, const IncrementalPotential<T, D>&);
  /// y = A^-1 P^T r; returns r . P y.
  double solve(const T* residual);
  /// z += P y
  void add_to(T* vector) const;

  /// What is kept from step to step.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.ready_, self.edge_, self.corners_, self.matrix_.begin, self.matrix_.column, self.matrix_.value, self.scale_);
  }
  /// The rest of it, after these.
  void restore();

 private:
  static constexpr int corners_of_element = 1 << D, half = GridShape<D>::block_edge / 2;
  /// An octant of a grid block and the element it is in.
  struct Octant {
    std::size_t block;
    int number;                                            ///< in the block
    std::array<std::uint32_t, corners_of_element> corner;  ///< of the element, BlockDirectory::none where there is none
    std::array<int, 3> offset;                             ///< of its first node in the element, in cells
    BlockCoordinate element;
  };
  template <class F>
  void for_nodes(const Octant&, F&&) const;
  template <class F>
  void for_octants(F&&) const;
  void find_octants(const IncrementalPotential<T, D>&);
  void place(const Grid<T, D>&, Octant&) const;
  void make_pattern();
  void analyze();

  std::vector<Octant> octants_;
  int edge_ = 0;  ///< of an element, in cells
  std::vector<BlockCoordinate> corners_;
  BlockDirectory directory_;  ///< of the corners
  bool ready_ = false;
  SymmetricRows<double> matrix_;  ///< scaled to a diagonal of 1
  std::vector<double> scale_;
  SparseCholesky<double> factor_;
  std::vector<double> right_, solution_, parts_;
};

}  // namespace cleave::mpm
