#include "scene/fiber_field.hpp"

#include "scene/flow_field.hpp"
#include "scene/vector_grid.hpp"

#include <cmath>

namespace cleave::scene {
namespace {

using Layout = FiberSpec::Layout;

Vector3 turned_in_plane(const Vector3& v) { return {-v.y(), v.x(), 0}; }

/// `v` over its length, or `otherwise` where it is no longer than what rounding leaves of lengths of size `scale`.
Vector3 unit_or(const Vector3& v, double scale, const Vector3& otherwise) {
  const double length = v.norm();
  return length > 1e-12 * scale ? Vector3(v / length) : otherwise;
}

/// Directions about a line; on the line itself e_r is perpendicular_to() it.
class Line {
 public:
  Line(const Vector3& point, const Vector3& axis) : point_(point), axis_(axis), on_axis_(perpendicular_to(axis)) {}
  const Vector3& axis() const { return axis_; }
  Vector3 outward(const Vector3& x) const {
    const Vector3 d = x - point_;
    const Vector3 r = unit_or(d - d.dot(axis_) * axis_, x.norm() + point_.norm(), on_axis_);
    return (r - r.dot(axis_) * axis_).normalized();  // near the line the first difference has few digits left
  }
  Vector3 around(const Vector3& x) const { return axis_.cross(outward(x)); }

 private:
  Vector3 point_, axis_, on_axis_;
};

/// The part of `wanted` orthogonal to `first`, or `otherwise` where there is next to none.
Vector3 orthogonal_part(const Vector3& wanted, const Vector3& first, const Vector3& otherwise) {
  constexpr double smallest_sine = 1e-3;
  const Vector3 part = wanted - wanted.dot(first) * first;
  return part.norm() > smallest_sine ? Vector3((part / part.norm())) : otherwise;
}

/// The coordinate axis the field is least along.
Vector3 transverse_axis(const std::vector<Vector3>& field) {
  Vector3 along = Vector3::Zero();
  for (const Vector3& a : field) along += a.cwiseAbs2();
  int least = 0;
  along.minCoeff(&least);
  return Vector3::Unit(least);
}

template <class Direction>
std::vector<Vector3> at_each(const std::vector<Vector3>& positions, const Direction& direction) {
  std::vector<Vector3> field;
  field.reserve(positions.size());
  for (const Vector3& x : positions) field.push_back(direction(x));
  return field;
}

std::vector<Vector3> lay_first(const FiberSpec& spec, const std::vector<Vector3>& positions, double cell_size, int dimension) {
  const Vector3 center = spec.center.value_or(Vector3::Zero());
  const Vector3 axis = spec.axis.value_or(Vector3::UnitZ());
  const Line line(center, axis);
  switch (spec.layout) {
    case Layout::uniform:
      return std::vector<Vector3>(positions.size(), spec.direction);
    case Layout::radial:
      if (spec.axis) return at_each(positions, [&](const Vector3& x) { return line.outward(x); });
      return at_each(positions,
                     [&](const Vector3& x) { return unit_or(x - center, x.norm() + center.norm(), Vector3::UnitX()); });
    case Layout::cylindrical:
      return at_each(positions, [&](const Vector3& x) { return line.around(x); });
    case Layout::longitudinal:
      return std::vector<Vector3>(positions.size(), axis);
    case Layout::helical:
      return at_each(positions, [&, c = std::cos(spec.angle), s = std::sin(spec.angle)](const Vector3& x) {
        return Vector3(c * line.around(x) + s * axis);
      });
    case Layout::grid:
      return grid_directions(spec.file, spec.grid, positions, dimension);
    case Layout::flow:
      return flow_directions(*build_shape(*spec.inflow, cell_size / 2), *build_shape(*spec.outflow, cell_size / 2), positions,
                             cell_size, dimension);
  }
  return {};
}

/// The second direction that a layout has of itself.
std::vector<Vector3> complete(const FiberSpec& spec, const std::vector<Vector3>& positions, const std::vector<Vector3>& first) {
  const Line line(spec.center.value_or(Vector3::Zero()), spec.axis.value_or(Vector3::UnitZ()));
  const auto around = [&](const Vector3& x) { return line.around(x); };
  switch (spec.layout) {
    case Layout::cylindrical:
      return std::vector<Vector3>(positions.size(), line.axis());
    case Layout::helical:
      return at_each(positions, [&, c = std::cos(spec.angle), s = std::sin(spec.angle)](const Vector3& x) {
        return Vector3(c * line.axis() - s * line.around(x));
      });
    case Layout::longitudinal:
      if (spec.center) return at_each(positions, around);
      return at_each(first, perpendicular_to);
    case Layout::radial:
      if (spec.axis) return at_each(positions, around);
      break;
    case Layout::uniform:
      return at_each(first, perpendicular_to);
    case Layout::grid:
    case Layout::flow:
      break;
  }
  const Vector3 wanted = transverse_axis(first);
  return at_each(first, [&](const Vector3& a) { return orthogonal_part(wanted, a, perpendicular_to(a)); });
}

}  // namespace

Vector3 perpendicular_to(const Vector3& direction) {
  int closest = 0;
  direction.cwiseAbs().maxCoeff(&closest);
  const Vector3 axis = Vector3::Unit((closest + 1) % 3);
  return (axis - axis.dot(direction) * direction).normalized();
}

FiberField lay_fibers(const FiberSpec& spec, const std::vector<Vector3>& positions, double cell_size, int dimension) {
  FiberField field;
  field.first = lay_first(spec, positions, cell_size, dimension);
  if (dimension == 2 && !spec.second) {
    field.second = at_each(field.first, turned_in_plane);
    return field;
  }
  if (spec.layout == Layout::uniform && spec.second) {
    field.second.assign(positions.size(), *spec.second);
    return field;
  }
  field.second = complete(spec, positions, field.first);
  std::vector<Vector3> wanted;
  if (spec.second)
    wanted.assign(positions.size(), *spec.second);
  else if (!spec.second_grid.empty())
    wanted = grid_directions(spec.file, spec.second_grid, positions, dimension);
  for (std::size_t i = 0; i < wanted.size(); ++i) field.second[i] = orthogonal_part(wanted[i], field.first[i], field.second[i]);
  return field;
}

}  // namespace cleave::scene
