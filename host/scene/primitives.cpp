#include "scene/primitives.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cleave::scene {
namespace {

using Eigen::Vector2d;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Distance of a box with half edges `half` about the origin, from a point folded into its positive quadrant or octant.
template <int n>
double folded_box_distance(const Eigen::Matrix<double, n, 1>& beyond) {
  return beyond.cwiseMax(0).norm() + std::min(beyond.maxCoeff(), 0.0);
}

/// Its gradient: towards the nearest face inside, away from the nearest point outside.
template <int n>
Eigen::Matrix<double, n, 1> folded_box_gradient(const Eigen::Matrix<double, n, 1>& beyond) {
  Eigen::Index nearest = 0;
  if (beyond.maxCoeff(&nearest) > 0) return beyond.cwiseMax(0).normalized();
  return Eigen::Matrix<double, n, 1>::Unit(nearest);
}

double sign_of(double value) { return value < 0 ? -1.0 : 1.0; }

class BoxShape final : public SignedDistance {
 public:
  BoxShape(const Vector3& center, const Vector3& size) : center_(center), half_(size / 2) {}
  double distance(const Vector3& x) const override { return folded_box_distance<3>((x - center_).cwiseAbs() - half_); }
  Vector3 normal(const Vector3& x) const override {
    const Vector3 p = x - center_;
    return folded_box_gradient<3>(p.cwiseAbs() - half_).cwiseProduct(p.unaryExpr(&sign_of));
  }
  Box bounds() const override { return Box(center_ - half_, center_ + half_); }

 private:
  Vector3 center_, half_;
};

class SphereShape final : public SignedDistance {
 public:
  SphereShape(const Vector3& center, double radius) : center_(center), radius_(radius) {}
  double distance(const Vector3& x) const override { return (x - center_).norm() - radius_; }
  Vector3 normal(const Vector3& x) const override {
    const Vector3 p = x - center_;
    return p.isZero(0) ? Vector3(Vector3::UnitZ()) : p.normalized();
  }
  Box bounds() const override { return Box(center_.array() - radius_, center_.array() + radius_); }

 private:
  Vector3 center_;
  double radius_;
};

class HalfSpace final : public SignedDistance {
 public:
  HalfSpace(const Vector3& point, const Vector3& normal) : normal_(normal), offset_(point.dot(normal)) {}
  double distance(const Vector3& x) const override { return x.dot(normal_) - offset_; }
  Vector3 normal(const Vector3&) const override { return normal_; }
  /// Finite on one side if the plane is normal to an axis, so that half-spaces can be intersected to a bounded shape.
  Box bounds() const override {
    Box box(Vector3::Constant(-infinity), Vector3::Constant(infinity));
    for (int i = 0; i < 3; ++i) {
      if (std::abs(normal_[i]) < 1 - 1e-14) continue;
      (normal_[i] > 0 ? box.max()[i] : box.min()[i]) = offset_ / normal_[i];
    }
    return box;
  }

 private:
  Vector3 normal_;
  double offset_;
};

/// Profiles live in the half-plane (distance from the axis, height along the axis) and are mirrored in height.
/// Their extent is that of a disc swept along the axis, then thickened all round.
struct Extent {
  double disc, half_length, thickness;
};

struct RectangleProfile {  ///< cylinder, tube
  double middle;           ///< from the axis; 0 for a full cylinder
  Vector2d half;
  Vector2d beyond(const Vector2d& p) const { return Vector2d(std::abs(p[0] - middle), std::abs(p[1])) - half; }
  double distance(const Vector2d& p) const { return folded_box_distance<2>(beyond(p)); }
  Vector2d gradient(const Vector2d& p) const {
    return folded_box_gradient<2>(beyond(p)).cwiseProduct(Vector2d(sign_of(p[0] - middle), sign_of(p[1])));
  }
  Extent extent() const { return {middle + half[0], half[1], 0}; }
};

struct RoundProfile {  ///< torus (a circle off the axis) and capsule (a segment on the axis)
  double ring_radius, half_length, thickness;
  Vector2d from_core(const Vector2d& p) const {
    return {p[0] - ring_radius, p[1] - std::clamp(p[1], -half_length, half_length)};
  }
  double distance(const Vector2d& p) const { return from_core(p).norm() - thickness; }
  Vector2d gradient(const Vector2d& p) const {
    const Vector2d q = from_core(p);
    return q.isZero(0) ? Vector2d(1, 0) : q.normalized();
  }
  Extent extent() const { return {ring_radius, half_length, thickness}; }
};

template <class Profile>
class Revolved final : public SignedDistance {
 public:
  Revolved(const Vector3& center, const Vector3& axis, const Profile& profile)
      : center_(center), axis_(axis), profile_(profile) {}
  double distance(const Vector3& x) const override {
    const Vector3 p = x - center_;
    const double height = p.dot(axis_);
    return profile_.distance({(p - height * axis_).norm(), height});
  }
  Vector3 normal(const Vector3& x) const override {
    const Vector3 p = x - center_;
    const double height = p.dot(axis_);
    const Vector3 radial = p - height * axis_;
    const double radius = radial.norm();
    const Vector3 outward = radius > 0 ? Vector3(radial / radius) : axis_.unitOrthogonal();
    const Vector2d gradient = profile_.gradient({radius, height});
    return (gradient[0] * outward + gradient[1] * axis_).normalized();
  }
  Box bounds() const override {
    const Extent extent = profile_.extent();
    const Eigen::Array3d along = axis_.array().abs();
    const Vector3 half = extent.disc * (1 - along.square()).max(0).sqrt() + extent.half_length * along + extent.thickness;
    return Box(center_ - half, center_ + half);
  }

 private:
  Vector3 center_, axis_;
  Profile profile_;
};

void require_positive(double value, const char* shape, const char* what) {
  if (!(value > 0) || !std::isfinite(value)) {
    throw InputError(std::string(shape) + ": " + what + " must be positive, not " + std::to_string(value));
  }
}

Vector3 unit_axis(const Vector3& axis, const char* shape, const char* what) {
  const double length = axis.norm();
  if (!(length > 0) || !std::isfinite(length)) {
    throw InputError(std::string(shape) + ": " + what + " must be a finite direction that is not zero");
  }
  return axis / length;
}

}  // namespace

std::unique_ptr<SignedDistance> make_primitive(const ShapeSpec& spec) {
  using Type = ShapeSpec::Type;
  if (!spec.center.allFinite()) throw InputError("shape: center must be finite");
  switch (spec.type) {
    case Type::box:
      require_positive(spec.size.minCoeff(), "box", "every component of size");
      require_positive(spec.size.maxCoeff(), "box", "every component of size");
      return std::make_unique<BoxShape>(spec.center, spec.size);
    case Type::sphere:
      require_positive(spec.radius, "sphere", "radius");
      return std::make_unique<SphereShape>(spec.center, spec.radius);
    case Type::cylinder:
      require_positive(spec.radius, "cylinder", "radius");
      require_positive(spec.height, "cylinder", "height");
      return std::make_unique<Revolved<RectangleProfile>>(spec.center, unit_axis(spec.axis, "cylinder", "axis"),
                                                          RectangleProfile{0, {spec.radius, spec.height / 2}});
    case Type::tube: {
      require_positive(spec.radius, "tube", "radius");
      require_positive(spec.inner_radius, "tube", "inner_radius");
      require_positive(spec.height, "tube", "height");
      require_positive(spec.radius - spec.inner_radius, "tube", "radius less inner_radius");
      const double middle = (spec.radius + spec.inner_radius) / 2, half_wall = (spec.radius - spec.inner_radius) / 2;
      return std::make_unique<Revolved<RectangleProfile>>(spec.center, unit_axis(spec.axis, "tube", "axis"),
                                                          RectangleProfile{middle, {half_wall, spec.height / 2}});
    }
    case Type::capsule:
      require_positive(spec.radius, "capsule", "radius");
      require_positive(spec.height, "capsule", "height");
      return std::make_unique<Revolved<RoundProfile>>(spec.center, unit_axis(spec.axis, "capsule", "axis"),
                                                      RoundProfile{0, spec.height / 2, spec.radius});
    case Type::torus:
      require_positive(spec.radius, "torus", "radius");
      require_positive(spec.tube_radius, "torus", "tube_radius");
      if (spec.tube_radius > spec.radius) throw InputError("torus: tube_radius must not exceed radius");
      return std::make_unique<Revolved<RoundProfile>>(spec.center, unit_axis(spec.axis, "torus", "axis"),
                                                      RoundProfile{spec.radius, 0, spec.tube_radius});
    case Type::half_space:
      return std::make_unique<HalfSpace>(spec.center, unit_axis(spec.axis, "half_space", "normal"));
    default:
      throw InputError("shape: not a primitive");
  }
}

}  // namespace cleave::scene
