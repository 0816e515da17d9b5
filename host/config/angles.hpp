#pragma once

#include "common/types.hpp"

#include <cmath>
#include <numbers>

namespace cleave::config {

inline double radians(double degrees) { return degrees * (std::numbers::pi / 180); }

/// An angle in degrees that radians() takes back to the same bits, if there is one: rounding in both directions would
/// otherwise let a scene drift each time it is written and read.
inline double degrees(double angle) {
  const double near = angle * (180 / std::numbers::pi);
  double below = near, above = near;
  for (int step = 0; step < 4; ++step) {
    if (radians(below) == angle) return below;
    if (radians(above) == angle) return above;
    below = std::nextafter(below, -HUGE_VAL);
    above = std::nextafter(above, HUGE_VAL);
  }
  return near;
}

inline Vector3 radians(const Vector3& degrees) {
  return degrees.unaryExpr([](double x) { return radians(x); });
}
inline Vector3 degrees(const Vector3& angle) {
  return angle.unaryExpr([](double x) { return degrees(x); });
}

}  // namespace cleave::config
