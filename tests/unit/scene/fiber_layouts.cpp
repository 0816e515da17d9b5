#include "scene/fiber_field.hpp"
#include "scene_testing.hpp"

#include <cmath>
#include <numbers>

namespace cleave::scene {
namespace {

using Layout = FiberSpec::Layout;

const Vector3 center(0.3, -0.2, 0.1), axis = Vector3(1, 2, -2) / 3;

FiberSpec layout(Layout layout) {
  FiberSpec spec;
  spec.layout = layout;
  return spec;
}

FiberSpec about_line(Layout kind, double angle = 0) {
  FiberSpec spec = layout(kind);
  spec.center = center;
  spec.axis = axis;
  spec.angle = angle;
  return spec;
}

/// Random points, the centre, and points on the line.
std::vector<Vector3> points(int dimension = 3) {
  std::vector<Vector3> all;
  RandomPoints random(2);
  for (int i = 0; i < 500; ++i) all.push_back(random.next());
  for (const double along : {0.0, 1e-3, -0.7, 5.0}) all.push_back(center + along * axis);
  all.push_back(Vector3::Zero());
  if (dimension == 2)
    for (Vector3& x : all) x.z() = 0;
  return all;
}

bool on_line(const Vector3& x) { return (x - center).cross(axis).norm() < 1e-9; }

void expect_orthonormal(const FiberField& field, std::size_t count) {
  ASSERT_EQ(field.first.size(), count);
  ASSERT_EQ(field.second.size(), count);
  for (std::size_t i = 0; i < count; ++i) {
    ASSERT_NEAR(field.first[i].norm(), 1, 1e-14);
    ASSERT_NEAR(field.second[i].norm(), 1, 1e-14);
    ASSERT_NEAR(field.first[i].dot(field.second[i]), 0, 1e-14);
  }
}

FiberField lay(const FiberSpec& spec, const std::vector<Vector3>& positions, int dimension = 3) {
  FiberField field = lay_fibers(spec, positions, 0.1, dimension);
  expect_orthonormal(field, positions.size());
  return field;
}

TEST(FiberLayout, UniformIsTheSameEverywhere) {
  FiberSpec spec = layout(Layout::uniform);
  spec.direction = axis;
  for (const Vector3& a : lay(spec, points()).first) ASSERT_EQ(a, axis);
  spec.second = Vector3(0, 1, 1).normalized();
  for (const Vector3& a : lay(spec, points()).second) ASSERT_EQ(a, *spec.second);
}

TEST(FiberLayout, RadialPointsAwayFromThePoint) {
  FiberSpec spec = layout(Layout::radial);
  spec.center = center;
  const auto x = points();
  const FiberField field = lay(spec, x);
  for (std::size_t i = 0; i < x.size(); ++i) ASSERT_NEAR(field.first[i].dot(x[i] - center), (x[i] - center).norm(), 1e-14);
}

TEST(FiberLayout, RadialWithAnAxisPointsAwayFromTheLine) {
  const auto x = points();
  const FiberField field = lay(about_line(Layout::radial), x);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Vector3 d = x[i] - center;
    ASSERT_NEAR(field.first[i].dot(axis), 0, 1e-14);
    ASSERT_NEAR(field.first[i].dot(d), d.cross(axis).norm(), 1e-13);
    ASSERT_TRUE(field.second[i].isApprox(axis.cross(field.first[i]), 1e-13)) << "the second goes round the line";
  }
}

TEST(FiberLayout, CylindricalGoesRoundTheLine) {
  const auto x = points();
  const FiberField field = lay(about_line(Layout::cylindrical), x);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Vector3 d = x[i] - center;
    ASSERT_NEAR(field.first[i].dot(d), 0, 1e-13);
    ASSERT_NEAR(axis.cross(d).dot(field.first[i]), d.cross(axis).norm(), 1e-13) << "right-handed about the axis";
    ASSERT_EQ(field.second[i], axis);
  }
}

TEST(FiberLayout, LongitudinalFollowsTheAxis) {
  const auto x = points();
  const FiberField field = lay(about_line(Layout::longitudinal), x);
  for (std::size_t i = 0; i < x.size(); ++i) {
    ASSERT_EQ(field.first[i], axis);
    ASSERT_NEAR(field.second[i].dot(x[i] - center), 0, 1e-13) << "the second goes round the line";
  }
}

TEST(FiberLayout, HelicalRisesAtItsAngle) {
  const auto x = points();
  for (const double degrees : {-90.0, -35.0, 0.0, 20.0, 90.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const FiberField field = lay(about_line(Layout::helical, angle), x);
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Vector3 d = x[i] - center;
      ASSERT_NEAR(std::asin(std::clamp(field.first[i].dot(axis), -1.0, 1.0)), angle, 1e-7);
      if (on_line(x[i])) continue;
      ASSERT_NEAR(field.first[i].dot(d - d.dot(axis) * axis), 0, 1e-13) << "in the tangent plane of the cylinder";
      ASSERT_NEAR(field.second[i].dot(d - d.dot(axis) * axis), 0, 1e-13);
      const Vector3 around = axis.cross(d).normalized();
      ASSERT_NEAR(field.first[i].dot(around), std::cos(angle), 1e-13);
    }
  }
}

TEST(FiberLayout, ExplicitSecondIsMadeOrthogonal) {
  FiberSpec spec = about_line(Layout::radial);
  spec.second = axis;
  for (const Vector3& b : lay(spec, points()).second) ASSERT_TRUE(b.isApprox(axis, 1e-13));
  spec = layout(Layout::radial);
  spec.center = center;
  spec.second = Vector3::UnitY();
  const auto x = points();
  const FiberField field = lay(spec, x);
  for (std::size_t i = 0; i < x.size(); ++i)
    ASSERT_NEAR(field.second[i].dot(Vector3::UnitY().cross(field.first[i])), 0, 1e-13) << "in the plane of both";
}

TEST(FiberLayout, ExplicitSecondAlongTheFirstGivesWayToTheNaturalOne) {
  FiberSpec spec = about_line(Layout::longitudinal);
  spec.second = axis;
  const auto x = points();
  const FiberField given = lay(spec, x);
  spec.second.reset();
  EXPECT_EQ(given.second, lay(spec, x).second);
}

TEST(FiberLayout, StaysInThePlaneInTwoDimensions) {
  const auto x = points(2);
  for (const Layout kind : {Layout::uniform, Layout::radial, Layout::cylindrical, Layout::longitudinal}) {
    FiberSpec spec = layout(kind);
    spec.center = Vector3(0.3, -0.2, 0);
    if (kind == Layout::cylindrical) spec.axis = Vector3::UnitZ();
    if (kind == Layout::longitudinal) spec.axis = Vector3(0.6, 0.8, 0);
    const FiberField field = lay(spec, x, 2);
    for (std::size_t i = 0; i < x.size(); ++i) {
      ASSERT_EQ(field.first[i].z(), 0);
      ASSERT_EQ(field.second[i].z(), 0);
      ASSERT_NEAR(field.first[i].cross(field.second[i]).z(), 1, 1e-14);
    }
  }
}

TEST(FiberLayout, SecondAboutAPointIsContinuousOffTheLeastAxis) {
  FiberSpec spec = layout(Layout::radial);
  spec.center = Vector3::Zero();
  // A slab across z: the field is least along z, so the second is the part of z at right angles.
  std::vector<Vector3> x;
  RandomPoints random(1);
  for (int i = 0; i < 200; ++i) x.emplace_back(random.next().cwiseProduct(Vector3(1, 1, 0.1)));
  const FiberField field = lay(spec, x);
  for (std::size_t i = 0; i < x.size(); ++i) ASSERT_GE(field.second[i].z(), 0);
}

TEST(PerpendicularTo, TurnsXIntoYAndIsUnit) {
  EXPECT_EQ(perpendicular_to(Vector3::UnitX()), Vector3::UnitY());
  EXPECT_EQ(perpendicular_to(Vector3::UnitZ()), Vector3::UnitX());
  EXPECT_NEAR(perpendicular_to(axis).dot(axis), 0, 1e-15);
}

}  // namespace
}  // namespace cleave::scene
