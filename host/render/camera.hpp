#pragma once

#include "common/types.hpp"

#include <string>

namespace cleave::render {

/// Where a picture is taken from, in degrees: azimuth 0 is the front (from +z where y is up, from -y where z is), 90 from +x.
struct View {
  double azimuth = 35, elevation = 20;
};

/// "front", "back", "left", "right", "side" (from the right), "top", "bottom", "three-quarter", or "azimuth:elevation". Throws
/// InputError.
View parse_view(const std::string&);

struct Camera {
  Vector3 eye, right, up, forward;  ///< m; unit vectors
  double slope = 0.25;              ///< half the height of the picture at distance 1; orthographic: in metres
  double shift = 0;                 ///< of the middle to the right, in halves of the height
  bool orthographic = false;

  struct Ray {
    Vector3 origin, direction;
  };
  /// x to the right and y upwards from the middle of the picture, in halves of its height.
  Ray ray(double x, double y) const;
  /// The place in the picture of a point in front of it.
  Eigen::Vector2d project(const Vector3&) const;
};

/// Sees the whole box in the part of the picture left of `right_margin`, which like the aspect ratio of the whole picture is in
/// heights of the picture. `up_axis`: 1 or 2.
Camera fit_camera(const View&, const Box&, int up_axis, double aspect, double right_margin, double zoom, bool orthographic);

}  // namespace cleave::render
