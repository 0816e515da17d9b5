/// Linear tetrahedra at rest: shape functions, masses, and what hangs together.
#ifndef CLEAVE_FEM_MESH_HPP
#define CLEAVE_FEM_MESH_HPP

#include <cleave/tensor.hpp>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace cleave::fem {

using Vector = Vector3<double>;
using Matrix = Matrix3<double>;

struct Mesh {
  /// Throws where tetrahedra are flat or inside out, where more than two share a face, and where a vertex belongs to none.
  Mesh(std::span<const double> rest, std::span<const std::uint32_t> corners, double density);

  std::size_t vertices() const { return mass.size(); }
  std::size_t tetrahedra() const { return volume.size(); }

  std::vector<double> rest;                          ///< m, 3 per vertex
  std::vector<std::array<std::uint32_t, 4>> corner;  ///< of each tetrahedron
  std::vector<double> volume;                        ///< m^3
  /// (grad N_1, grad N_2, grad N_3) of each tetrahedron as rows: F = [x_1 - x_0, x_2 - x_0, x_3 - x_0] times this. 1/m
  std::vector<Matrix> gradient;
  /// sum over the corners of |grad N|^2, 1/m^2: |grad N| is one over the altitude of the corner.
  std::vector<double> squared_gradients;
  std::vector<double> mass;  ///< kg per vertex, a quarter of each of its tetrahedra

  /// Corners at each vertex: 4 tetrahedron + corner.
  std::vector<std::size_t> incident_begin;
  std::vector<std::uint32_t> incident;

  std::vector<std::uint32_t> boundary;  ///< triangles, normals outwards
  std::vector<std::uint32_t> piece;     ///< of each vertex, from 0
  std::uint32_t pieces = 0;

 private:
  void find_incident();
  void find_boundary();
  void find_pieces();
};

}  // namespace cleave::fem

#endif
