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

/// The slow part of the preconditioner of implicit steps: velocities that are multilinear between the corners of groups of grid
/// blocks, and the operator on them, factorised. Diagonal blocks see one node at a time and pass what is out of balance on by
/// one cell per iteration; this carries it through the body at once (two-level additive Schwarz; Toselli & Widlund 2005,
/// chapter 3).
///
/// The operator has the mass exactly. Its stiffness takes the tangents as they are on average in each octant of a block, made
/// positive semi-definite, at the octant's middle; held nodes resist with their diagonal block.
template <class T, int D>
class CoarseSpace {
 public:
  /// After IncrementalPotential::find_tangents.
  void build(const Grid<T, D>&, const IncrementalPotential<T, D>&, const ImplicitBoundary<T, D>&);
  /// There is none where the operator cannot be factorised.
  bool ready() const { return ready_; }

  /// y = A^-1 P^T r; returns r . P y.
  double solve(const T* residual);
  /// z += P y
  void add_to(T* vector) const;

 private:
  static constexpr int corners = 1 << D;
  struct Block {
    std::size_t first_node;
    std::array<std::uint32_t, 8> corner;  ///< numbers of the corners of its group
    std::array<int, 3> offset;            ///< of its first node in the group, in cells
  };
  /// Weights of the two corners along each axis, for each row of nodes of a block.
  void hats(const Block&, double (&high)[3][8]) const;
  template <class F>
  void for_nodes(const Block&, F&&) const;

  std::vector<Block> blocks_;
  int edge_ = 0;  ///< of a group, in cells
  std::size_t corner_count_ = 0;
  bool ready_ = false;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor_;
  Eigen::VectorXd right_, solution_;
  std::vector<double> parts_;
};

}  // namespace cleave::mpm
