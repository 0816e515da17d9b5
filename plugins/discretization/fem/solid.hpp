/// One body of linear tetrahedra: forces and energy of its vertices from the elastic law of its material.
#ifndef CLEAVE_FEM_SOLID_HPP
#define CLEAVE_FEM_SOLID_HPP

#include "mesh.hpp"

#include <cleave/discretization.hpp>

namespace cleave::fem {

/// What the law says of vertices at one place.
struct Response {
  std::vector<double> F;              ///< 9 per tetrahedron
  std::vector<double> energy;         ///< J/m^3, NaN where the law offers none
  std::vector<double> element_force;  ///< N, on corners 1, 2 and 3 of each tetrahedron; corner 0 has the opposite of their sum
  std::vector<double> force;          ///< N, 3 per vertex
};

class Solid {
 public:
  Solid(const cleave_body&, const ElasticResponse&);

  const Mesh& mesh() const { return mesh_; }

  /// At vertices x (3 numbers each). Throws where the law is not defined there.
  void evaluate(const Threads&, std::span<const double> x, Response&) const;
  /// K u, the change with a displacement u of the vertices of the forces that resist it; `scratch` is what evaluate() fills.
  void stiffness_product(const Threads&, std::span<const double> F, std::span<const double> u, Response& scratch,
                         std::vector<double>& product) const;
  /// dP/dF of each tetrahedron, 9 x 9, made symmetric and its negative eigenvalues 0.
  void positive_tangents(const Threads&, std::span<const double> F, std::vector<double>& tangents) const;

  double energy(const Response&) const;  ///< J
  /// Magnitudes of the forces that meet at a vertex, added, N: what of them has to cancel at rest.
  std::vector<double> force_magnitudes(const Response&) const;

  /// A bound of the square of the highest frequency of small vibrations [1/s^2]. With the modulus M of waves, and lumped masses
  /// rho V/4, an element has
  ///   u . K u <= V M (sum_a |u_a| |grad N_a|)^2 <= V M |u|^2 sum_a |grad N_a|^2,
  /// and nothing vibrates faster than the fastest element on its own.                              [Irons and Treharne 1971]
  struct Stiffness {
    double square_frequency, modulus;  ///< that bound, and the largest M [Pa]
  };
  Stiffness stiffness(const Threads&, std::span<const double> F) const;

 private:
  void gradients(std::span<const double> values, std::size_t first, std::size_t last, double* F) const;
  void element_forces(std::size_t first, std::size_t last, const double* P, double* force) const;
  void gather(const Threads&, const std::vector<double>& element_force, std::vector<double>& force) const;

  Mesh mesh_;
  double density_;
  ElasticResponse law_;
};

/// Replaces the negative eigenvalues of a symmetric 9 x 9 matrix by 0.
void make_positive(double* matrix);

}  // namespace cleave::fem

#endif
