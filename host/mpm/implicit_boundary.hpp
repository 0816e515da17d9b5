#pragma once

#include "mpm/colliders.hpp"

#include <cstddef>
#include <vector>

namespace cleave::mpm {

/// The nodes whose velocity handles and colliders prescribe in an implicit step, altogether or along directions, and the
/// impulses of friction on them. Vectors are four numbers per node, the first of them the mass or unused.
///
/// Contact is unilateral and friction is Coulomb's, found by active sets: a solve takes the state of each contact as given, its
/// reactions then say which contacts open, close, stick or slide, and there is another solve if any does.
template <class T, int D>
class ImplicitBoundary {
 public:
  /// First state, from the masses and velocities without forces of the material; nodes that a handle holds have its velocity.
  ImplicitBoundary(const std::vector<HeldNode>& handles, const std::vector<ContactNode>&, const T* free_motion);

  bool empty() const { return nodes_.empty(); }
  /// Sets the prescribed components.
  void impose(T* velocity) const;
  /// Clears them.
  void project(T* vector) const;
  /// each(node, projector onto its free directions)
  template <class F>
  void for_projectors(F&& each) const {
    for (const Node& n : nodes_) each(n.node, n.free);
  }
  /// What friction adds to a gradient: minus its impulses.
  void add_friction(T* gradient) const;
  /// The potential of friction's impulses, -sum j . v.
  double friction_energy(const T* velocity) const;

  /// Looks at the reactions, the gradient where it is prescribed, each known up to sqrt(mass) * error. Returns true if the
  /// state of a contact has changed.
  bool update(const T* velocity, const T* gradient, const T* mass, double error);
  /// No contact is left with a velocity into its collider.
  void close(T* velocity) const;
  /// The nodes that are held now.
  std::vector<HeldNode> held() const;

 private:
  struct Contact : ContactNode {
    bool holds = false, sticks = false;
    Vector3 friction_impulse = Vector3::Zero();
  };
  struct Node {
    std::size_t node;
    bool fixed;                          ///< by a handle
    std::size_t first, count;            ///< contacts
    Vector3 velocity = Vector3::Zero();  ///< prescribed part
    Matrix3 free = Matrix3::Identity();  ///< projector onto what is not prescribed
  };
  static Vector3 at(const T* vector, std::size_t node) {
    Vector3 v = Vector3::Zero();
    for (int a = 0; a < D; a++) v[a] = double(vector[4 * node + std::size_t(a) + 1]);
    return v;
  }
  static void put(T* vector, std::size_t node, const Vector3& v) {
    for (int a = 0; a < D; a++) vector[4 * node + std::size_t(a) + 1] = T(v[a]);
  }
  void constrain(Node&);

  std::vector<Node> nodes_;
  std::vector<Contact> contacts_;
};

}  // namespace cleave::mpm
