#pragma once

#include "scene/shape.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cleave::scene {

/// How the fibers of a body lie, as the scene file describes it. Directions have unit length; angles are in radians.
/// About a line through `center` along `axis`, e_r points away from the line and e_theta = axis x e_r goes round it.
struct FiberSpec {
  enum class Layout {
    uniform,       ///< `direction`
    radial,        ///< away from `center`, or e_r if there is an `axis`
    cylindrical,   ///< e_theta
    longitudinal,  ///< `axis`
    helical,       ///< cos(angle) e_theta + sin(angle) axis
    grid,          ///< a vector grid of a file
    flow           ///< along a potential flow through the body from `inflow` to `outflow`
  };
  Vector3 direction = Vector3::UnitX();  ///< uniform
  /// Second direction. uniform: orthogonal to the first; else its part orthogonal to the first is taken. Empty: completed.
  std::optional<Vector3> second = {};
  Layout layout = Layout::uniform;
  std::optional<Vector3> center = {};     ///< radial, cylindrical, helical; longitudinal: only for the second direction
  std::optional<Vector3> axis = {};       ///< cylindrical, longitudinal, helical; radial: away from a line
  double angle = 0;                       ///< helical: from e_theta towards the axis
  std::filesystem::path file = {};        ///< grid: .vdb, absolute
  std::string grid = {};                  ///< grid: name, empty for the first vector grid
  std::string second_grid = {};           ///< grid: of the second direction; empty: completed
  std::optional<ShapeSpec> inflow = {};   ///< flow
  std::optional<ShapeSpec> outflow = {};  ///< flow
};

/// Two families of fibers, a direction of each per particle: unit and orthogonal.
struct FiberField {
  std::vector<Vector3> first, second;
};

/// Directions at particles. Where a layout has none (on its centre or axis) some direction that fits the layout is taken.
/// Where `second` is not given it is: cylindrical: the axis; radial about an axis, longitudinal about a centre: e_theta;
/// helical: -sin(angle) e_theta + cos(angle) axis; uniform, longitudinal: perpendicular_to() the first; radial from a point,
/// grid, flow: as nearly as possible along the coordinate axis that the first is least along. In 2D it is the first turned by
/// 90 degrees. Throws InputError: the file or grid is missing or holds no direction at a particle; inflow or outflow touch no
/// cell (edge `cell_size`) of the body, or the body does not connect them.
FiberField lay_fibers(const FiberSpec&, const std::vector<Vector3>& positions, double cell_size, int dimension);

/// A unit vector orthogonal to the given one: the coordinate axis after the one closest to it, made orthogonal (x gives y).
Vector3 perpendicular_to(const Vector3& direction);

}  // namespace cleave::scene
