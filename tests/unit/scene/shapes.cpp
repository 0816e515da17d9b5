#include "scene_testing.hpp"

#include <Eigen/Geometry>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

namespace cleave::scene {
namespace {

using Type = ShapeSpec::Type;
using std::numbers::pi;

const Vector3 tilted_axis = Vector3(1, 2, -0.5).normalized();

ShapeSpec shape_of(Type type) {
  ShapeSpec spec;
  spec.type = type;
  spec.center = Vector3(0.2, -0.1, 0.3);
  spec.size = Vector3(1.0, 0.6, 1.4);
  spec.axis = tilted_axis;
  spec.radius = 0.6;
  spec.inner_radius = 0.35;
  spec.tube_radius = 0.2;
  spec.height = 0.9;
  return spec;
}

std::unique_ptr<SignedDistance> build(const ShapeSpec& spec) { return build_shape(spec, 0.05); }

struct Primitive {
  std::string name;
  Type type;
  /// Membership from the definition, in coordinates (distance from the axis, height along it) or, for the box, per axis.
  std::function<bool(const ShapeSpec&, const Vector3&)> contains;
  friend std::ostream& operator<<(std::ostream& out, const Primitive& primitive) { return out << primitive.name; }
};

double height(const ShapeSpec& s, const Vector3& x) { return (x - s.center).dot(s.axis); }
double radius(const ShapeSpec& s, const Vector3& x) { return (x - s.center - height(s, x) * s.axis).norm(); }

const std::vector<Primitive>& primitives() {
  static const std::vector<Primitive> all = {
      {"Box", Type::box,
       [](const ShapeSpec& b, const Vector3& x) { return ((x - b.center).cwiseAbs().array() < b.size.array() / 2).all(); }},
      {"Sphere", Type::sphere, [](const ShapeSpec& b, const Vector3& x) { return (x - b.center).norm() < b.radius; }},
      {"Cylinder", Type::cylinder,
       [](const ShapeSpec& b, const Vector3& x) { return radius(b, x) < b.radius && std::abs(height(b, x)) < b.height / 2; }},
      {"Capsule", Type::capsule,
       [](const ShapeSpec& b, const Vector3& x) {
         const double beyond = std::max(0.0, std::abs(height(b, x)) - b.height / 2);
         return std::hypot(radius(b, x), beyond) < b.radius;
       }},
      {"Torus", Type::torus,
       [](const ShapeSpec& b, const Vector3& x) { return std::hypot(radius(b, x) - b.radius, height(b, x)) < b.tube_radius; }},
      {"Tube", Type::tube,
       [](const ShapeSpec& b, const Vector3& x) {
         return radius(b, x) < b.radius && radius(b, x) > b.inner_radius && std::abs(height(b, x)) < b.height / 2;
       }},
  };
  return all;
}

class Primitives : public testing::TestWithParam<Primitive> {
 protected:
  ShapeSpec spec = shape_of(GetParam().type);
  std::unique_ptr<SignedDistance> shape = build(spec);
};

TEST_P(Primitives, AreNegativeExactlyInside) {
  RandomPoints points(1.6);
  for (int i = 0; i < 20000; ++i) {
    const Vector3 x = points.next();
    ASSERT_EQ(shape->distance(x) < 0, GetParam().contains(spec, x)) << x.transpose();
  }
}

// The exact distance is the radius of the largest ball about a point that the surface does not enter: no point nearer than it
// changes sides, and going that far along the gradient reaches the surface.
TEST_P(Primitives, GiveTheExactDistance) {
  RandomPoints points(1.6), directions(1.0, 11);
  for (int i = 0; i < 2000; ++i) {
    const Vector3 x = points.next();
    const double distance = shape->distance(x);
    const bool inside = GetParam().contains(spec, x);
    for (int k = 0; k < 20; ++k) {
      const Vector3 y = x + 0.999999 * std::abs(distance) * directions.next().normalized();
      ASSERT_EQ(GetParam().contains(spec, y), inside) << x.transpose();
    }
    const Vector3 beyond_surface = x - (distance + (inside ? -1 : 1) * 1e-7) * shape->normal(x);
    ASSERT_NE(GetParam().contains(spec, beyond_surface), inside) << x.transpose();
  }
}

TEST_P(Primitives, NeverChangeFasterThanTheDistanceMoved) {
  RandomPoints points(1.6), steps(0.3, 3);
  for (int i = 0; i < 20000; ++i) {
    const Vector3 x = points.next(), y = x + steps.next();
    ASSERT_LE(std::abs(shape->distance(x) - shape->distance(y)), (x - y).norm() * (1 + 1e-12));
  }
}

TEST_P(Primitives, HaveTheGradientAsNormal) {
  RandomPoints points(1.6);
  int compared = 0;
  for (int i = 0; i < 4000; ++i) {
    const Vector3 x = points.next();
    ASSERT_NEAR(shape->normal(x).norm(), 1, 1e-12);
    const Vector3 numerical = shape->SignedDistance::normal(x);
    Vector3 slope;
    for (int k = 0; k < 3; ++k) {
      const Vector3 h = 1e-6 * Vector3::Unit(k);
      slope[k] = (shape->distance(x + h) - shape->distance(x - h)) / 2e-6;
    }
    if (std::abs(slope.norm() - 1) > 1e-6) continue;  // the medial axis has no gradient
    ++compared;
    ASSERT_LT((shape->normal(x) - numerical).norm(), 1e-4) << x.transpose();
  }
  EXPECT_GT(compared, 3900);
}

TEST_P(Primitives, LieTightlyWithinTheirBounds) {
  const Box bounds = shape->bounds();
  Box seen;
  RandomPoints points(1.6);
  for (int i = 0; i < 400000; ++i) {
    const Vector3 x = points.next();
    if (shape->distance(x) < 0) seen.extend(x);
  }
  EXPECT_TRUE(bounds.contains(seen));
  EXPECT_LT((bounds.sizes() - seen.sizes()).maxCoeff(), 0.12);
}

TEST_P(Primitives, HaveFiniteNormalsEverywhere) {
  for (const Vector3& x :
       {spec.center, Vector3(spec.center + 0.1 * spec.axis), Vector3(spec.center + spec.radius * spec.axis.unitOrthogonal()),
        Vector3(spec.center + spec.size / 2)}) {
    EXPECT_TRUE(shape->normal(x).allFinite());
    EXPECT_TRUE(std::isfinite(shape->distance(x)));
  }
}

INSTANTIATE_TEST_SUITE_P(All, Primitives, testing::ValuesIn(primitives()), [](const auto& info) { return info.param.name; });

TEST(HalfSpaces, MeasureAlongTheirNormal) {
  ShapeSpec spec;
  spec.type = Type::half_space;
  spec.center = Vector3(0, 2, 0);
  spec.axis = Vector3(0, 3, 0);
  const auto floor = build(spec);
  EXPECT_DOUBLE_EQ(floor->distance({5, 2.5, -7}), 0.5);
  EXPECT_DOUBLE_EQ(floor->distance({5, 0, -7}), -2);
  EXPECT_EQ(floor->normal({1, 1, 1}), Vector3(0, 1, 0));
  EXPECT_EQ(floor->bounds().max()[1], 2);
  EXPECT_TRUE(std::isinf(floor->bounds().min()[1]) && std::isinf(floor->bounds().max()[0]));
}

TEST(HalfSpaces, BoundAShapeTogether) {
  ShapeSpec slab;
  slab.type = Type::intersection;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      ShapeSpec half;
      half.type = Type::half_space;
      half.axis = side * Vector3::Unit(axis);
      half.center = side * Vector3(1, 2, 3);
      slab.children.push_back(half);
    }
  }
  EXPECT_TRUE(build(slab)->bounds().isApprox(Box(Vector3(-1, -2, -3), Vector3(1, 2, 3))));
  // A quarter turn carries rounding into the matrix, which must not make bounded directions infinite.
  slab.children.pop_back();
  slab.rotation = Eigen::AngleAxisd(pi / 2, Vector3::UnitX()).toRotationMatrix();
  const Box turned = build(slab)->bounds();
  EXPECT_NEAR(turned.max()[2], 2, 1e-12);
  EXPECT_TRUE(std::isinf(turned.min()[1]));
  EXPECT_NEAR(turned.max()[1], 3, 1e-12);
}

struct Pair {
  ShapeSpec first = shape_of(Type::box), second = shape_of(Type::sphere);
  Pair() { second.center = Vector3(0.6, 0.1, 0.5); }
};

struct Boolean {
  const char* name;
  Type type;
  friend std::ostream& operator<<(std::ostream& out, const Boolean& boolean) { return out << boolean.name; }
};

class Booleans : public testing::TestWithParam<Boolean> {};

TEST_P(Booleans, ContainWhatTheirSetsSay) {
  const Pair pair;
  ShapeSpec spec;
  spec.type = GetParam().type;
  spec.children = {pair.first, pair.second};
  const auto a = build(pair.first), b = build(pair.second), both = build(spec);
  RandomPoints points(1.6);
  for (int i = 0; i < 20000; ++i) {
    const Vector3 x = points.next();
    const bool in_a = a->distance(x) < 0, in_b = b->distance(x) < 0;
    const bool expected = spec.type == Type::set_union      ? in_a || in_b
                          : spec.type == Type::intersection ? in_a && in_b
                                                            : in_a && !in_b;
    ASSERT_EQ(both->distance(x) < 0, expected);
    if (expected) {
      ASSERT_TRUE(both->bounds().contains(x));
    }
  }
}

TEST_P(Booleans, NeverOverestimateTheDistance) {
  const Pair pair;
  ShapeSpec spec;
  spec.type = GetParam().type;
  spec.children = {pair.first, pair.second};
  const auto both = build(spec);
  RandomPoints points(1.6), directions(1, 5);
  for (int i = 0; i < 3000; ++i) {
    const Vector3 x = points.next();
    const double distance = both->distance(x);
    for (int k = 0; k < 20; ++k) {
      const Vector3 y = x + 0.999999 * std::abs(distance) * directions.next().normalized();
      ASSERT_EQ(both->distance(y) < 0, distance < 0);
    }
    ASSERT_LT((both->normal(x) - both->SignedDistance::normal(x)).norm(), 1e-3) << x.transpose();
  }
}

INSTANTIATE_TEST_SUITE_P(All, Booleans,
                         testing::Values(Boolean{"Union", Type::set_union}, Boolean{"Intersection", Type::intersection},
                                         Boolean{"Difference", Type::difference}),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(Booleans, OfOneShapeAreThatShape) {
  for (const Type type : {Type::set_union, Type::intersection, Type::difference}) {
    ShapeSpec spec;
    spec.type = type;
    spec.children = {shape_of(Type::torus)};
    EXPECT_EQ(build(spec)->distance({0.1, 0.2, 0.3}), build(spec.children[0])->distance({0.1, 0.2, 0.3}));
  }
}

TEST(Transforms, ScaleThenRotateThenTranslate) {
  ShapeSpec spec;
  spec.type = Type::box;
  spec.center = Vector3(1, 0, 0);
  spec.size = Vector3(2, 0.2, 0.2);  // from the origin along x
  spec.scale = Vector3::Constant(3);
  spec.rotation = Eigen::AngleAxisd(pi / 2, Vector3::UnitZ()).toRotationMatrix();
  spec.translation = Vector3(10, 0, 0);
  const auto shape = build(spec);
  EXPECT_TRUE(shape->bounds().isApprox(Box(Vector3(9.7, 0, -0.3), Vector3(10.3, 6, 0.3)), 1e-12));
  EXPECT_NEAR(shape->distance({10, 7, 0}), 1, 1e-12);
  EXPECT_NEAR(shape->distance({10, 3, 0}), -0.3, 1e-12);
  EXPECT_LT((shape->normal({10, 7, 0}) - Vector3::UnitY()).norm(), 1e-12);
}

TEST(Transforms, BoundTheDistanceUnderNonUniformAndMirroringScale) {
  ShapeSpec spec = shape_of(Type::sphere);
  spec.center = Vector3(0.3, 0, 0);
  spec.radius = 0.5;
  spec.scale = Vector3(-2, 1, 0.5);
  const auto ellipsoid = build(spec);
  const auto contains = [](const Vector3& x) { return (Vector3(-x[0] / 2, x[1], x[2] * 2) - Vector3(0.3, 0, 0)).norm() < 0.5; };
  RandomPoints points(1.6), directions(1, 5);
  for (int i = 0; i < 5000; ++i) {
    const Vector3 x = points.next();
    const double distance = ellipsoid->distance(x);
    ASSERT_EQ(distance < 0, contains(x));
    for (int k = 0; k < 10; ++k) {
      const Vector3 y = x + 0.999999 * std::abs(distance) * directions.next().normalized();
      ASSERT_EQ(contains(y), distance < 0);
    }
    ASSERT_LT((ellipsoid->normal(x) - ellipsoid->SignedDistance::normal(x)).norm(), 1e-3);
  }
}

TEST(Shapes, RefuseSizesThatMakeNoSense) {
  using testing::HasSubstr;
  const auto error_of = [](Type type, const std::function<void(ShapeSpec&)>& spoil) {
    ShapeSpec spec = shape_of(type);
    spoil(spec);
    return input_error([&] { build(spec); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(error_of(Type::sphere, [](ShapeSpec& s) { s.radius = 0; }), HasSubstr("sphere: radius must be positive"));
  EXPECT_THAT(error_of(Type::sphere, [&](ShapeSpec& s) { s.radius = nan; }), HasSubstr("sphere: radius must be positive"));
  EXPECT_THAT(error_of(Type::box, [](ShapeSpec& s) { s.size[1] = -1; }), HasSubstr("size must be positive"));
  EXPECT_THAT(error_of(Type::cylinder, [](ShapeSpec& s) { s.axis.setZero(); }), HasSubstr("cylinder: axis"));
  EXPECT_THAT(error_of(Type::cylinder, [](ShapeSpec& s) { s.height = 0; }), HasSubstr("height must be positive"));
  EXPECT_THAT(error_of(Type::tube, [](ShapeSpec& s) { s.inner_radius = 0.7; }), HasSubstr("radius less inner_radius"));
  EXPECT_THAT(error_of(Type::torus, [](ShapeSpec& s) { s.tube_radius = 0.7; }), HasSubstr("must not exceed radius"));
  EXPECT_THAT(error_of(Type::half_space, [](ShapeSpec& s) { s.axis.setZero(); }), HasSubstr("normal"));
  EXPECT_THAT(error_of(Type::set_union, [](ShapeSpec&) {}), HasSubstr("at least one shape"));
  EXPECT_THAT(error_of(Type::box, [](ShapeSpec& s) { s.scale[2] = 0; }), HasSubstr("scale"));
  EXPECT_THAT(error_of(Type::box, [](ShapeSpec& s) { s.rotation *= 2; }), HasSubstr("orthogonal"));
  EXPECT_THAT(error_of(Type::box, [&](ShapeSpec& s) { s.translation[0] = nan; }), HasSubstr("translation"));
}

}  // namespace
}  // namespace cleave::scene
