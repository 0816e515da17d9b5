#include "discretization/discretization.hpp"

#include "checkpoint/state.hpp"
#include "common/error.hpp"
#include "config/instantiate.hpp"
#include "discretization/connected_pieces.hpp"
#include "plugins/elastic_probe.hpp"
#include "plugins/message.hpp"
#include "plugins/threads.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>

namespace cleave::discretization {
namespace {

std::vector<double> flattened(const std::vector<Vector3>& vectors) {
  std::vector<double> numbers;
  numbers.reserve(3 * vectors.size());
  for (const auto& v : vectors) numbers.insert(numbers.end(), v.data(), v.data() + 3);
  return numbers;
}

plugins::Instance elastic_law(const config::Material& material, plugins::Registry& registry, const plugins::Context& context) {
  if (material.elasticity.id.empty()) return {};
  return config::instantiate(registry, material.elasticity, context);
}

/// Laws that build on the elastic one of their material are told of it.
plugins::Instance method_of(const config::Material& material, plugins::Registry& registry, plugins::Context context,
                            const plugins::Instance& elasticity) {
  if (!elasticity) return config::instantiate(registry, *material.discretization, context);
  const plugins::ElasticProbe probe(elasticity);
  context.isochoric = elasticity.isochoric_response();
  context.elastic = probe.get();
  return config::instantiate(registry, *material.discretization, context);
}

Vector3 vector_of(const double* values, std::size_t point) { return Eigen::Map<const Vector3>(values + 3 * point); }

double determinant(const double* F) { return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(F).determinant(); }

/// Index of the first point with a number that is not finite, or `points`.
std::size_t first_not_finite(const double* values, std::size_t points) {
  double sum = 0;  // 0 times what is not finite is not a number
  for (std::size_t i = 0; i < 3 * points; i++) sum += 0 * values[i];
  if (sum == 0) return points;
  std::size_t i = 0;
  while (std::isfinite(values[i])) i++;
  return i / 3;
}

}  // namespace

Discretization::Discretization(const config::Scene& scene, const config::Material& material,
                               std::vector<mpm::SampledBody> bodies, plugins::Registry& registry, std::int64_t first_particle)
    : material_(material.name),
      density_(material.density),
      settings_(scene.simulation),
      output_(scene.output),
      elasticity_(elastic_law(material, registry, {settings_.dimension, 0, density_})),
      surroundings_(scene, bodies),
      instance_(method_of(material, registry, {settings_.dimension, 0, density_}, elasticity_)),
      first_particle_(first_particle) {
  for (auto& body : bodies) add(material, body);
  if (!settings_.time_step) return;
  if (const double stable = stable_step(), step = *settings_.time_step; step > stable * (1 + 1e-9))
    throw InputError(
        fmt::format("error: material '{}': {} is stable with steps of at most {:.3g} s, simulation.time_step is {:.3g} s; "
                    "give a smaller one or \"auto\"",
                    material_, instance_.description().id, stable, step));
}

void Discretization::add(const config::Material& material, mpm::SampledBody& sampled) {
  const auto& source = sampled.particles;
  const auto refuse = [&](const std::string& what) {
    throw InputError(error_at(material.discretization->where) + "body '" + sampled.name + "': " + what);
  };
  const std::string id = instance_.description().id;
  if (!source.deformation.empty())
    refuse("its particle file gives deformation gradients, which " + id + " cannot start from; leave out F00 to F22");
  if (instance_.can(CLEAVE_NEEDS_TETRAHEDRA) && !sampled.mesh)
    refuse(id + " needs tetrahedra; add to it: tetrahedra = { edge_length = ... }, in metres, or { file = ... }");
  Body body{sampled.name, source.volumes, nullptr};
  if (elasticity_) {
    const auto& law = elasticity_.description();
    mpm::BatchOrigin origin;
    origin.material = material_;
    origin.dimension = settings_.dimension;
    origin.density = density_;
    origin.laws = {{law.id, law.version, material.elasticity.parameters}};
    body.elasticity = std::make_unique<ElasticResponse>(elasticity_, sampled.name, std::move(sampled.fibers), std::move(origin),
                                                        first_particle_ + std::int64_t(points_));
  }
  double volume = 0;
  for (const double v : body.volumes) volume += v;
  const auto positions = flattened(source.positions), velocities = flattened(source.velocities);
  cleave_body given{};
  given.struct_size = sizeof given;
  given.dimension = std::uint32_t(settings_.dimension);
  given.name = body.name.c_str();
  given.density = density_;
  given.spacing = std::pow(volume / double(body.volumes.size()), 1.0 / settings_.dimension);
  given.point_count = body.volumes.size();
  given.position = positions.data();
  given.velocity = velocities.data();
  given.volume = body.volumes.data();
  std::vector<double> vertices, vertex_velocities;
  if (sampled.mesh) {
    vertices = flattened(sampled.mesh->vertices);
    vertex_velocities = flattened(sampled.vertex_velocities);
    given.vertex_count = sampled.mesh->vertices.size();
    given.vertices = vertices.data();
    given.vertex_velocity = vertex_velocities.data();
    given.tetrahedron_count = sampled.mesh->tetrahedra.size();
    given.tetrahedra = sampled.mesh->tetrahedra.data()->data();
  }
  given.threads = plugins::threads();
  given.elasticity = body.elasticity ? body.elasticity->table() : nullptr;
  plugins::Message message;
  if (const auto result = instance_.discretization().add_body(instance_.handle(), &given, message.get()); result != CLEAVE_OK)
    refuse(id + " cannot take it: " + message.reason(result));
  points_ += body.volumes.size();
  bodies_.push_back(std::move(body));
  try {
    fields(bodies_.size() - 1);
    surface(bodies_.size() - 1);
  } catch (const SimulationError& e) {
    refuse(e.what());
  }
}

// ------------------------------------------------------------------------------------------------- in motion

void Discretization::fail(const std::string& what) const {
  const auto& d = instance_.description();
  throw SimulationError(fmt::format("material '{}': plugin {} {} {}", material_, d.id, d.version, what));
}

template <class Call>
void Discretization::in_step(const Call& call, const std::string& when) const {
  try {
    call();
  } catch (const SimulationError& e) {
    throw SimulationError(fmt::format("step {} at t = {:.6g} s{}: {}", steps_, time_, when, e.what()));
  }
}

double Discretization::stable_step() const {
  const double step = instance_.discretization().stable_step(instance_.handle());
  if (!(step > 0)) fail(fmt::format("gives {:g} s as the largest stable step", step));
  return step;
}

mpm::Bound Discretization::largest_step() {
  mpm::Bound bound;
  in_step(
      [&] {
        const double stable = stable_step();
        if (!settings_.time_step) {
          const double most = settings_.maximum_time_step;
          bound = most > 0 && most < stable ? mpm::Bound{most, "maximum"} : mpm::Bound{stable, "discretization"};
          return;
        }
        bound = {*settings_.time_step, "fixed"};
        if (bound.seconds > stable * (1 + 1e-9))
          throw SimulationError(fmt::format(
              "the fixed step of {:.3g} s is above {:.3g} s, the largest stable step that {} gives for material '{}' in its "
              "present state; give a smaller simulation.time_step or \"auto\"",
              bound.seconds, stable, instance_.description().id, material_));
      },
      "");
  return bound;
}

void Discretization::advance(double time_step) {
  const auto start = std::chrono::steady_clock::now();
  in_step(
      [&] {
        for (const auto& body : bodies_)
          if (body.elasticity) body.elasticity->forget_failures();
        plugins::Message message;
        const auto result = instance_.discretization().step(instance_.handle(), time_step,
                                                            surroundings_.during(time_, time_step), message.get());
        if (result != CLEAVE_OK) {
          const std::string reason = message.reason(result);
          for (const auto& body : bodies_)
            if (body.elasticity && failed_batch_.empty()) failed_batch_ = body.elasticity->failed_batch(reason);
          fail("failed: " + reason);
        }
        for (std::size_t b = 0; b < bodies_.size(); b++) {
          const auto all = fields(b);
          for (const char* name : {"position", "velocity"}) {
            const std::size_t count = bodies_[b].volumes.size(), i = first_not_finite(all.at(name).values, count);
            if (i < count)
              fail(fmt::format("moves point {} of body '{}' to where its {} is not finite", i, bodies_[b].name, name));
          }
        }
      },
      fmt::format(", dt = {:.3g} s", time_step));
  seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// ------------------------------------------------------------------------------------------------- checkpoints

std::uint64_t Discretization::saved_bytes() const { return instance_.discretization().save(instance_.handle(), nullptr, 0); }

void Discretization::save_state(checkpoint::StateWriter& writer, const std::string& prefix) const {
  std::vector<std::byte> bytes(saved_bytes());
  const std::uint64_t written = instance_.discretization().save(instance_.handle(), bytes.data(), bytes.size());
  if (written != bytes.size()) fail(fmt::format("saves {} bytes where it said {}", written, bytes.size()));
  writer.section(prefix + "bodies", bytes);
  checkpoint::pack(writer, prefix + "seconds", [this](auto& archive) { archive(seconds_); });
}

void Discretization::restore_state(checkpoint::StateReader& reader, const std::string& prefix) {
  const std::string section = prefix + "bodies";
  const auto bytes = reader.read(section);
  plugins::Message message;
  const auto result = instance_.discretization().restore(instance_.handle(), bytes.data(), bytes.size(), message.get());
  if (result != CLEAVE_OK)
    reader.refuse(section, "is refused by plugin " + instance_.description().id + ": " + message.reason(result));
  checkpoint::unpack(reader, prefix + "seconds", [this](auto& archive) { archive(seconds_); });
}

// ------------------------------------------------------------------------------------------------- what the plugin shows

std::map<std::string, Discretization::Field> Discretization::fields(std::size_t body) const {
  std::map<std::string, Field> found;
  const auto& table = instance_.discretization();
  const auto problem = [&](const std::string& what) { fail("gives body '" + bodies_[body].name + "' " + what); };
  std::uint32_t count = 1;
  for (std::uint32_t i = 0; i < count; i++) {
    cleave_point_field field{};
    field.struct_size = sizeof field;
    count = table.point_field(instance_.handle(), body, i, &field);
    if (i >= count) break;
    if (!field.name || !*field.name) problem("a field without a name");
    if (field.components != 1 && field.components != 3 && field.components != 9)
      problem(fmt::format("the field \"{}\" with {} components; there may be 1, 3 or 9", field.name, field.components));
    if (!field.values) problem(fmt::format("the field \"{}\" without values", field.name));
    if (!found.emplace(field.name, Field{field.unit ? field.unit : "", int(field.components), field.values}).second)
      problem(fmt::format("two fields \"{}\"", field.name));
  }
  static constexpr std::pair<const char*, int> shapes[] = {
      {"position", 3}, {"velocity", 3}, {"damage", 1}, {"energy", 1}, {"F", 9}};
  for (const auto& [name, components] : shapes) {
    const auto field = found.find(name);
    if (field == found.end() ? components == 3 : field->second.components != components)
      problem(fmt::format("no field \"{}\" with {} component{}", name, components, components > 1 ? "s" : ""));
  }
  return found;
}

std::optional<cleave_surface> Discretization::surface(std::size_t body) const {
  cleave_surface surface{};
  surface.struct_size = sizeof surface;
  const auto result = instance_.discretization().surface(instance_.handle(), body, &surface);
  if (result == CLEAVE_ERROR_UNSUPPORTED) return std::nullopt;
  const auto problem = [&](const std::string& what) { fail("gives body '" + bodies_[body].name + "' a surface " + what); };
  if (result != CLEAVE_OK) problem(fmt::format("and says that it failed with result {}", result));
  if ((surface.vertex_count && !surface.vertices) || (surface.triangle_count && !surface.triangles) ||
      (surface.tetrahedron_count && !surface.tetrahedra))
    problem("without its arrays");
  if (first_not_finite(surface.vertices, surface.vertex_count) < surface.vertex_count)
    problem("with vertices that are not finite");
  const auto in_range = [&](std::uint32_t corner) { return corner < surface.vertex_count; };
  if (!std::all_of(surface.triangles, surface.triangles + 3 * surface.triangle_count, in_range) ||
      !std::all_of(surface.tetrahedra, surface.tetrahedra + 4 * surface.tetrahedron_count, in_range))
    problem(fmt::format("with corners beyond its {} vertices", surface.vertex_count));
  return surface;
}

bool Discretization::has_surfaces() const {
  for (std::size_t b = 0; b < bodies_.size(); b++)
    if (surface(b)) return true;
  return false;
}

output::BodyMesh Discretization::mesh(std::size_t body, const cleave_surface& surface) const {
  output::BodyMesh mesh;
  const std::size_t vertices = surface.vertex_count;
  mesh.body = std::int32_t(body);
  mesh.vertices.assign(surface.vertices, surface.vertices + 3 * vertices);
  mesh.triangles.assign(surface.triangles, surface.triangles + 3 * surface.triangle_count);
  mesh.tetrahedra.assign(surface.tetrahedra, surface.tetrahedra + 4 * surface.tetrahedron_count);
  if (surface.velocity) mesh.velocity.assign(surface.velocity, surface.velocity + 3 * vertices);
  if (surface.damage) mesh.damage.assign(surface.damage, surface.damage + vertices);
  auto pieces = connected_pieces(surface);
  mesh.piece = std::move(pieces.of_vertex);
  mesh.pieces = pieces.count;
  return mesh;
}

// ------------------------------------------------------------------------------------------------- looking at it

std::vector<std::string> Discretization::attributes() const {
  std::vector<std::string> names;
  for (std::size_t b = 0; b < bodies_.size(); b++)
    for (const auto& [name, field] : fields(b)) {
      if (name == "F") names.emplace_back("J");
      if (name != "position" && name != "velocity") names.push_back(name);
    }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

output::ParticleFrame Discretization::frame(int index) const {
  output::ParticleFrame frame;
  frame.index = index;
  frame.time = time_;
  frame.dimension = settings_.dimension;
  frame.cell_size = settings_.cell_size;
  const auto wanted = [&](const std::string& name, bool by_default) {
    const auto& asked = output_.attributes;
    return asked.empty() ? by_default : std::find(asked.begin(), asked.end(), name) != asked.end();
  };
  const bool meshes = !output_.meshes || !output_.meshes->empty();
  for (std::size_t b = 0; b < bodies_.size(); b++) {
    const auto& volumes = bodies_[b].volumes;
    const std::size_t first = frame.particles(), count = volumes.size();
    const auto all = fields(b);
    const double *x = all.at("position").values, *v = all.at("velocity").values;
    for (std::size_t i = 0; i < count; i++) {
      frame.positions.push_back(vector_of(x, i));
      frame.velocities.push_back(vector_of(v, i).cast<float>());
      frame.volumes.push_back(float(volumes[i]));
    }
    frame.bodies.push_back(bodies_[b].name);
    frame.body_ends.push_back(first + count);
    for (auto& a : frame.attributes) a.values.resize((first + count) * std::size_t(a.components), 0.f);
    const auto attribute = [&](const std::string& name, int components, const std::string& unit) -> float* {
      auto a = std::find_if(frame.attributes.begin(), frame.attributes.end(), [&](const auto& k) { return k.name == name; });
      if (a == frame.attributes.end()) {
        const std::vector<float> zeros((first + count) * std::size_t(components), 0.f);
        a = frame.attributes.insert(a, {name, components, unit, zeros});
      }
      if (a->components != components)
        fail(fmt::format("gives body '{}' the field \"{}\" with {} component{}; another body has one of that name with {}",
                         bodies_[b].name, name, components, components > 1 ? "s" : "", a->components));
      return a->values.data() + first * std::size_t(components);
    };
    for (const auto& [name, field] : all) {
      if (name == "F" && wanted("J", true)) {
        float* J = attribute("J", 1, "1");
        for (std::size_t i = 0; i < count; i++) J[i] = float(determinant(field.values + 9 * i));
      }
      if (name == "position" || name == "velocity" || !wanted(name, name != "F")) continue;
      std::transform(field.values, field.values + count * std::size_t(field.components),
                     attribute(name, field.components, field.unit), [](double value) { return float(value); });
    }
    if (const auto s = meshes ? surface(b) : std::nullopt) frame.meshes.push_back(mesh(b, *s));
  }
  return frame;
}

std::vector<mpm::ParticleState> Discretization::state() const {
  std::vector<mpm::ParticleState> points;
  for (std::size_t b = 0; b < bodies_.size(); b++) {
    const auto all = fields(b);
    const auto damage = all.find("damage"), F = all.find("F");
    for (std::size_t i = 0; i < bodies_[b].volumes.size(); i++) {
      mpm::ParticleState p;
      p.id = std::int64_t(points.size());
      p.body = std::int32_t(b);
      p.position = vector_of(all.at("position").values, i);
      p.velocity = vector_of(all.at("velocity").values, i);
      p.volume = bodies_[b].volumes[i];
      if (F != all.end()) p.strain = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(F->second.values + 9 * i);
      if (damage != all.end()) p.damage = damage->second.values[i];
      points.push_back(p);
    }
  }
  return points;
}

output::FrameRecord Discretization::measure() {
  output::FrameRecord r;
  record_steps(r);
  r.minimum_J = std::numeric_limits<double>::infinity();
  r.maximum_J = -r.minimum_J;
  double damaged = 0;
  for (std::size_t b = 0; b < bodies_.size(); b++) {
    const auto all = fields(b);
    const auto values = [&](const char* name) {
      const auto field = all.find(name);
      return field == all.end() ? nullptr : field->second.values;
    };
    const double *position = values("position"), *velocity = values("velocity"), *damage = values("damage"),
                 *energy = values("energy"), *F = values("F");
    for (std::size_t i = 0; i < bodies_[b].volumes.size(); i++) {
      const Vector3 x = vector_of(position, i), v = vector_of(velocity, i);
      const double volume = bodies_[b].volumes[i], m = density_ * volume, J = F ? determinant(F + 9 * i) : 1;
      r.kinetic_energy += 0.5 * m * v.squaredNorm();
      if (energy) r.elastic_energy += energy[i] * volume;
      r.gravity_energy -= m * settings_.gravity.dot(x);
      r.momentum += m * v;
      r.angular_momentum += m * x.cross(v);
      r.center_of_mass += m * x;
      r.mass += m;
      r.volume += J * volume;
      r.rest_volume += volume;
      if (F) {
        r.minimum_J = std::min(r.minimum_J, J);
        r.maximum_J = std::max(r.maximum_J, J);
      }
      r.maximum_speed = std::max(r.maximum_speed, v.norm());
      if (damage) {
        r.maximum_damage = std::max(r.maximum_damage, damage[i]);
        if (damage[i] > 0.5) damaged += volume;
      }
    }
    if (const auto s = surface(b)) r.pieces = r.pieces.value_or(0) + connected_pieces(*s).count;
  }
  r.center_of_mass /= r.mass;
  r.damaged_fraction = damaged / r.rest_volume;
  return r;
}

std::vector<std::pair<std::string, double>> Discretization::bytes_per_particle() const {
  const double bytes = double(saved_bytes()) / double(points_);
  return {{material_ + ": saved state", bytes}, {"total", bytes}};
}

std::vector<output::PluginRecord> Discretization::plugins() const {
  std::vector<output::PluginRecord> used;
  for (const auto* law : {&elasticity_, &instance_})
    if (*law)
      used.push_back(
          {law->description().id, law->description().version, law->plugin().path().string(), law->plugin().sha256()});
  return used;
}

}  // namespace cleave::discretization
