#pragma once

#include <cleave/testkit/body.hpp>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace cleave::testkit {

inline std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

inline Point at(const std::vector<double>& values, std::size_t i) {
  return {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
}
inline Point difference(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline double length(const Point& a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }
inline Point cross(const Point& a, const Point& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
/// Length of the longest vector, not a number if one is none.
inline double largest(const std::vector<double>& vectors) {
  double most = 0;
  for (std::size_t i = 0; i < vectors.size() / 3 && !std::isnan(most); ++i) {
    const double here = length(at(vectors, i));
    if (!(here <= most)) most = here;
  }
  return most;
}

/// Velocities up to `speed` at random.
inline void shake(Body& body, Random& random, double speed) {
  for (double& v : body.velocity) v += random.uniform(-speed, speed);
}

/// A quarter of the step a discretisation tells for such a body at rest: what other checks than that of the step use.
inline double quiet_step(Context& context, const Settings& settings, const Body& body) {
  Scene scene(context, settings);
  scene.add(body);
  return 0.25 * scene.stable_step();
}

}  // namespace cleave::testkit
