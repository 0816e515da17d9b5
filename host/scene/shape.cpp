#include "scene/shape.hpp"

#include "common/error.hpp"
#include "scene/level_set.hpp"
#include "scene/primitives.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cleave::scene {

Vector3 SignedDistance::normal(const Vector3& x) const {
  const Box box = bounds();
  const double scale = box.sizes().allFinite() ? box.diagonal().norm() : 1.0;
  const double step = 6e-6 * std::max(scale, x.norm());
  Vector3 gradient;
  for (int i = 0; i < 3; ++i) {
    const Vector3 offset = step * Vector3::Unit(i);
    gradient[i] = distance(x + offset) - distance(x - offset);
  }
  const double length = gradient.norm();
  return length > 0 ? Vector3(gradient / length) : Vector3(Vector3::Zero());
}

double SignedDistance::band() const { return std::numeric_limits<double>::infinity(); }

namespace {

using Children = std::vector<std::unique_ptr<SignedDistance>>;

double narrowest_band(const Children& children) {
  double band = std::numeric_limits<double>::infinity();
  for (const auto& child : children) band = std::min(band, child->band());
  return band;
}

class Union final : public SignedDistance {
 public:
  explicit Union(Children children) : children_(std::move(children)) {}
  double distance(const Vector3& x) const override {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& child : children_) least = std::min(least, child->distance(x));
    return least;
  }
  Vector3 normal(const Vector3& x) const override {
    const auto nearest = std::min_element(children_.begin(), children_.end(),
                                          [&](const auto& a, const auto& b) { return a->distance(x) < b->distance(x); });
    return (*nearest)->normal(x);
  }
  Box bounds() const override {
    Box box;
    for (const auto& child : children_) {
      const Box part = child->bounds();
      if (!part.isEmpty()) box.extend(part);
    }
    return box;
  }
  double band() const override { return narrowest_band(children_); }

 private:
  Children children_;
};

/// Intersection, and difference as the intersection of the first child with the outsides of the others.
class Intersection final : public SignedDistance {
 public:
  Intersection(Children children, bool subtract_others) : children_(std::move(children)), subtract_(subtract_others) {}
  double distance(const Vector3& x) const override {
    double greatest = children_.front()->distance(x);
    for (std::size_t i = 1; i < children_.size(); ++i) greatest = std::max(greatest, side_of(i) * children_[i]->distance(x));
    return greatest;
  }
  Vector3 normal(const Vector3& x) const override {
    std::size_t deciding = 0;
    double greatest = children_.front()->distance(x);
    for (std::size_t i = 1; i < children_.size(); ++i) {
      const double distance = side_of(i) * children_[i]->distance(x);
      if (distance > greatest) {
        greatest = distance;
        deciding = i;
      }
    }
    return side_of(deciding) * children_[deciding]->normal(x);
  }
  Box bounds() const override {
    Box box = children_.front()->bounds();
    if (subtract_) return box;
    for (std::size_t i = 1; i < children_.size(); ++i) box.clamp(children_[i]->bounds());
    return box;
  }
  double band() const override { return narrowest_band(children_); }

 private:
  double side_of(std::size_t i) const { return subtract_ && i > 0 ? -1.0 : 1.0; }

  Children children_;
  bool subtract_;
};

/// Bounding box of the affine image of a box that may be infinite.
Box image_of(const Box& box, const Matrix3& linear, const Vector3& translation) {
  if (box.isEmpty()) return box;
  Box image(translation, translation);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const auto term = [&](double bound) {
        // Rounding in a quarter turn must not make a bounded direction infinite.
        if (std::isinf(bound) && std::abs(linear(i, j)) < 1e-14 * linear.cwiseAbs().maxCoeff()) return 0.0;
        return linear(i, j) * bound;
      };
      const double a = term(box.min()[j]), b = term(box.max()[j]);
      image.min()[i] += std::min(a, b);
      image.max()[i] += std::max(a, b);
    }
  }
  return image;
}

/// x = rotation * scale * X + translation. Lengths shrink by no less than the smallest scale, which keeps distances a bound
/// under a non-uniform scale and exact under a uniform one.
class Transformed final : public SignedDistance {
 public:
  Transformed(std::unique_ptr<SignedDistance> child, const Vector3& scale, const Matrix3& rotation, const Vector3& translation)
      : child_(std::move(child)),
        to_world_(rotation * scale.asDiagonal()),
        to_local_(scale.cwiseInverse().asDiagonal() * rotation.transpose()),
        translation_(translation),
        least_scale_(scale.cwiseAbs().minCoeff()) {}
  double distance(const Vector3& x) const override { return least_scale_ * child_->distance(to_local_ * (x - translation_)); }
  Vector3 normal(const Vector3& x) const override {
    const Vector3 gradient = to_local_.transpose() * child_->normal(to_local_ * (x - translation_));
    const double length = gradient.norm();
    return length > 0 ? Vector3(gradient / length) : gradient;
  }
  Box bounds() const override { return image_of(child_->bounds(), to_world_, translation_); }
  double band() const override { return least_scale_ * child_->band(); }

 private:
  std::unique_ptr<SignedDistance> child_;
  Matrix3 to_world_, to_local_;
  Vector3 translation_;
  double least_scale_;
};

std::unique_ptr<SignedDistance> transformed(std::unique_ptr<SignedDistance> shape, const Vector3& scale,
                                            const Matrix3& rotation, const Vector3& translation) {
  if (scale == Vector3::Ones() && rotation.isIdentity(0) && translation.isZero(0)) return shape;
  return std::make_unique<Transformed>(std::move(shape), scale, rotation, translation);
}

/// How the contents of a file are scaled and moved before anything else happens to them.
struct Placement {
  double scale = 1;
  Vector3 translation = Vector3::Zero();
};

Placement place_file(const ShapeSpec& spec, const Box& box) {
  Placement placement;
  if (spec.file_size != 0) {
    if (!(spec.file_size > 0) || !std::isfinite(spec.file_size)) {
      throw InputError(spec.file.string() + ": the size it is scaled to must be positive");
    }
    const double longest = box.sizes().maxCoeff();
    if (!(longest > 0)) throw InputError(spec.file.string() + ": it is a single point and cannot be scaled to a size");
    placement.scale = spec.file_size / longest;
  }
  if (spec.centered) placement.translation = spec.center - placement.scale * box.center();
  return placement;
}

void check_transform(const ShapeSpec& spec) {
  if (!spec.scale.allFinite() || (spec.scale.array() == 0).any()) throw InputError("shape: scale must be finite and not zero");
  if (!spec.translation.allFinite()) throw InputError("shape: translation must be finite");
  if (!spec.rotation.allFinite() || !(spec.rotation * spec.rotation.transpose()).isIdentity(1e-6)) {
    throw InputError("shape: rotation must be an orthogonal matrix");
  }
}

}  // namespace

TriangleMesh read_placed_mesh(const ShapeSpec& spec) {
  TriangleMesh mesh = read_mesh(spec.file);
  Box box;
  for (const auto& triangle : mesh.triangles) {
    for (const int corner : triangle) box.extend(mesh.vertices[static_cast<std::size_t>(corner)]);
  }
  const Placement placement = place_file(spec, box);
  for (Vector3& vertex : mesh.vertices) {
    vertex = (placement.scale * vertex + placement.translation).cwiseProduct(spec.scale);
  }
  return mesh;
}

void place_points(const ShapeSpec& spec, std::vector<Vector3>& points) {
  check_transform(spec);
  Box box;
  for (const Vector3& x : points) box.extend(x);
  const Placement placement = place_file(spec, box);
  for (Vector3& x : points) {
    x = spec.rotation * (placement.scale * x + placement.translation).cwiseProduct(spec.scale) + spec.translation;
  }
}

std::unique_ptr<SignedDistance> build_shape(const ShapeSpec& spec, double voxel_size) {
  using Type = ShapeSpec::Type;
  check_transform(spec);
  std::unique_ptr<SignedDistance> shape;
  Vector3 scale = spec.scale;
  switch (spec.type) {
    case Type::set_union:
    case Type::difference:
    case Type::intersection: {
      if (spec.children.empty()) throw InputError("shape: a union, difference or intersection needs at least one shape");
      // What the voxels of the children's meshes are in the children's own, unscaled lengths.
      const double child_voxel_size = voxel_size / spec.scale.cwiseAbs().maxCoeff();
      Children children;
      for (const ShapeSpec& child : spec.children) children.push_back(build_shape(child, child_voxel_size));
      if (spec.type == Type::set_union) {
        shape = std::make_unique<Union>(std::move(children));
      } else {
        shape = std::make_unique<Intersection>(std::move(children), spec.type == Type::difference);
      }
      break;
    }
    case Type::mesh: {
      // Scaling the vertices rather than the finished level set keeps the voxels cubes and distances exact.
      const TriangleMesh mesh = read_placed_mesh(spec);
      shape = level_set_of_mesh(mesh, voxel_size, spec.file.string());
      scale = Vector3::Ones();
      break;
    }
    case Type::level_set: {
      shape = read_level_set(spec.file, spec.grid);
      const Placement placement = place_file(spec, shape->bounds());
      shape = transformed(std::move(shape), Vector3::Constant(placement.scale), Matrix3::Identity(), placement.translation);
      break;
    }
    default:
      shape = make_primitive(spec);
  }
  return transformed(std::move(shape), scale, spec.rotation, spec.translation);
}

}  // namespace cleave::scene
