#pragma once

#include "config/scene.hpp"
#include "mpm/grid.hpp"
#include "scene/shape.hpp"

#include <memory>
#include <vector>

namespace cleave::mpm {

/// Velocity v of a node inside a collider of velocity `collider_velocity` with outward normal n:
/// sticky   v = collider velocity
/// slip     no normal relative velocity; Coulomb friction on the tangential one
/// separate the same, but only where the node moves inwards
Vector3 resolve_contact(config::Contact, double friction, const Vector3& normal, const Vector3& collider_velocity,
                        const Vector3& v);

/// A grid node whose velocity is prescribed along `normal`, altogether where that is zero.
struct HeldNode {
  std::size_t node;
  Vector3 normal;
};

/// A grid node with mass inside a collider.
struct ContactNode {
  std::size_t node;
  Vector3 normal;    ///< outwards; zero: there is no direction to go
  Vector3 velocity;  ///< of the collider there
  config::Contact contact;
  double friction;
};

/// Boundary conditions of the scene's colliders on the grid velocities.
template <class T, int D>
class Colliders {
 public:
  Colliders(const std::vector<config::Collider>&, double cell_size);

  /// Finds the nodes inside colliders at rest; call whenever the grid was rebuilt.
  void prepare(const Grid<T, D>&);
  /// Corrects velocities after the grid update; `time` is the end of the step. Adds the nodes they hold to `held` if that is
  /// given: all of sticky and slip contacts, of the others those that moved inwards.
  void apply(Grid<T, D>&, double time, std::vector<HeldNode>* held = nullptr) const;
  /// The nodes that `apply` would correct, collider by collider.
  std::vector<ContactNode> contacts(const Grid<T, D>&, double time) const;
  /// Fastest speed (m/s) of a moving collider's surface near the scene, for the step size.
  double maximum_speed(double time) const;

 private:
  struct Contact {
    std::size_t node;
    Vector3 normal;
  };
  struct Collider {
    config::Collider spec;
    std::unique_ptr<scene::SignedDistance> shape;
    std::vector<Contact> at_rest;
  };
  std::vector<Contact> find_contacts(const Grid<T, D>&, const Collider&, const scene::RigidMotion::Pose&) const;
  std::vector<Collider> colliders_;
  double cell_size_;
};

}  // namespace cleave::mpm
