#include "render/painter.hpp"

#include "common/error.hpp"
#include "output/color.hpp"
#include "output/names.hpp"
#include "output/particle_surface.hpp"
#include "render/text.hpp"
#include "render/tracer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace cleave::render {
namespace {

constexpr double left_out = 0.005;        ///< part of the particles on each side, of bounds
constexpr double values_left_out = 0.01;  ///< the same, of ranges of values
constexpr std::size_t enough = 20000;     ///< particles for a quantile
constexpr Color collider_color{120, 130, 145}, text_color{50, 50, 55};

/// Bounds of the middle part of a list.
std::pair<double, double> middle(std::vector<double>& list, double part) {
  const auto at = [&](double quantile) {
    const auto place = list.begin() + std::ptrdiff_t(std::llround(quantile * double(list.size() - 1)));
    std::nth_element(list.begin(), place, list.end());
    return *place;
  };
  const double low = at(part);
  return {low, at(1 - part)};
}

float size_of(const float* values, int components) {
  if (components == 1) return values[0];
  float sum = 0;
  for (int c = 0; c < components; c++)  // the last three of a symmetric tensor stand for two entries each
    sum += (components == 6 && c > 2 ? 2.f : 1.f) * values[c] * values[c];
  return std::sqrt(sum);
}

bool is_category(const std::string& color) { return color == "body" || color == "piece"; }

Box widened(const Box& box, double part) {
  const Vector3 more = Vector3::Constant(part * box.diagonal().norm());
  return {box.min() - more, box.max() + more};
}

}  // namespace

Painter::Painter(Look look, Surroundings surroundings)
    : look_(std::move(look)),
      surroundings_(std::move(surroundings)),
      least_(std::numeric_limits<double>::infinity()),
      most_(-std::numeric_limits<double>::infinity()) {
  if (look_.palette == Palette::automatic) look_.palette = look_.color == "damage" ? Palette::heat : Palette::viridis;
  if (look_.color == "velocity") unit_ = "m/s";
  if (surroundings_.dimension == 2) look_.view = {0, 0};
}

Painter::~Painter() = default;

Box Painter::box_of(const output::ParticleFrame& frame) const {
  Box box;
  const output::ParticleFrame& placed = look_.material_space && rest_ ? *rest_ : frame;
  const auto extend = [&](std::size_t count, const auto& place) {
    if (count == 0) return;
    const std::size_t stride = std::max<std::size_t>(1, count / enough);
    std::vector<double> along[3];
    for (std::size_t i = 0; i < count; i += stride)
      if (const Vector3 x = place(i); x.allFinite())
        for (int a = 0; a < 3; a++) along[a].push_back(x[a]);
    if (along[0].empty()) return;
    Vector3 low, high;
    for (int a = 0; a < 3; a++) std::tie(low[a], high[a]) = middle(along[a], left_out);
    box.extend(low);
    box.extend(high);
  };
  for (std::size_t body = 0; body < placed.bodies.size(); body++) {
    const std::size_t begin = placed.body_begin(body);
    extend(placed.body_ends[body] - begin, [&](std::size_t i) { return output::position_of(placed, begin + i); });
  }
  for (const output::BodyMesh& mesh : frame.meshes)
    if (!look_.points && !look_.material_space)
      extend(mesh.vertex_count(), [&](std::size_t i) { return Vector3(mesh.vertices.data() + 3 * i); });
  return box.isEmpty() ? box : widened(box, 0.02);
}

void Painter::survey(const output::ParticleFrame& frame) {
  bounds_.extend(box_of(frame));
  if (is_category(look_.color) || look_.range) return;
  const std::vector<float> all = values(frame);
  std::vector<double> some;
  for (std::size_t i = 0, stride = std::max<std::size_t>(1, all.size() / enough); i < all.size(); i += stride)
    if (std::isfinite(all[i])) some.push_back(double(all[i]));
  for (const output::BodyMesh& mesh : frame.meshes) {
    if (look_.color == "damage") some.insert(some.end(), mesh.damage.begin(), mesh.damage.end());
    for (std::size_t i = 0; look_.color == "velocity" && i + 3 <= mesh.velocity.size(); i += 3)
      some.push_back(double(size_of(mesh.velocity.data() + i, 3)));
  }
  if (some.empty()) return;
  const auto [low, high] = middle(some, values_left_out);
  least_ = std::min(least_, low);
  most_ = std::max(most_, high);
}

void Painter::follow(const output::ParticleFrame& frame) { bounds_ = box_of(frame); }

void Painter::rest(const output::ParticleFrame& frame) {
  rest_ = frame;
  rest_surfaces_.clear();
}

std::pair<double, double> Painter::range() const {
  if (look_.range) return *look_.range;
  if (look_.color == "damage") return {0, 1};
  if (!(least_ <= most_)) return {0, 1};
  const double low = least_ >= 0 && least_ < 0.5 * most_ ? 0 : least_;
  return {low, most_ > low ? most_ : low + std::max(1e-6, 1e-3 * std::abs(low))};
}

Color Painter::color_of(double value) const {
  if (is_category(look_.color)) return output::color_of_number(std::int64_t(value));
  const auto [low, high] = range();
  return palette_color(look_.palette, (value - low) / (high - low));
}

std::vector<float> Painter::values(const output::ParticleFrame& frame) const {
  std::vector<float> result(frame.particles(), 0.f);
  if (look_.color == "body") {
    for (std::size_t i = 0; i < result.size(); i++) result[i] = float(frame.body_of(i));
    return result;
  }
  if (look_.color == "velocity") {
    for (std::size_t i = 0; i < result.size(); i++) result[i] = frame.velocities[i].norm();
    return result;
  }
  for (const output::Attribute& a : frame.attributes)
    if (a.name == look_.color)
      for (std::size_t i = 0; i < result.size(); i++)
        result[i] = size_of(a.values.data() + i * std::size_t(a.components), a.components);
  return result;
}

void Painter::add_mesh(const output::ParticleFrame& frame, const output::BodyMesh& mesh, const std::vector<float>& values,
                       Stage& stage) const {
  Triangles t;
  for (std::size_t i = 0; i < mesh.vertex_count(); i++)
    t.vertices.push_back(Vector3(mesh.vertices.data() + 3 * i).cast<float>());
  t.corners = mesh.triangles;
  std::vector<float> at;
  if (look_.color == "damage" && !mesh.damage.empty())
    at = mesh.damage;
  else if (look_.color == "piece")
    at.assign(mesh.piece.begin(), mesh.piece.end());
  else if (look_.color == "body")
    at.assign(mesh.vertex_count(), float(mesh.body));
  else if (look_.color == "velocity" && !mesh.velocity.empty())
    for (std::size_t i = 0; i < mesh.vertex_count(); i++) at.push_back(size_of(mesh.velocity.data() + 3 * i, 3));
  else if (frame.particles() > 0)
    at = output::interpolate(frame, std::size_t(mesh.body), values, 1, t.vertices);
  else
    at.assign(mesh.vertex_count(), 0);
  for (const float value : at) t.colors.push_back(to_linear(color_of(double(value))));
  if (!t.corners.empty()) stage.surfaces.push_back(std::move(t));
}

void Painter::add_body(const output::ParticleFrame& frame, std::size_t body, const std::vector<float>& values, Stage& stage) {
  const bool flat = surroundings_.dimension == 2;
  const auto add_balls = [&](const auto& shown, float spacing_part) {
    Balls balls;
    const float radius = spacing_part * float(output::particle_spacing(frame, body));
    for (std::size_t i = frame.body_begin(body); i < frame.body_ends[body]; i++) {
      const Vector3 x = output::position_of(frame, i);
      if (!x.allFinite() || !shown(i)) continue;
      balls.centers.push_back(x.cast<float>());
      balls.radii.push_back(std::max(radius, 1e-12f));
      balls.colors.push_back(to_linear(color_of(double(values[i]))));
    }
    if (!balls.centers.empty()) stage.balls.push_back(std::move(balls));
  };
  const auto all = [](std::size_t) { return true; };
  if (flat || look_.points) return add_balls(all, flat ? 1.f : 0.62f);
  if (look_.material_space) {
    const auto damage =
        std::find_if(frame.attributes.begin(), frame.attributes.end(), [](const auto& a) { return a.name == "damage"; });
    if (damage == frame.attributes.end()) return add_balls(all, 0.62f);
    return add_balls([&](std::size_t i) { return damage->values[i] >= 0.5f; }, 0.62f);
  }
  output::SurfaceMesh surface = output::surface_mesh(frame, body);
  if (surface.triangles.empty()) return;
  Triangles t;
  if (is_category(look_.color) && look_.color == "body") {
    t.colors = {to_linear(color_of(double(body)))};
  } else if (look_.color == "piece") {
    // Numbers of neighbours have no mean: colours have.
    std::vector<float> colors;
    for (std::size_t i = 0; i < frame.particles(); i++) {
      const Eigen::Vector3f c = to_linear(color_of(double(values[i])));
      colors.insert(colors.end(), c.data(), c.data() + 3);
    }
    const std::vector<float> at = output::interpolate(frame, body, colors, 3, surface.vertices);
    for (std::size_t i = 0; i < at.size(); i += 3) t.colors.emplace_back(at[i], at[i + 1], at[i + 2]);
  } else {
    for (const float value : output::interpolate(frame, body, values, 1, surface.vertices))
      t.colors.push_back(to_linear(color_of(double(value))));
  }
  t.vertices = std::move(surface.vertices);
  t.normals = std::move(surface.normals);
  t.corners = std::move(surface.triangles);
  stage.surfaces.push_back(std::move(t));
}

void Painter::add_colliders(double time, Stage& stage) {
  if (!look_.colliders || bounds_.isEmpty() || look_.material_space) return;
  const Box within = widened(bounds_, 0.12);
  if (shapes_.empty())
    for (const auto& collider : surroundings_.colliders)
      shapes_.push_back(scene::build_shape(collider.shape, bounds_.diagonal().norm() / 200));
  if (resting_.empty() || !resting_in_.isApprox(within)) {
    resting_.clear();
    resting_in_ = within;
  }
  for (std::size_t c = 0; c < shapes_.size(); c++) {
    const config::Collider& collider = surroundings_.colliders[c];
    const auto pose = collider.motion.at(time);
    if (collider.shape.type == scene::ShapeSpec::Type::half_space && surroundings_.dimension == 3) {
      const Vector3 normal = pose.rotation * (collider.shape.rotation * collider.shape.axis).normalized(),
                    start = bounds_.center(), point = start - shapes_[c]->distance(pose.to_scene(start)) * normal;
      if (normal.dot(stage.up) > 0.94 && !stage.ground) {
        stage.ground = {point, normal};
        continue;
      }
    }
    Triangles surface;
    if (collider.motion.at_rest() && resting_.contains(c))
      surface = resting_.at(c);
    else
      surface = collider_surface(*shapes_[c], pose, within);
    if (collider.motion.at_rest()) resting_[c] = surface;
    if (surface.corners.empty()) continue;
    surface.colors = {to_linear(collider_color)};
    surface.opacity = 0.3f;
    stage.surfaces.push_back(std::move(surface));
  }
}

Camera Painter::camera() const {
  const double margin = look_.labels && !is_category(look_.color) ? 0.12 : 0;
  return fit_camera(look_.view, bounds_, surroundings_.up_axis, double(look_.width) / look_.height, margin, look_.zoom,
                    surroundings_.dimension == 2);
}

Image Painter::paint(const output::ParticleFrame& given) {
  if (bounds_.isEmpty()) follow(given);
  if (bounds_.isEmpty()) bounds_ = Box(Vector3::Zero(), Vector3::Ones());
  output::ParticleFrame moved;
  if (look_.material_space && rest_) {
    if (rest_->particles() != given.particles()) throw InputError("error: the first frame has not the particles of the others");
    moved = given;
    moved.positions = rest_->positions;
  }
  const output::ParticleFrame& frame = look_.material_space && rest_ ? moved : given;
  for (const output::Attribute& a : frame.attributes)
    if (a.name == look_.color) unit_ = a.unit;

  Stage stage;
  stage.flat = surroundings_.dimension == 2;
  stage.up = surroundings_.up_axis == 2 ? Vector3::UnitZ() : Vector3::UnitY();
  stage.middle = bounds_.center();
  stage.size = std::max(bounds_.diagonal().norm() / 2, 1e-9);
  const std::vector<float> of_particles = values(frame);
  std::vector<bool> has_mesh(frame.bodies.size(), false);
  if (!look_.points && !look_.material_space)
    for (const output::BodyMesh& mesh : frame.meshes) {
      add_mesh(frame, mesh, of_particles, stage);
      has_mesh[std::size_t(mesh.body)] = true;
    }
  for (std::size_t body = 0; body < frame.bodies.size(); body++)
    if (!has_mesh[body]) add_body(frame, body, of_particles, stage);
  if (look_.material_space && rest_ && surroundings_.dimension == 3) {
    if (rest_surfaces_.empty())
      for (std::size_t body = 0; body < rest_->bodies.size(); body++)
        if (output::SurfaceMesh s = output::surface_mesh(*rest_, body, 2); !s.triangles.empty())
          rest_surfaces_.push_back(
              {std::move(s.vertices), std::move(s.normals), {to_linear(collider_color)}, std::move(s.triangles), 0.2f});
    stage.surfaces.insert(stage.surfaces.end(), rest_surfaces_.begin(), rest_surfaces_.end());
  }
  add_colliders(frame.time, stage);
  Image image = trace(stage, camera(), look_.width, look_.height, look_.samples);
  if (look_.labels) label(image, frame);
  return image;
}

void Painter::label(Image& image, const output::ParticleFrame& frame) const {
  const int size = std::max(11, look_.height / 36), gap = size / 2;
  draw_text(image, fmt::format("t = {:.4g} s", frame.time), size, look_.height - size, size, text_color);
  if (is_category(look_.color)) return;
  const auto [low, high] = range();
  std::vector<std::string> ticks;
  int widest = 0;
  for (int tick = 0; tick <= 4; tick++) {
    ticks.push_back(fmt::format("{:.3g}", std::lerp(low, high, tick / 4.0)));
    widest = std::max(widest, text_width(ticks.back(), size));
  }
  const int width = size, tall = look_.height / 2, top = look_.height / 4, left = look_.width - widest - width - 2 * gap;
  for (int y = 0; y < tall; y++)
    for (int x = 0; x < width; x++)
      image.at(std::clamp(left + x, 0, image.width - 1), top + y) = palette_color(look_.palette, 1 - (y + 0.5) / tall);
  for (int tick = 0; tick <= 4; tick++)
    draw_text(image, ticks[std::size_t(tick)], left + width + gap, top + (4 - tick) * tall / 4 + size / 3, size, text_color);
  const std::string name = unit_.empty() || unit_ == "1" ? look_.color : look_.color + " [" + unit_ + "]";
  draw_text(image, name, std::min(left, look_.width - text_width(name, size) - gap), top - size, size, text_color);
}

}  // namespace cleave::render
