#include "scene/rigid_motion.hpp"

#include <gtest/gtest.h>

#include <numbers>

namespace cleave::scene {
namespace {

using std::numbers::pi;

/// The velocity of a moving point is the time derivative of its place.
void expect_velocity_is_derivative(const RigidMotion& motion, double time) {
  const double step = 1e-6;
  const Vector3 X(0.7, -0.4, 1.1);
  const Vector3 derivative = (motion.at(time + step).to_world(X) - motion.at(time - step).to_world(X)) / (2 * step);
  const RigidMotion::Pose pose = motion.at(time);
  EXPECT_LT((pose.velocity_at(pose.to_world(X)) - derivative).norm(), 1e-7 * (1 + derivative.norm())) << "at " << time;
  EXPECT_TRUE((pose.rotation.transpose() * pose.rotation).isIdentity(1e-12));
  EXPECT_LT((pose.to_scene(pose.to_world(X)) - X).norm(), 1e-12);
}

RigidMotion turning() {
  RigidMotion motion;
  motion.velocity = Vector3(1, -2, 0.5);
  motion.angular_velocity = Vector3(0.3, 2, -1);
  motion.center = Vector3(0.2, 0.1, -0.6);
  motion.start = 0.5;
  motion.end = 2.5;
  return motion;
}

RigidMotion keyframed() {
  RigidMotion motion;
  motion.center = Vector3(0.2, 0.1, -0.6);
  motion.keyframes = {{1.0, Vector3(0, 0, 0), Vector3(0, 0, 0)},
                      {2.0, Vector3(1, 0, 0), Vector3(0.4, -1.2, 2.0)},
                      {4.0, Vector3(1, 3, 0), Vector3(-1.0, 0.3, 0.9)}};
  return motion;
}

TEST(RigidMotion, MovesAtItsVelocityOnlyBetweenStartAndEnd) {
  const RigidMotion motion = turning();
  for (const double time : {0.2, 0.7, 1.6, 2.4, 3.0}) expect_velocity_is_derivative(motion, time);
  EXPECT_TRUE(motion.at(0.4).velocity.isZero());
  EXPECT_TRUE(motion.at(0.4).rotation.isIdentity());
  EXPECT_EQ(motion.at(0.5).velocity, motion.velocity);
  EXPECT_TRUE(motion.at(2.5).velocity.isZero());
  EXPECT_TRUE(motion.at(100).translation.isApprox(2.0 * motion.velocity));
  EXPECT_TRUE(motion.at(100).angular_velocity.isZero());
}

TEST(RigidMotion, TurnsAboutItsTranslatedCentre) {
  const RigidMotion motion = turning();
  const RigidMotion::Pose pose = motion.at(1.5);
  EXPECT_LT((pose.to_world(motion.center) - (motion.center + motion.velocity)).norm(), 1e-14);
  EXPECT_LT((pose.rotation -
             Eigen::AngleAxisd(motion.angular_velocity.norm(), motion.angular_velocity.normalized()).toRotationMatrix())
                .norm(),
            1e-14);
}

TEST(RigidMotion, PassesThroughItsKeyframesAtConsistentVelocity) {
  const RigidMotion motion = keyframed();
  for (const double time : {0.3, 1.1, 1.5, 1.9, 2.3, 3.0, 3.9, 5.0}) expect_velocity_is_derivative(motion, time);
  for (const auto& keyframe : motion.keyframes) {
    const double angle = keyframe.rotation.norm();
    const Matrix3 expected =
        angle == 0 ? Matrix3::Identity() : Eigen::AngleAxisd(angle, keyframe.rotation / angle).toRotationMatrix();
    for (const double nearby : {-1e-12, 0.0, 1e-12}) {
      EXPECT_LT((motion.at(keyframe.time + nearby).rotation - expected).norm(), 1e-10);
      EXPECT_LT((motion.at(keyframe.time + nearby).translation - keyframe.translation).norm(), 1e-10);
    }
  }
}

TEST(RigidMotion, TurnsAtAConstantRateBetweenKeyframes) {
  const RigidMotion motion = keyframed();
  EXPECT_TRUE(motion.at(2.2).angular_velocity.isApprox(motion.at(3.8).angular_velocity));
  EXPECT_TRUE(motion.at(2.2).velocity.isApprox(Vector3(0, 1.5, 0)));
}

TEST(RigidMotion, IsAtRestOutsideItsKeyframes) {
  const RigidMotion motion = keyframed();
  for (const double time : {0.0, 4.0, 9.0}) {
    EXPECT_TRUE(motion.at(time).velocity.isZero());
    EXPECT_TRUE(motion.at(time).angular_velocity.isZero());
  }
  EXPECT_EQ(motion.at(9).translation, Vector3(1, 3, 0));
}

TEST(RigidMotion, KeepsWholeTurnsOfKeyframes) {
  RigidMotion motion;
  motion.keyframes = {{0, Vector3::Zero(), Vector3::Zero()}, {2, Vector3::Zero(), Vector3(0, 0, 6 * pi)}};
  EXPECT_LT((motion.at(1).angular_velocity - Vector3(0, 0, 3 * pi)).norm(), 1e-12);
  expect_velocity_is_derivative(motion, 0.9);
  // Also about an axis that differs a little from one keyframe to the next.
  motion.keyframes = {{0, Vector3::Zero(), Vector3(0, 0, 0.5)}, {1, Vector3::Zero(), Vector3(0.01, 0, 4 * pi + 1)}};
  EXPECT_NEAR(motion.at(0.5).angular_velocity.norm(), 4 * pi + 0.5, 0.02);
}

TEST(RigidMotion, OfOneKeyframeHoldsIt) {
  RigidMotion motion;
  motion.keyframes = {{1, Vector3(1, 2, 3), Vector3(0, 0, pi / 2)}};
  for (const double time : {0.0, 1.0, 2.0}) {
    EXPECT_LT((motion.at(time).to_world(Vector3::UnitX()) - Vector3(1, 3, 3)).norm(), 1e-12);
    EXPECT_TRUE(motion.at(time).velocity.isZero());
  }
}

TEST(RigidMotion, WithoutMotionIsTheIdentity) {
  EXPECT_TRUE(RigidMotion().at_rest());
  EXPECT_EQ(RigidMotion().at(3).to_world({1, 2, 3}), Vector3(1, 2, 3));
}

}  // namespace
}  // namespace cleave::scene
