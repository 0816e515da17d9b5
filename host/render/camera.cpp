#include "render/camera.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>

namespace cleave::render {

View parse_view(const std::string& text) {
  static const std::map<std::string, View> named = {{"front", {0, 0}},    {"back", {180, 0}},         {"right", {90, 0}},
                                                    {"side", {90, 0}},    {"left", {-90, 0}},         {"top", {0, 90}},
                                                    {"bottom", {0, -90}}, {"three-quarter", {35, 20}}};
  if (const auto found = named.find(text); found != named.end()) return found->second;
  View view;
  const std::size_t colon = text.find(':');
  const auto read = [](const char* begin, const char* end, double& value) {
    const auto [rest, error] = std::from_chars(begin, end, value);
    return error == std::errc() && rest == end && std::isfinite(value);
  };
  const char* const begin = text.data();
  if (colon == std::string::npos || !read(begin, begin + colon, view.azimuth) ||
      !read(begin + colon + 1, begin + text.size(), view.elevation) || std::abs(view.elevation) > 90)
    throw InputError("error: --view " + text +
                     ": expected front, back, left, right, side, top, bottom, three-quarter, or azimuth:elevation in degrees "
                     "with the elevation from -90 to 90, such as 35:20");
  return view;
}

Camera::Ray Camera::ray(double x, double y) const {
  const Vector3 aside = slope * ((x - shift) * right + y * up);
  if (orthographic) return {eye + aside, forward};
  return {eye, (forward + aside).normalized()};
}

Eigen::Vector2d Camera::project(const Vector3& point) const {
  const Vector3 d = point - eye;
  const double depth = orthographic ? 1 : d.dot(forward);
  return {d.dot(right) / (depth * slope) + shift, d.dot(up) / (depth * slope)};
}

Camera fit_camera(const View& view, const Box& box, int up_axis, double aspect, double right_margin, double zoom,
                  bool orthographic) {
  const double a = view.azimuth * std::numbers::pi / 180, e = view.elevation * std::numbers::pi / 180;
  // Towards the camera, and its right, with y up; z up has y = -z.
  const auto turned = [up_axis](const Vector3& v) { return up_axis == 2 ? Vector3(v.x(), -v.z(), v.y()) : v; };
  Camera camera;
  camera.orthographic = orthographic;
  const Vector3 back = turned({std::sin(a) * std::cos(e), std::sin(e), std::cos(a) * std::cos(e)});
  camera.forward = -back;
  camera.right = turned({std::cos(a), 0, -std::sin(a)});
  camera.up = back.cross(camera.right);
  camera.shift = -right_margin;

  constexpr double filled = 0.9;  ///< of the picture
  const double tall = filled, wide = filled * std::max(0.2, aspect - right_margin);
  const Vector3 middle = box.center();
  double distance = 0, half = 0;
  for (int corner = 0; corner < 8; corner++) {
    const Vector3 c = box.corner(Box::CornerType(corner)) - middle;
    const double x = std::abs(c.dot(camera.right)), y = std::abs(c.dot(camera.up)), z = c.dot(back);
    half = std::max({half, y / tall, x / wide});
    distance = std::max({distance, z + y / (camera.slope * tall), z + x / (camera.slope * wide)});
  }
  const double size = std::max(box.diagonal().norm(), 1e-12);
  if (orthographic) {
    camera.slope = std::max(half, 1e-12) / zoom;
    camera.eye = middle + 2 * size * back;
  } else {
    camera.slope /= zoom;
    camera.eye = middle + std::max(distance, 0.1 * size) * back;
  }
  return camera;
}

}  // namespace cleave::render
