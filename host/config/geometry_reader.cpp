#include "config/geometry_reader.hpp"

#include "config/angles.hpp"
#include "plugins/parameters.hpp"

namespace cleave::config {
namespace {

using scene::ShapeSpec;

constexpr int deepest_shape = 32;

VectorForm point_form() { return {.unit = "m"}; }

/// In 2D, how far a shape reaches along z: so far that its sides never come nearer than its outline.
double thickness(double width) { return 4 * width; }

void read_center(TableReader& table, ShapeSpec& shape) {
  if (const auto center = table.vector("center", point_form())) shape.center = *center;
}

/// Axis and height of a cylinder-like shape of outer radius `radius`.
void read_axis_and_height(TableReader& table, ShapeSpec& shape) {
  if (const auto axis = table.direction("axis")) shape.axis = *axis;
  const bool seen_from_above = table.context().dimension == 2 && shape.axis.head<2>().isZero();
  if (seen_from_above)
    shape.height = table.number("height", "m", Range::positive()).value_or(thickness(shape.radius));
  else
    shape.height = table.required_number("height", "m", Range::positive());
}

void read_box(TableReader& table, ShapeSpec& shape) {
  read_center(table, shape);
  if (!table.require("size", table.context().dimension == 2 ? "2 edge lengths (m)" : "3 edge lengths (m)")) return;
  const auto size = table.vector("size", {.unit = "m", .range = Range::positive()});
  if (!size) return;
  shape.size = *size;
  if (shape.size.z() == 0) shape.size.z() = thickness(size->head<2>().maxCoeff());
}

void read_torus(TableReader& table, ShapeSpec& shape) {
  read_center(table, shape);
  if (const auto axis = table.direction("axis")) shape.axis = *axis;
  shape.radius = table.required_number("radius", "m", Range::positive());
  shape.tube_radius = table.required_number("tube_radius", "m", Range::positive());
}

void read_tube(TableReader& table, ShapeSpec& shape) {
  read_center(table, shape);
  shape.radius = table.required_number("radius", "m", Range::positive());
  shape.inner_radius = table.required_number("inner_radius", "m", Range::positive());
  if (shape.radius > 0 && shape.inner_radius >= shape.radius)
    table.error_at("inner_radius", "'inner_radius' must be less than 'radius', " + plugins::number_text(shape.radius) +
                                       " m, is " + plugins::number_text(shape.inner_radius));
  read_axis_and_height(table, shape);
}

void read_half_space(TableReader& table, ShapeSpec& shape) {
  if (const auto point = table.vector("point", point_form())) shape.center = *point;
  if (table.require("normal", "the direction out of the half-space"))
    if (const auto normal = table.direction("normal")) shape.axis = *normal;
}

void read_size_and_center(TableReader& table, ShapeSpec& shape) {
  shape.file_size = table.number("file_size", "m", Range::not_negative()).value_or(0);
  const bool has_center = table.has("center");
  shape.centered = table.boolean("centered").value_or(has_center);
  if (has_center && !shape.centered) table.refuse("center", "is only used with centered = true");
  read_center(table, shape);
}

void read_file_shape(TableReader& table, ShapeSpec& shape) {
  const bool mesh = shape.type == ShapeSpec::Type::mesh;
  if (table.require("file", mesh ? "a mesh of type .obj, .ply or .stl" : "a level set of type .vdb"))
    if (const auto file =
            table.file("file", mesh ? std::vector<std::string>{".obj", ".ply", ".stl"} : std::vector<std::string>{".vdb"}))
      shape.file = *file;
  if (!mesh) shape.grid = table.text("grid").value_or("");
  read_size_and_center(table, shape);
}

std::optional<ShapeSpec> read_shape_at(TableReader table, int depth);

void read_children(TableReader& table, ShapeSpec& shape, int depth) {
  const bool difference = shape.type == ShapeSpec::Type::difference;
  if (!table.require("shapes", "a list of shapes")) return;
  const toml::node* node = table.find("shapes");
  auto children = table.tables("shapes", "shape");
  const std::size_t least = difference ? 2 : 1;
  if (node->is_array() && node->as_array()->size() < least)
    table.error_at("shapes", difference ? "a difference needs at least 2 'shapes': the first less all others"
                                        : table.what() + " needs at least one of 'shapes'");
  for (TableReader& child : children)
    if (auto spec = read_shape_at(std::move(child), depth + 1)) shape.children.push_back(std::move(*spec));
}

void read_scale(TableReader& table, ShapeSpec& shape) {
  const toml::node* node = table.find("scale");
  if (!node) return;
  if (node->is_array()) {
    if (const auto scale = table.vector("scale", {.unit = "1", .range = Range::positive(), .missing_z = 1}))
      shape.scale = *scale;
  } else if (const auto scale = table.number("scale", "1", Range::positive())) {
    shape.scale = Vector3::Constant(*scale);
  }
}

void read_rotation_matrix(TableReader& table, ShapeSpec& shape) {
  const auto values = table.numbers("matrix", "1", 9, 9);
  if (!values) return;
  const Matrix3 matrix = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(values->data());
  if (!(matrix * matrix.transpose()).isIdentity(1e-9) || matrix.determinant() < 0)
    table.error_at("matrix", "'matrix' must be a rotation: orthonormal rows, determinant 1");
  shape.rotation = matrix;
}

/// rotate = 30 (2D, about z), { axis = [..], angle = 30 } or { matrix = [nine numbers] }.
void read_rotate(TableReader& table, ShapeSpec& shape) {
  const toml::node* node = table.find("rotate");
  if (!node) return;
  if (table.context().dimension == 2 && node->is_number()) {
    if (const auto angle = table.number("rotate", "degrees"))
      shape.rotation = Eigen::AngleAxisd(radians(*angle), Vector3::UnitZ()).toRotationMatrix();
    return;
  }
  if (!node->is_table()) {
    table.error_at("rotate", "'rotate' must be " + std::string(table.context().dimension == 2 ? "a number (degrees) or " : "") +
                                 "a table as { axis = [0, 0, 1], angle = 30 } (degrees), is " + found(*node));
    return;
  }
  TableReader rotate = *table.table("rotate", "'rotate'");
  if (rotate.has("matrix")) {
    read_rotation_matrix(rotate, shape);
  } else {
    std::optional<Vector3> axis;
    if (rotate.require("axis", "the direction to turn about")) axis = rotate.direction("axis");
    const double angle = rotate.required_number("angle", "degrees");
    if (axis) shape.rotation = Eigen::AngleAxisd(radians(angle), *axis).toRotationMatrix();
  }
  rotate.finish();
}

void read_transform(TableReader& table, ShapeSpec& shape) {
  read_scale(table, shape);
  read_rotate(table, shape);
  if (const auto translation = table.vector("translate", point_form())) shape.translation = *translation;
}

std::optional<ShapeSpec> read_shape_at(TableReader table, int depth) {
  if (depth > deepest_shape) {
    table.error(table.where(), "shapes are nested more than " + std::to_string(deepest_shape) + " deep");
    return std::nullopt;
  }
  if (!table.require("type", "one of " + list_text(shape_names(), "\""))) return std::nullopt;
  const auto type = table.choice("type", shape_names());
  if (!type) return std::nullopt;
  table.rename(shape_names()[*type]);

  ShapeSpec shape;
  shape.type = ShapeSpec::Type(*type);
  switch (shape.type) {
    case ShapeSpec::Type::box:
      read_box(table, shape);
      break;
    case ShapeSpec::Type::sphere:
      read_center(table, shape);
      shape.radius = table.required_number("radius", "m", Range::positive());
      break;
    case ShapeSpec::Type::cylinder:
    case ShapeSpec::Type::capsule:
      read_center(table, shape);
      shape.radius = table.required_number("radius", "m", Range::positive());
      read_axis_and_height(table, shape);
      break;
    case ShapeSpec::Type::torus:
      read_torus(table, shape);
      break;
    case ShapeSpec::Type::tube:
      read_tube(table, shape);
      break;
    case ShapeSpec::Type::half_space:
      read_half_space(table, shape);
      break;
    case ShapeSpec::Type::mesh:
    case ShapeSpec::Type::level_set:
      read_file_shape(table, shape);
      break;
    case ShapeSpec::Type::set_union:
    case ShapeSpec::Type::difference:
    case ShapeSpec::Type::intersection:
      read_children(table, shape, depth);
      break;
  }
  read_transform(table, shape);
  table.finish();
  return shape;
}

void read_keyframes(TableReader& table, scene::RigidMotion& motion) {
  for (const char* key : {"velocity", "angular_velocity", "start", "end"})
    table.refuse(key, "cannot be given together with 'keyframes'");
  const toml::node* node = table.find("keyframes");
  if (node->is_array() && node->as_array()->empty()) table.error_at("keyframes", "'keyframes' must not be empty");
  for (TableReader& entry : table.tables("keyframes", "keyframe")) {
    scene::RigidMotion::Keyframe keyframe;
    keyframe.time = entry.required_number("time", "s", Range::not_negative());
    if (const auto translation = entry.vector("translation", {.unit = "m", .planar = true}))
      keyframe.translation = *translation;
    if (const auto rotation = read_rotation(entry, "rotation", "degrees")) keyframe.rotation = *rotation;
    entry.finish();
    if (!motion.keyframes.empty() && entry.has("time") && keyframe.time <= motion.keyframes.back().time)
      entry.error_at("time", "keyframes must come in order: 'time' must be greater than " +
                                 plugins::number_text(motion.keyframes.back().time) + " s, is " +
                                 plugins::number_text(keyframe.time));
    motion.keyframes.push_back(keyframe);
  }
}

}  // namespace

const std::vector<std::string>& shape_names() {
  static const std::vector<std::string> names = {"box",        "sphere", "cylinder",  "capsule", "torus",      "tube",
                                                 "half-space", "mesh",   "level-set", "union",   "difference", "intersection"};
  return names;
}

void read_place_of_file(TableReader& table, ShapeSpec& file) {
  read_size_and_center(table, file);
  read_transform(table, file);
}

std::optional<ShapeSpec> read_shape(TableReader table) { return read_shape_at(std::move(table), 1); }

std::optional<Vector3> read_rotation(TableReader& table, std::string_view key, const std::string& unit) {
  if (table.context().dimension == 3) {
    const auto vector = table.vector(key, {.unit = unit});
    return vector ? std::optional(radians(*vector)) : std::nullopt;
  }
  const auto about_z = table.number(key, unit);
  return about_z ? std::optional(Vector3(0, 0, radians(*about_z))) : std::nullopt;
}

scene::RigidMotion read_motion(TableReader table) {
  scene::RigidMotion motion;
  if (const auto center = table.vector("center", point_form())) motion.center = *center;
  if (table.has("keyframes")) {
    read_keyframes(table, motion);
  } else {
    if (const auto velocity = table.vector("velocity", {.unit = "m/s", .planar = true})) motion.velocity = *velocity;
    if (const auto spin = read_rotation(table, "angular_velocity", "degrees/s")) motion.angular_velocity = *spin;
    motion.start = table.number("start", "s", Range::not_negative()).value_or(0);
    if (const auto end = table.number("end", "s")) {
      motion.end = *end;
      if (motion.end <= motion.start)
        table.error_at("end", "'end' must be greater than 'start', " + plugins::number_text(motion.start) + " s, is " +
                                  plugins::number_text(motion.end));
    }
  }
  table.finish();
  return motion;
}

}  // namespace cleave::config
