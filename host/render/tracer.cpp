#include "render/tracer.hpp"

#include <embree3/rtcore.h>
#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

namespace cleave::render {
namespace {

using Eigen::Vector3f;

constexpr unsigned solid_mask = 1, clear_mask = 2;
constexpr int occlusion_rays = 4, most_layers = 8;

/// The place of ray number i of a pixel's sequence in the unit square: the additive recurrence of M. Roberts, "The unreasonable
/// effectiveness of quasirandom sequences" (2018), from a start that is scattered over pixels.
struct Sequence {
  std::uint32_t state;
  explicit Sequence(std::uint32_t x, std::uint32_t y) : state(x * 0x9e3779b9u ^ (y * 0x85ebca6bu + 0x7f4a7c15u)) {
    state ^= state >> 16;
    state *= 0x7feb352du;
    state ^= state >> 15;
    state *= 0x846ca68bu;
    state ^= state >> 16;
    first[0] = float(state & 0xffff) / 65536;
    first[1] = float(state >> 16) / 65536;
  }
  std::array<float, 2> next() {
    i++;
    const auto part = [](float v) { return v - std::floor(v); };
    return {part(first[0] + 0.7548776662f * float(i)), part(first[1] + 0.5698402910f * float(i))};
  }
  float first[2];
  int i = 0;
};

/// Two directions at right angles to a unit vector (T. Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1),
/// 2017).
std::array<Vector3f, 2> across(const Vector3f& n) {
  const float sign = std::copysign(1.f, n.z()), a = -1 / (sign + n.z()), b = n.x() * n.y() * a;
  return {Vector3f(1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()), Vector3f(b, sign + n.y() * n.y() * a, -n.y())};
}

Vector3f around(const Vector3f& axis, std::array<float, 2> u, float cosine_power, float spread) {
  const auto [s, t] = across(axis);
  const float angle = 2 * std::numbers::pi_v<float> * u[0], r = spread * std::pow(u[1], cosine_power);
  return (axis * std::sqrt(std::max(0.f, 1 - r * r)) + r * (std::cos(angle) * s + std::sin(angle) * t)).normalized();
}

class Tracer {
 public:
  Tracer(const Stage& stage, const Camera& camera) : stage_(stage) {
    device_ = rtcNewDevice(nullptr);
    if (!device_) throw std::runtime_error("Embree cannot be started");
    scene_ = rtcNewScene(device_);
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    for (const Triangles& t : stage.surfaces) add(t);
    for (const Balls& b : stage.balls) add(b);
    rtcCommitScene(scene_);
    if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) throw std::runtime_error("Embree cannot hold this picture");
    to_light_ = (1.1 * camera.up - 0.55 * camera.right - 0.6 * camera.forward + 0.4 * stage.up).normalized().cast<float>();
    if (stage.ground) {  // the sun stays above the floor, and shadows of moderate length
      const Vector3f normal = stage.ground->normal.cast<float>();
      const float height = to_light_.dot(normal);
      if (height < 0.6f) to_light_ = (to_light_ + (0.75f - height) * normal).normalized();
    }
  }
  ~Tracer() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  Tracer(const Tracer&) = delete;
  Tracer& operator=(const Tracer&) = delete;

  Vector3f along(const Camera::Ray& ray, const Vector3f& background, Sequence& sequence) const {
    Vector3f color = Vector3f::Zero(), origin = ray.origin.cast<float>();
    const Vector3f direction = ray.direction.cast<float>();
    float clear = 1, from = 0;
    const float floor = to_floor(ray);
    for (int layer = 0; layer < most_layers; layer++) {
      RTCRayHit hit = query(origin, direction, from, floor, solid_mask | clear_mask);
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      rtcIntersect1(scene_, &context, &hit);
      if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) break;
      Vector3f normal;
      const Vector3f own = surface(hit, direction, normal);
      const float opacity = hit.hit.geomID < stage_.surfaces.size() ? stage_.surfaces[hit.hit.geomID].opacity : 1.f;
      const Vector3f place = origin + hit.ray.tfar * direction;
      const bool solid = opacity >= 1;
      color += clear * opacity * (stage_.flat ? own : lit(own, place, normal, direction, sequence, solid));
      clear *= 1 - opacity;
      if (solid) return color;
      from = hit.ray.tfar + 1e-4f * float(stage_.size);
    }
    if (std::isfinite(floor)) {
      const Vector3f place = origin + floor * direction, normal = stage_.ground->normal.cast<float>();
      const float away = (place - stage_.middle.cast<float>()).norm() / float(stage_.size);
      const float fade = std::clamp((away - 1.5f) / 3.5f, 0.f, 1.f), part = fade * fade * (3 - 2 * fade);
      // Unshaded it has the colour of the background, so that its end is not seen.
      if (part < 1) return color + clear * (part * background + (1 - part) * floor_light(place, normal, sequence) * background);
    }
    return color + clear * background;
  }

 private:
  void add(const Triangles& t) {
    RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), t.vertices.size()));
    for (std::size_t i = 0; i < t.vertices.size(); i++) std::copy_n(t.vertices[i].data(), 3, vertices + 3 * i);
    auto* corners = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                   3 * sizeof(unsigned), t.corners.size() / 3));
    std::copy(t.corners.begin(), t.corners.end(), corners);
    rtcSetGeometryMask(geometry, t.opacity < 1 ? clear_mask : solid_mask);
    attach(geometry);
  }
  void add(const Balls& b) {
    RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_SPHERE_POINT);
    auto* centers = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 4 * sizeof(float), b.centers.size()));
    for (std::size_t i = 0; i < b.centers.size(); i++) {
      std::copy_n(b.centers[i].data(), 3, centers + 4 * i);
      centers[4 * i + 3] = b.radii[i];
    }
    rtcSetGeometryMask(geometry, solid_mask);
    attach(geometry);
  }
  /// Numbers are those of surfaces, then of balls.
  void attach(RTCGeometry geometry) {
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
  }

  static RTCRayHit query(const Vector3f& origin, const Vector3f& direction, float from, float to, unsigned mask) {
    RTCRayHit hit;
    hit.ray = {origin.x(), origin.y(), origin.z(), from, direction.x(), direction.y(), direction.z(), 0, to, mask, 0, 0};
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    return hit;
  }

  bool blocked(const Vector3f& from, const Vector3f& direction, float length) const {
    RTCRay ray = query(from, direction, 0, length, solid_mask).ray;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene_, &context, &ray);
    return ray.tfar < 0;
  }

  /// Where a ray that comes from above meets the floor.
  float to_floor(const Camera::Ray& ray) const {
    constexpr float never = std::numeric_limits<float>::infinity();
    if (!stage_.ground) return never;
    const double speed = ray.direction.dot(stage_.ground->normal),
                 height = (ray.origin - stage_.ground->point).dot(stage_.ground->normal);
    return speed < 0 && height > 0 ? float(-height / speed) : never;
  }

  /// Colour and normal, towards the ray's origin, of what was hit.
  Vector3f surface(const RTCRayHit& hit, const Vector3f& direction, Vector3f& normal) const {
    normal = Vector3f(hit.hit.Ng_x, hit.hit.Ng_y, hit.hit.Ng_z).stableNormalized();
    const unsigned number = hit.hit.geomID;
    Vector3f color;
    if (number >= stage_.surfaces.size()) {
      color = stage_.balls[number - stage_.surfaces.size()].colors[hit.hit.primID];
    } else {
      const Triangles& t = stage_.surfaces[number];
      const std::uint32_t* const corner = t.corners.data() + 3 * std::size_t(hit.hit.primID);
      const auto between = [&](const std::vector<Vector3f>& values) -> Vector3f {
        return (1 - hit.hit.u - hit.hit.v) * values[corner[0]] + hit.hit.u * values[corner[1]] + hit.hit.v * values[corner[2]];
      };
      color = t.colors.size() == 1 ? t.colors[0] : between(t.colors);
      if (!t.normals.empty())
        if (const Vector3f smooth = between(t.normals); smooth.squaredNorm() > 0.01f) normal = smooth.normalized();
    }
    if (normal.dot(direction) > 0) normal = -normal;
    return color;
  }

  float open_sky(const Vector3f& place, const Vector3f& normal, Sequence& sequence) const {
    int open = 0;
    for (int n = 0; n < occlusion_rays; n++)
      open += !blocked(place, around(normal, sequence.next(), 0.5f, 1), 0.35f * float(stage_.size));
    return float(open) / occlusion_rays;
  }

  bool in_sun(const Vector3f& place, Sequence& sequence) const {
    return !blocked(place, around(to_light_, sequence.next(), 0.5f, 0.06f), 20 * float(stage_.size));
  }

  Vector3f lit(const Vector3f& own, const Vector3f& place, const Vector3f& normal, const Vector3f& direction,
               Sequence& sequence, bool shadows) const {
    const Vector3f off = place + 2e-3f * float(stage_.size) * normal;
    const float facing = std::max(0.f, normal.dot(to_light_));
    const float sun = facing > 0 && (!shadows || in_sun(off, sequence)) ? facing : 0;
    const float sky = (0.75f + 0.25f * normal.dot(stage_.up.cast<float>())) * (shadows ? open_sky(off, normal, sequence) : 1);
    const Vector3f half = (to_light_ - direction).normalized();
    const float shine = sun > 0 ? 0.05f * std::pow(std::max(0.f, normal.dot(half)), 40.f) : 0;
    return own * (0.1f + 0.36f * sky + 0.5f * sun) + Vector3f::Constant(shine);
  }

  float floor_light(const Vector3f& place, const Vector3f& normal, Sequence& sequence) const {
    const Vector3f off = place + 1e-3f * float(stage_.size) * normal;
    return 0.1f + 0.45f * open_sky(off, normal, sequence) + 0.45f * float(in_sun(off, sequence));
  }

  const Stage& stage_;
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
  Vector3f to_light_;
};

}  // namespace

Image trace(const Stage& stage, const Camera& camera, int width, int height, int samples) {
  const Tracer tracer(stage, camera);
  Image image(width, height);
  const Vector3f above = to_linear({232, 237, 243}), below = to_linear({250, 250, 250});
  tbb::parallel_for(tbb::blocked_range2d<int>(0, height, 16, 0, width, 16), [&](const auto& tile) {
    for (int y = tile.rows().begin(); y < tile.rows().end(); y++)
      for (int x = tile.cols().begin(); x < tile.cols().end(); x++) {
        Sequence sequence{std::uint32_t(x), std::uint32_t(y)};
        const float down = (float(y) + 0.5f) / float(height);
        const Vector3f background = stage.flat ? Vector3f::Ones() : Vector3f((1 - down) * above + down * below);
        Vector3f sum = Vector3f::Zero();
        for (int v = 0; v < samples; v++)
          for (int u = 0; u < samples; u++) {
            const double px = x + (u + 0.5) / samples, py = y + (v + 0.5) / samples;
            sum += tracer.along(camera.ray((2 * px - width) / height, 1 - 2 * py / height), background, sequence);
          }
        image.at(x, y) = from_linear(sum / float(samples * samples));
      }
  });
  return image;
}

}  // namespace cleave::render
