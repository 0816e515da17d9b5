#pragma once

#include "mpm/buffer.hpp"
#include "mpm/grid.hpp"
#include "mpm/implicit_boundary.hpp"
#include "mpm/incremental_potential.hpp"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <array>
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
template <class T, int D>
class CoarseSpace {
 public:
  /// After IncrementalPotential::find_tangents.
  void build(const Grid<T, D>&, const IncrementalPotential<T, D>&, const ImplicitBoundary<T, D>&);
  /// There is none where the operator cannot be factorised.
  bool ready() const { return ready_; }
  /// Multiplications that factorising the operator took.
  double multiplications() const { return multiplications_; }

  /// y = A^-1 P^T r; returns r . P y.
  double solve(const T* residual);
  /// z += P y
  void add_to(T* vector) const;

 private:
  static constexpr int corners = 1 << D, half = GridShape<D>::block_edge / 2;
  /// An octant of a grid block and the element it is in.
  struct Octant {
    std::size_t block;
    int number;                                 ///< in the block
    bool stiff;                                 ///< some particle is here
    std::array<std::uint32_t, corners> corner;  ///< of the element, BlockDirectory::none where there is none
    std::array<int, 3> offset;                  ///< of its first node in the element, in cells
  };
  template <class F>
  void for_nodes(const Octant&, F&&) const;
  void number_corners(const Grid<T, D>&, const IncrementalPotential<T, D>&);

  std::vector<Octant> octants_;
  int edge_ = 0;  ///< of an element, in cells
  std::size_t corner_count_ = 0;
  bool ready_ = false;
  double multiplications_ = 0;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor_;
  Eigen::VectorXd right_, solution_;
  std::vector<double> parts_;
};

}  // namespace cleave::mpm
