#include "scene/rigid_motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cleave::scene {
namespace {

Matrix3 rotation_matrix(const Vector3& rotation_vector) {
  const double angle = rotation_vector.norm();
  if (angle == 0) return Matrix3::Identity();
  return Eigen::AngleAxisd(angle, rotation_vector / angle).toRotationMatrix();
}

/// The rotation vector that takes orientation `from` to orientation `to`. Rotations that differ by whole turns have the same
/// orientation; the one nearest to the plain difference is meant, so that keyframes 0 and 2 pi about one axis make a full turn.
Vector3 rotation_between(const Vector3& from, const Vector3& to) {
  const Vector3 difference = to - from;
  const bool same_axis = from.cross(to).norm() <= 1e-12 * from.norm() * to.norm();
  if (same_axis) return difference;
  const Eigen::AngleAxisd shortest(rotation_matrix(to) * rotation_matrix(from).transpose());
  const double full_turn = 2 * std::numbers::pi;
  const double turns = std::round((difference.dot(shortest.axis()) - shortest.angle()) / full_turn);
  return (shortest.angle() + full_turn * turns) * shortest.axis();
}

}  // namespace

RigidMotion::Pose RigidMotion::at(double time) const {
  Pose pose;
  pose.center = center;
  if (keyframes.empty()) {
    const double moved_for = std::max(0.0, std::min(time, end) - start);
    pose.rotation = rotation_matrix(angular_velocity * moved_for);
    pose.translation = velocity * moved_for;
    if (time >= start && time < end) {
      pose.velocity = velocity;
      pose.angular_velocity = angular_velocity;
    }
    return pose;
  }

  const auto next = std::upper_bound(keyframes.begin(), keyframes.end(), time,
                                     [](double t, const Keyframe& keyframe) { return t < keyframe.time; });
  if (next == keyframes.begin() || next == keyframes.end()) {
    const Keyframe& held = next == keyframes.begin() ? keyframes.front() : keyframes.back();
    pose.rotation = rotation_matrix(held.rotation);
    pose.translation = held.translation;
    return pose;
  }
  const Keyframe &from = *(next - 1), &to = *next;
  const double duration = to.time - from.time, fraction = (time - from.time) / duration;
  const Vector3 turn = rotation_between(from.rotation, to.rotation);
  pose.rotation = rotation_matrix(fraction * turn) * rotation_matrix(from.rotation);
  pose.translation = from.translation + fraction * (to.translation - from.translation);
  pose.velocity = (to.translation - from.translation) / duration;
  pose.angular_velocity = turn / duration;
  return pose;
}

}  // namespace cleave::scene
