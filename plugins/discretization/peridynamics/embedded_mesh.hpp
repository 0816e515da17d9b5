/// The tetrahedra around the points of a body, as they come apart where bonds break [Chen et al. 2018, section 5.2].
#ifndef CLEAVE_PERIDYNAMICS_EMBEDDED_MESH_HPP
#define CLEAVE_PERIDYNAMICS_EMBEDDED_MESH_HPP

#include "solid.hpp"

namespace cleave::peridynamics {

/// A face is cracked once the bond of the points on its two sides is broken. A vertex is split into as many as there are
/// groups of its tetrahedra, connected through faces around it that are not cracked. Both follow from the bonds alone, so
/// that any number of vertices splits at once and a mesh is a function of the state of its body.
///
/// Each tetrahedron moves its vertices as its point and the unbroken bonds of that move: x + F (X - X_point). A vertex is
/// where its tetrahedra, weighed by mass, put it on average, and has the mean of the velocities they give it. (Velocities
/// of the points alone, summed up over steps, would leave vertices behind where a body turns.)
class EmbeddedMesh {
 public:
  explicit EmbeddedMesh(const cleave_body&);

  /// Surface of the body with points at `position` (m, 3 numbers each) and so on.
  SurfaceMesh surface(const Solid&, std::span<const double> position, std::span<const double> velocity,
                      std::span<const double> damage, std::span<const double> mass);

 private:
  /// Of one tetrahedron the face across from a corner, and that of its neighbour if there is one.
  struct Face {
    std::uint32_t tetrahedron[2];
    std::uint8_t across[2];
    bool shared;
  };
  using Corners = std::array<std::uint32_t, 3>;  ///< numbers of corners: four for each tetrahedron
  /// Normal outwards.
  Corners corners_of(const Face&, int side) const;
  /// For each corner of the first side the one of the second side at the same vertex.
  std::uint32_t partner(const Face&, std::uint32_t corner) const;

  void split(const Solid&);
  void move(const Solid&, std::span<const double> position, std::span<const double> velocity, std::span<const double> damage,
            std::span<const double> mass);

  std::vector<double> rest_;               ///< vertices, m
  std::vector<std::uint32_t> tetrahedra_;  ///< 4 of them each
  std::vector<std::uint8_t> left_handed_;  ///< 1 per tetrahedron: of negative volume
  std::vector<Face> faces_;

  // of the last surface
  std::vector<std::uint32_t> vertex_of_corner_, triangles_, piece_;
  std::vector<double> vertices_, velocity_, damage_;
};

}  // namespace cleave::peridynamics

#endif
