#pragma once

#include "common/types.hpp"

#include <limits>
#include <vector>

namespace cleave::scene {

/// Scripted motion of a rigid body, starting from its place in the scene (the identity at the first instant).
/// Either constant velocities between `start` and `end`, or keyframes (linear translation, constant-rate rotation between
/// neighbours; at rest before the first and after the last). Both empty: at rest.
struct RigidMotion {
  struct Keyframe {
    double time = 0;                        ///< s
    Vector3 translation = Vector3::Zero();  ///< m, from the place in the scene
    Vector3 rotation = Vector3::Zero();     ///< rotation vector, radians, about `center`
  };

  Vector3 velocity = Vector3::Zero();          ///< m/s
  Vector3 angular_velocity = Vector3::Zero();  ///< rad/s, about `center` (which itself translates)
  Vector3 center = Vector3::Zero();            ///< m, in the scene's place
  double start = 0;
  double end = std::numeric_limits<double>::infinity();
  std::vector<Keyframe> keyframes;

  bool at_rest() const { return velocity.isZero() && angular_velocity.isZero() && keyframes.empty(); }

  /// x(t) = rotation * (X - center) + center + translation for a point X of the scene.
  struct Pose {
    Matrix3 rotation = Matrix3::Identity();
    Vector3 translation = Vector3::Zero();
    Vector3 center = Vector3::Zero();
    Vector3 velocity = Vector3::Zero();  ///< of the moved centre
    Vector3 angular_velocity = Vector3::Zero();

    Vector3 to_world(const Vector3& X) const { return rotation * (X - center) + center + translation; }
    Vector3 to_scene(const Vector3& x) const { return rotation.transpose() * (x - center - translation) + center; }
    Vector3 velocity_at(const Vector3& x) const { return velocity + angular_velocity.cross(x - center - translation); }
  };
  Pose at(double time) const;
};

}  // namespace cleave::scene
