#pragma once

#include "common/types.hpp"
#include "scene/mesh_io.hpp"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace cleave::scene {

/// A shape as the scene file describes it: a tree of primitives, files, booleans and transforms. Lengths in metres,
/// angles in radians. Two-dimensional scenes use the same shapes; only the plane z = 0 of them is seen.
struct ShapeSpec {
  enum class Type {
    box,
    sphere,
    cylinder,
    capsule,
    torus,
    tube,
    half_space,
    mesh,
    level_set,
    set_union,
    difference,
    intersection
  };
  Type type = Type::box;

  Vector3 center = Vector3::Zero();  ///< of box, sphere, cylinder, capsule, torus, tube; a point of the half-space's plane
  Vector3 size = Vector3::Ones();    ///< box: full edge lengths
  Vector3 axis = Vector3::UnitZ();   ///< cylinder, capsule, torus, tube: direction; half-space: outward normal
  double radius = 0;                 ///< sphere, cylinder, capsule; torus: of the ring; tube: outer
  double inner_radius = 0;           ///< tube
  double tube_radius = 0;            ///< torus: of the tube
  double height = 0;                 ///< cylinder, capsule (between the centres of its caps), tube

  std::filesystem::path file;  ///< mesh (.obj, .ply, .stl) or level_set (.vdb), absolute
  std::string grid;            ///< level_set: name of the grid, empty for the first level set by name
  double file_size = 0;        ///< mesh, level_set: scaled uniformly so that its longest edge is this; 0: as it is
  bool centered = false;       ///< mesh, level_set: moved so that its bounding box is centred at `center`

  std::vector<ShapeSpec> children;  ///< union, intersection: any number; difference: the first less all others

  /// Applied to the finished shape, in this order: scale about the origin, rotate about the origin, translate.
  Vector3 scale = Vector3::Ones();
  Matrix3 rotation = Matrix3::Identity();
  Vector3 translation = Vector3::Zero();
};

/// Signed distance to a surface, negative inside. Exact for primitives; for meshes and level sets from a sparse OpenVDB level
/// set; for booleans and non-uniform scales a bound that never exceeds the true distance in magnitude.
class SignedDistance {
 public:
  virtual ~SignedDistance() = default;
  virtual double distance(const Vector3& x) const = 0;  ///< [any-thread]
  virtual Vector3 normal(const Vector3& x) const;       ///< outward unit gradient; zero where the distance is flat
  virtual Box bounds() const = 0;                       ///< of the inside; infinite for a half-space
  /// Distances beyond this are only known to be at least this in magnitude (narrow band of a level set).
  virtual double band() const;
};

/// Builds a shape. `voxel_size` (m) is the resolution of level sets made from meshes.
/// Throws InputError naming the file: missing, unreadable, empty, or not closed (with the count of open edges).
std::unique_ptr<SignedDistance> build_shape(const ShapeSpec&, double voxel_size);

/// The triangles of a mesh shape, placed and scaled but neither turned nor moved by its transform.
TriangleMesh read_placed_mesh(const ShapeSpec&);

/// Puts points of a file to where a shape that is a file says: by its size and centre, then its transform.
void place_points(const ShapeSpec&, std::vector<Vector3>&);

}  // namespace cleave::scene
