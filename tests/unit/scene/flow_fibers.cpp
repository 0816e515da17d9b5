#include "scene/flow_field.hpp"
#include "scene/sampling.hpp"
#include "scene_testing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cleave::scene {
namespace {

using testing::HasSubstr;

ShapeSpec box(const Vector3& low, const Vector3& high) {
  ShapeSpec spec;
  spec.center = (low + high) / 2;
  spec.size = high - low;
  return spec;
}

ShapeSpec joined(ShapeSpec::Type type, std::vector<ShapeSpec> parts) {
  ShapeSpec spec;
  spec.type = type;
  spec.children = std::move(parts);
  return spec;
}

std::vector<Vector3> fill(const ShapeSpec& shape, double cell_size, int dimension,
                          SamplingPattern pattern = SamplingPattern::jittered) {
  SamplingSpec sampling;
  sampling.pattern = pattern;
  sampling.particles_per_cell = dimension == 3 ? 8 : 4;
  return sample(*build_shape(shape, cell_size / 2), sampling, cell_size, dimension).positions;
}

std::vector<Vector3> flow(const std::vector<Vector3>& x, const ShapeSpec& in, const ShapeSpec& out, double cell_size,
                          int dimension) {
  return flow_directions(*build_shape(in, cell_size / 2), *build_shape(out, cell_size / 2), x, cell_size, dimension);
}

/// Angles in degrees between fibers, which have no sense: mean and maximum.
struct Deviation {
  double mean = 0, maximum = 0;
};
template <class Expected>
Deviation deviation(const std::vector<Vector3>& x, const std::vector<Vector3>& field, const Expected& expected) {
  Deviation d;
  for (std::size_t i = 0; i < x.size(); ++i) {
    EXPECT_NEAR(field[i].norm(), 1, 1e-12);
    const double angle = std::asin(std::min(1.0, field[i].cross(expected(x[i])).norm())) * 180 / std::numbers::pi;
    d.mean += angle / double(x.size());
    d.maximum = std::max(d.maximum, angle);
  }
  return d;
}

constexpr double far = 10;

TEST(FlowFibers, FollowAStraightBarExactly) {
  const auto x = fill(box({0, 0.013, -0.12}, {1.02, 0.21, 0.1}), 0.05, 3, SamplingPattern::regular);
  const auto field = flow(x, box({-far, -far, -far}, {0.17, far, far}), box({0.9, -far, -far}, {far, far, far}), 0.05, 3);
  for (const Vector3& a : field) ASSERT_LT((a - Vector3::UnitX()).norm(), 1e-6) << "downstream along the bar";
}

TEST(FlowFibers, FollowABarAtAnAngleToTheGrid) {
  for (const double degrees : {10.0, 30.0, 45.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const Matrix3 turn = Eigen::AngleAxisd(angle, Vector3::UnitZ()).toRotationMatrix();
    const auto turned = [&](ShapeSpec shape) {
      shape.rotation = turn;
      return shape;
    };
    const auto x = fill(turned(box({0, 0, -1}, {1, 0.3, 1})), 0.02, 2);
    const auto field =
        flow(x, turned(box({-far, -far, -1}, {0.1, far, 1})), turned(box({0.9, -far, -1}, {far, far, 1})), 0.02, 2);
    const Deviation d = deviation(x, field, [&](const Vector3&) { return Vector3(turn.col(0)); });
    EXPECT_LT(d.mean, 0.8);
    EXPECT_LT(d.maximum, 8);
  }
}

ShapeSpec half_ring(double height) {
  ShapeSpec ring;
  ring.type = ShapeSpec::Type::tube;
  ring.radius = 1;
  ring.inner_radius = 0.5;
  ring.height = height;
  return joined(ShapeSpec::Type::intersection, {ring, box({-far, -0.1, -far}, {far, far, far})});
}

TEST(FlowFibers, GoRoundAHalfRing) {
  for (const int dimension : {2, 3}) {
    const double cell_size = dimension == 2 ? 0.02 : 0.04;
    const auto x = fill(half_ring(0.31), cell_size, dimension);
    const auto field = flow(x, box({0, -far, -far}, {far, 0, far}), box({-far, -far, -far}, {0, 0, far}), cell_size, dimension);
    std::vector<Vector3> inside, there;
    for (std::size_t i = 0; i < x.size(); ++i)
      if (x[i].y() > 0) {
        inside.push_back(x[i]);
        there.push_back(field[i]);
      }
    const Deviation d = deviation(inside, there, [](const Vector3& y) { return Vector3(-y.y(), y.x(), 0).normalized(); });
    EXPECT_LT(d.mean, 0.8);
    EXPECT_LT(d.maximum, 8);
    EXPECT_GT(there.front().y() * inside.front().x(), 0) << "from inflow to outflow";
  }
}

TEST(FlowFibers, CarryOnIntoDeadEnds) {
  // A T: the flow passes along x, the limb along y hangs off it.
  const auto x =
      fill(joined(ShapeSpec::Type::set_union, {box({0, 0, -1}, {2, 0.2, 1}), box({0.9, 0.2, -1}, {1.1, 3, 1})}), 0.05, 2);
  const auto field = flow(x, box({-far, -far, -1}, {0.1, far, 1}), box({1.9, -far, -1}, {far, far, 1}), 0.05, 2);
  Vector3 least = Vector3::Ones(), greatest = -Vector3::Ones();
  for (std::size_t i = 0; i < x.size(); ++i) {
    ASSERT_NEAR(field[i].norm(), 1, 1e-12);
    ASSERT_EQ(field[i].z(), 0);
    if (x[i].y() < 2.5) continue;
    least = least.cwiseMin(field[i]);
    greatest = greatest.cwiseMax(field[i]);
  }
  EXPECT_LT((greatest - least).norm(), 0.1) << "the end of the limb has about one direction";
}

TEST(FlowFibers, DoNotFeelABodyAcrossAGap) {
  // A U of two legs one cell apart: each leg has the direction of a bar, opposite to the other's.
  const auto x = fill(joined(ShapeSpec::Type::set_union,
                             {box({0, 0, -1}, {2, 0.2, 1}), box({0, 0.25, -1}, {2, 0.45, 1}), box({2, 0, -1}, {2.2, 0.45, 1})}),
                      0.05, 2, SamplingPattern::regular);
  const auto field = flow(x, box({-far, -far, -1}, {0.1, 0.22, 1}), box({-far, 0.22, -1}, {0.1, far, 1}), 0.05, 2);
  for (std::size_t i = 0; i < x.size(); ++i)
    if (x[i].x() < 1) {
      const Vector3 expected = x[i].y() < 0.22 ? Vector3(1, 0, 0) : Vector3(-1, 0, 0);
      ASSERT_LT((field[i] - expected).norm(), 1e-3);
    }
}

TEST(FlowFibers, DependOnlyOnThePosition) {
  auto x = fill(half_ring(1), 0.05, 2);
  const auto in = box({0, -far, -far}, {far, 0, far}), out = box({-far, -far, -far}, {0, 0, far});
  auto field = flow(x, in, out, 0.05, 2);
  std::reverse(x.begin(), x.end());
  std::reverse(field.begin(), field.end());
  EXPECT_EQ(flow(x, in, out, 0.05, 2), field);
}

TEST(FlowFibers, GiveStrayParticlesTheDirectionOfTheNearest) {
  auto x = fill(box({0, 0, -1}, {2, 0.6, 1}), 0.1, 2);
  x.emplace_back(1.05, 0.85, 0);  // two cells off the bar
  const auto field = flow(x, box({-far, -far, -far}, {0.1, far, far}), box({1.9, -far, -far}, {far, far, far}), 0.1, 2);
  for (const Vector3& direction : field) EXPECT_NEAR(direction.x(), 1, 1e-3);
}

TEST(FlowFibers, RefuseWhatDoesNotFlow) {
  const auto two =
      fill(joined(ShapeSpec::Type::set_union, {box({0, 0, -1}, {1, 0.2, 1}), box({2, 0, -1}, {3, 0.2, 1})}), 0.1, 2);
  const auto at = [](double low, double high) { return box({low, -far, -far}, {high, far, far}); };
  const auto error = [&](const ShapeSpec& in, const ShapeSpec& out) {
    return input_error([&] { flow(two, in, out, 0.1, 2); });
  };
  EXPECT_THAT(
      error(at(-1, 0.1), at(2.9, 4)),
      HasSubstr("the body does not connect 'inflow' (2 cells) and 'outflow' (2 cells) of the fibers: its 40 cells are in 2 "
                "parts, none of which reaches both"));
  EXPECT_THAT(error(at(-1, 0.1), at(0.9, 1.5)), HasSubstr("20 of the 40 cells of the body are not connected"));
  EXPECT_THAT(error(at(-1, -0.5), at(0.9, 1)),
              HasSubstr("the 'inflow' of the fibers holds the centre of none of the 40 cells"));
  EXPECT_THAT(error(at(-1, 0.5), at(1.2, 1.5)), HasSubstr("the 'outflow' of the fibers holds the centre of none"));
  EXPECT_THAT(error(at(-1, 0.5), at(0.3, 4)), HasSubstr("share 4 of the 40 cells"));
  // In the second bar the regions touch; the first has a flow.
  const auto in = joined(ShapeSpec::Type::set_union, {at(-1, 0.1), at(2, 2.5)});
  const auto out = joined(ShapeSpec::Type::set_union, {at(0.9, 1), at(2.5, 3)});
  EXPECT_THAT(error(in, out), HasSubstr("leave no room for a flow between them in 20 of the 40 cells"));
}

}  // namespace
}  // namespace cleave::scene
