#include "config/catalog.hpp"

#include "config/angles.hpp"
#include "config/field_reader.hpp"
#include "config/geometry_reader.hpp"
#include "config/tetrahedra_reader.hpp"
#include "plugins/parameters.hpp"

#include <cmath>
#include <sstream>

namespace cleave::config {
namespace {

using scene::ShapeSpec;

/// The shortest number that reads back to the same bits, always recognisable as not an integer.
std::string number(double value) {
  std::string text = plugins::number_text(value);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04X", unsigned(static_cast<unsigned char>(c)));
      out += escape;
    } else {
      out += c;
    }
  }
  return out + "\"";
}

template <class Range, class Text>
std::string list(const Range& values, Text&& text) {
  std::string out = "[";
  for (const auto& value : values) out += (out.size() > 1 ? ", " : "") + text(value);
  return out + "]";
}

std::string vector(const Vector3& v) { return "[" + number(v.x()) + ", " + number(v.y()) + ", " + number(v.z()) + "]"; }

std::string words(const std::vector<std::string>& texts) { return list(texts, quoted); }

std::string value_text(const plugins::Value& value) {
  struct Visitor {
    std::string operator()(double x) const { return number(x); }
    std::string operator()(std::int64_t i) const { return std::to_string(i); }
    std::string operator()(bool flag) const { return flag ? "true" : "false"; }
    std::string operator()(const std::string& text) const { return quoted(text); }
    std::string operator()(const std::vector<double>& values) const { return list(values, number); }
  };
  return std::visit(Visitor{}, value);
}

/// "{ a = 1.0, b = 2.0 }"
class InlineTable {
 public:
  InlineTable& add(const std::string& key, const std::string& value) {
    text_ += (text_.empty() ? "" : ", ") + key + " = " + value;
    return *this;
  }
  bool empty() const { return text_.empty(); }
  std::string text() const { return text_.empty() ? "{}" : "{ " + text_ + " }"; }

 private:
  std::string text_;
};

std::string rotation(const Vector3& angle, int dimension) {
  return dimension == 2 ? number(degrees(angle.z())) : vector(degrees(angle));
}

void add_place_of_file(InlineTable& table, const ShapeSpec& file) {
  table.add("file_size", number(file.file_size)).add("centered", file.centered ? "true" : "false");
  if (file.centered) table.add("center", vector(file.center));
}

void add_transform(InlineTable& table, const ShapeSpec& shape) {
  if (shape.scale != Vector3::Ones()) table.add("scale", vector(shape.scale));
  if (shape.rotation != Matrix3::Identity()) {
    const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows = shape.rotation;
    table.add("rotate", InlineTable().add("matrix", list(std::vector<double>(rows.data(), rows.data() + 9), number)).text());
  }
  if (!shape.translation.isZero(0)) table.add("translate", vector(shape.translation));
}

std::string shape_text(const ShapeSpec& shape) {
  using Type = ShapeSpec::Type;
  InlineTable table;
  table.add("type", quoted(shape_names()[std::size_t(shape.type)]));
  switch (shape.type) {
    case Type::box:
      table.add("center", vector(shape.center)).add("size", vector(shape.size));
      break;
    case Type::sphere:
      table.add("center", vector(shape.center)).add("radius", number(shape.radius));
      break;
    case Type::tube:
    case Type::cylinder:
    case Type::capsule:
      table.add("center", vector(shape.center)).add("axis", vector(shape.axis)).add("radius", number(shape.radius));
      if (shape.type == Type::tube) table.add("inner_radius", number(shape.inner_radius));
      table.add("height", number(shape.height));
      break;
    case Type::torus:
      table.add("center", vector(shape.center)).add("axis", vector(shape.axis)).add("radius", number(shape.radius));
      table.add("tube_radius", number(shape.tube_radius));
      break;
    case Type::half_space:
      table.add("point", vector(shape.center)).add("normal", vector(shape.axis));
      break;
    case Type::mesh:
    case Type::level_set:
      table.add("file", quoted(shape.file.string()));
      if (shape.type == Type::level_set) table.add("grid", quoted(shape.grid));
      add_place_of_file(table, shape);
      break;
    case Type::set_union:
    case Type::difference:
    case Type::intersection:
      table.add("shapes", list(shape.children, shape_text));
      break;
  }
  add_transform(table, shape);
  return table.text();
}

std::string tetrahedra_text(const scene::TetrahedraSpec& tetrahedra) {
  InlineTable table;
  if (tetrahedra.file) {
    table.add("file", quoted(tetrahedra.file->file.string()));
    add_place_of_file(table, *tetrahedra.file);
    add_transform(table, *tetrahedra.file);
  } else {
    table.add("edge_length", number(tetrahedra.edge_length))
        .add("method", quoted(method_names()[std::size_t(tetrahedra.method)]));
  }
  return table.text();
}

std::string motion_text(const scene::RigidMotion& motion, int dimension) {
  InlineTable table;
  table.add("center", vector(motion.center));
  if (!motion.keyframes.empty()) {
    table.add("keyframes", list(motion.keyframes, [&](const scene::RigidMotion::Keyframe& keyframe) {
                return InlineTable()
                    .add("time", number(keyframe.time))
                    .add("translation", vector(keyframe.translation))
                    .add("rotation", rotation(keyframe.rotation, dimension))
                    .text();
              }));
    return table.text();
  }
  table.add("velocity", vector(motion.velocity)).add("angular_velocity", rotation(motion.angular_velocity, dimension));
  table.add("start", number(motion.start));
  if (std::isfinite(motion.end)) table.add("end", number(motion.end));
  return table.text();
}

std::string law_text(const PluginUse& use, const PluginCatalog& catalog) {
  InlineTable table;
  table.add("plugin", quoted(use.id));
  const plugins::Description* law = catalog.find(use.id);
  for (const auto& [key, value] : use.parameters)
    if (!law) table.add(key, value_text(value));
  if (!law) return table.text();
  for (const plugins::Parameter& parameter : law->parameters) {
    const auto given = use.parameters.find(parameter.key);
    if (given != use.parameters.end())
      table.add(parameter.key, value_text(given->second));
    else if (!parameter.required && !parameter.in_set && !plugins::problem_with(parameter, parameter.default_value))
      table.add(parameter.key, value_text(parameter.default_value));
  }
  return table.text();
}

std::string fibers_text(const Fibers& fibers) {
  using Layout = Fibers::Layout;
  InlineTable table;
  table.add("layout", quoted(layout_names()[std::size_t(fibers.layout)]));
  if (fibers.layout == Layout::uniform) table.add("direction", vector(fibers.direction));
  if (fibers.center) table.add("center", vector(*fibers.center));
  if (fibers.axis) table.add("axis", vector(*fibers.axis));
  if (fibers.layout == Layout::helical) table.add("angle", number(degrees(fibers.angle)));
  if (fibers.layout == Layout::grid) {
    table.add("file", quoted(fibers.file.string())).add("grid", quoted(fibers.grid));
    if (!fibers.second_grid.empty()) table.add("second_grid", quoted(fibers.second_grid));
  }
  if (fibers.layout == Layout::flow)
    table.add("inflow", shape_text(*fibers.inflow)).add("outflow", shape_text(*fibers.outflow));
  if (fibers.second) table.add("second", vector(*fibers.second));
  return table.text();
}

std::string variation_text(const scene::VariationSpec& variation) {
  return InlineTable()
      .add("pattern", quoted(pattern_names()[std::size_t(variation.pattern)]))
      .add("size", number(variation.size))
      .add("minimum", number(variation.minimum))
      .add("maximum", number(variation.maximum))
      .add("seed", std::to_string(variation.seed))
      .text();
}

void write_simulation(std::ostream& out, const Simulation& simulation) {
  static constexpr const char* transfers[] = {"apic", "flip", "pic"};
  static constexpr const char* integrators[] = {"symplectic", "implicit", "auto"};
  out << "[simulation]\n"
      << "dimension = " << simulation.dimension << "\n"
      << "cell_size = " << number(simulation.cell_size) << "  # m\n"
      << "end_time = " << number(simulation.end_time) << "  # s\n"
      << "frame_rate = " << number(simulation.frame_rate) << "  # frames per simulated second\n"
      << "time_step = " << (simulation.time_step ? number(*simulation.time_step) : "\"auto\"") << "  # s\n"
      << "maximum_time_step = " << number(simulation.maximum_time_step) << "  # s, 0: no limit\n"
      << "cfl = " << number(simulation.cfl) << "\n"
      << "precision = " << (simulation.precision == Precision::single_precision ? "\"single\"" : "\"double\"") << "\n"
      << "gravity = " << vector(simulation.gravity) << "  # m/s^2\n"
      << "transfer = " << quoted(transfers[std::size_t(simulation.transfer)]) << "\n";
  if (simulation.transfer == Transfer::flip) out << "flip_ratio = " << number(simulation.flip_ratio) << "\n";
  out << "integrator = " << quoted(integrators[std::size_t(simulation.integrator)]) << "\n";
  if (simulation.integrator != Integrator::symplectic) {
    const ImplicitSolver& implicit = simulation.implicit;
    out << "\n[simulation.implicit]\n"
        << "tolerance = " << number(implicit.tolerance) << "\n"
        << "maximum_iterations = " << implicit.maximum_iterations << "\n"
        << "maximum_linear_iterations = " << implicit.maximum_linear_iterations << "\n";
  }
  const DamageSolver& damage = simulation.damage;
  out << "\n[simulation.damage]\n"
      << "passes = " << damage.passes << "\n"
      << "tolerance = " << number(damage.tolerance) << "\n"
      << "maximum_iterations = " << damage.maximum_iterations << "\n"
      << "laplacian = " << (damage.laplacian == Laplacian::weak ? "\"weak\"" : "\"cubic\"") << "\n"
      << "active_set = " << (damage.active_set ? "true" : "false") << "\n";
}

void write_material(std::ostream& out, const Material& material, const PluginCatalog& catalog) {
  out << "\n[[material]]\n"
      << "name = " << quoted(material.name) << "\n"
      << "density = " << number(material.density) << "  # kg/m^3\n";
  if (material.discretization) out << "discretization = " << law_text(*material.discretization, catalog) << "\n";
  if (!material.elasticity.id.empty()) out << "elasticity = " << law_text(material.elasticity, catalog) << "\n";
  if (material.plasticity) out << "plasticity = " << law_text(*material.plasticity, catalog) << "\n";
  if (material.damage) out << "damage = " << law_text(*material.damage, catalog) << "\n";
  if (material.constraint) out << "constraint = " << law_text(*material.constraint, catalog) << "\n";
  if (material.fibers) out << "fibers = " << fibers_text(*material.fibers) << "\n";
}

void write_body(std::ostream& out, const Body& body, int dimension) {
  static constexpr const char* patterns[] = {"regular", "jittered", "blue-noise"};
  const scene::SamplingSpec& sampling = body.sampling;
  out << "\n[[body]]\n"
      << "name = " << quoted(body.name) << "\n"
      << "material = " << quoted(body.material) << "\n";
  if (body.shape) out << "shape = " << shape_text(*body.shape) << "\n";
  if (body.particle_file) out << "particles = " << quoted(body.particle_file->string()) << "\n";
  if (body.tetrahedra) out << "tetrahedra = " << tetrahedra_text(*body.tetrahedra) << "\n";
  if (!body.tetrahedra) out << "particles_per_cell = " << sampling.particles_per_cell << "\n";
  if (body.shape && !body.tetrahedra) {
    out << "sampling = " << quoted(patterns[std::size_t(sampling.pattern)]) << "\n";
    if (sampling.pattern == scene::SamplingPattern::jittered) out << "jitter = " << number(sampling.jitter) << "\n";
    out << "seed = " << sampling.seed << "\n";
  }
  out << "velocity = " << vector(body.velocity) << "  # m/s\n";
  InlineTable spin;
  spin.add("angular_velocity", rotation(body.spin.angular_velocity, dimension));
  if (body.spin.center) spin.add("center", vector(*body.spin.center));
  out << "spin = " << spin.text() << "  # degrees/s\n";
  if (body.fibers) out << "fibers = " << fibers_text(*body.fibers) << "\n";
  if (body.toughness) out << "toughness = " << variation_text(*body.toughness) << "\n";
}

void write_collider(std::ostream& out, const Collider& collider, int dimension) {
  static constexpr const char* contacts[] = {"sticky", "slip", "separate"};
  out << "\n[[collider]]\n"
      << "name = " << quoted(collider.name) << "\n"
      << "shape = " << shape_text(collider.shape) << "\n"
      << "contact = " << quoted(contacts[std::size_t(collider.contact)]) << "\n";
  if (collider.contact != Contact::sticky) out << "friction = " << number(collider.friction) << "\n";
  out << "motion = " << motion_text(collider.motion, dimension) << "\n";
}

void write_handle(std::ostream& out, const Handle& handle, int dimension) {
  out << "\n[[handle]]\n"
      << "name = " << quoted(handle.name) << "\n";
  if (!handle.body.empty()) out << "body = " << quoted(handle.body) << "\n";
  out << "region = " << shape_text(handle.region) << "\n"
      << "motion = " << motion_text(handle.motion, dimension) << "\n";
  if (std::isfinite(handle.release)) out << "release = " << number(handle.release) << "  # s\n";
}

}  // namespace

std::string to_toml(const Scene& scene, const PluginCatalog& catalog) {
  const int dimension = scene.simulation.dimension;
  std::ostringstream out;
  write_simulation(out, scene.simulation);
  for (const Material& material : scene.materials) write_material(out, material, catalog);
  for (const Body& body : scene.bodies) write_body(out, body, dimension);
  for (const Collider& collider : scene.colliders) write_collider(out, collider, dimension);
  for (const Handle& handle : scene.handles) write_handle(out, handle, dimension);
  out << "\n[output]\n"
      << "formats = " << words(scene.output.formats) << "\n"
      << "surface = " << (scene.output.surface ? "true" : "false") << "\n"
      << "attributes = " << words(scene.output.attributes) << "\n";
  if (scene.output.meshes) out << "meshes = " << words(*scene.output.meshes) << "\n";
  if (const auto& color = scene.output.color) {
    out << "color = { by = " << quoted(color->by);
    if (color->range) out << ", range = [" << number(color->range->first) << ", " << number(color->range->second) << "]";
    out << " }\n";
  }
  out << "\n[output.checkpoint]\n"
      << "frames = " << scene.output.checkpoint.frames << "\n"
      << "seconds = " << number(scene.output.checkpoint.seconds) << "  # of wall time\n";
  return out.str();
}

}  // namespace cleave::config
