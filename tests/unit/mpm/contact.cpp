#include "mpm/colliders.hpp"

#include <gtest/gtest.h>

namespace cleave::mpm {
namespace {

const Vector3 up(0, 0, 1), still(0, 0, 0);

TEST(Contact, StickyFollowsTheCollider) {
  EXPECT_EQ(resolve_contact(config::Contact::sticky, 0, up, Vector3(1, 2, 3), Vector3(4, 5, 6)), Vector3(1, 2, 3));
}

TEST(Contact, SlipNeverLeavesTheSurfaceAndSeparateMay) {
  const Vector3 leaving(1, 0, 2);
  EXPECT_EQ(resolve_contact(config::Contact::slip, 0, up, still, leaving), Vector3(1, 0, 0));
  EXPECT_EQ(resolve_contact(config::Contact::separate, 0, up, still, leaving), leaving);
  const Vector3 entering(1, 0, -2);
  EXPECT_EQ(resolve_contact(config::Contact::slip, 0, up, still, entering), Vector3(1, 0, 0));
  EXPECT_EQ(resolve_contact(config::Contact::separate, 0, up, still, entering), Vector3(1, 0, 0));
}

TEST(Contact, FrictionTakesUpToTheCoulombLimit) {
  // pressed with an impulse 2, mu = 0.25: half a metre per second of the sliding speed is lost
  EXPECT_TRUE(
      resolve_contact(config::Contact::separate, 0.25, up, still, Vector3(3, 0, -2)).isApprox(Vector3(2.5, 0, 0), 1e-15));
  EXPECT_TRUE(resolve_contact(config::Contact::separate, 0.25, up, still, Vector3(0.3, 0.4, -2)).isZero());
  EXPECT_TRUE(resolve_contact(config::Contact::slip, 0.25, up, still, Vector3(3, 0, 2)).isApprox(Vector3(3, 0, 0), 1e-15))
      << "a surface that holds the material back exerts no friction";
}

TEST(Contact, IsRelativeToAMovingCollider) {
  const Vector3 wall(5, 0, 1), v(5.5, 0, 0);
  EXPECT_TRUE(resolve_contact(config::Contact::separate, 0, up, wall, v).isApprox(Vector3(5.5, 0, 1), 1e-15));
  EXPECT_TRUE(resolve_contact(config::Contact::separate, 1, up, wall, v).isApprox(wall, 1e-15));
}

TEST(Contact, WithoutADirectionHoldsStill) {
  EXPECT_EQ(resolve_contact(config::Contact::separate, 0, Vector3::Zero(), still, Vector3(1, 2, 3)), still);
}

}  // namespace
}  // namespace cleave::mpm
