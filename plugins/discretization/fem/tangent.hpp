/// The stiffness matrix of a body, with inertia, factored.
#ifndef CLEAVE_FEM_TANGENT_HPP
#define CLEAVE_FEM_TANGENT_HPP

#include "mesh.hpp"

#include <cleave/sparse_cholesky.hpp>
#include <cleave/threads.hpp>

namespace cleave::fem {

/// What a vertex may not do during a solve: nothing, leave a plane, or move at all.
struct Constraint {
  enum Kind : std::uint8_t { free, plane, fixed } kind = free;
  Vector normal{};  ///< of the plane, unit length
};

/// Takes from vectors (3 numbers per vertex) what the constraints forbid.
void project(std::span<const Constraint>, std::span<double> values);

class Tangent {
 public:
  explicit Tangent(const Mesh&);

  /// Of sum V B^T C B + diag(inertia) in the directions that the constraints leave; C is 9 x 9 per tetrahedron, positive, and
  /// inertia [kg/s^2] 1 per vertex.
  void factor(const Threads&, const Mesh&, std::span<const double> C, std::span<const double> inertia,
              std::span<const Constraint>);
  /// x becomes the solution, of the directions that are left.
  void solve(const Threads&, std::span<const Constraint>, std::vector<double>& x) const;

 private:
  double* block(std::uint32_t row_vertex, std::size_t place, int row) {
    return &matrix_.value[matrix_.begin[3 * row_vertex + std::size_t(row)] + 3 * place];
  }

  SymmetricRows<double> matrix_;
  std::vector<std::size_t> neighbours_begin_;
  std::vector<std::uint32_t> neighbours_;  ///< of each vertex, those of lower number, ascending
  SparseCholesky<double> cholesky_;
};

}  // namespace cleave::fem

#endif
