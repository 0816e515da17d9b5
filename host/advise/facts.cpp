#include "advise/facts.hpp"

#include "common/error.hpp"
#include "discretization/simulation.hpp"
#include "point/evaluator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cleave::advise {
namespace {

using config::Material;
using config::Scene;

constexpr int instants = 200;  // at which motions are looked at

/// Stresses concentrate, loads that come suddenly count twice, and slender bodies bend.
constexpr double concentration = 4;

double extent(const Box& box, bool longest, int dimension) {
  const Vector3 sizes = box.sizes();
  return longest ? sizes.head(dimension).maxCoeff() : sizes.head(dimension).minCoeff();
}

/// Velocities of a motion at the corners of a box, over the time of the scene.
template <class Visit>
void follow(const scene::RigidMotion& motion, const Box& box, double end, const Visit& visit) {
  for (int i = 0; i <= instants; ++i) {
    const auto pose = motion.at(end * i / instants);
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3 X = box.corner(Box::CornerType(corner));
      visit(X, pose.to_world(X), pose.velocity_at(pose.to_world(X)));
    }
  }
}

std::vector<BodyFacts> facts_of_bodies(const Scene& scene, const std::vector<mpm::SampledBody>& bodies) {
  std::vector<BodyFacts> facts;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const auto& positions = bodies[i].particles.positions;
    BodyFacts body;
    body.material = bodies[i].material;
    body.particles = std::int64_t(positions.size());
    body.at_rest = bodies[i].particles.deformation.empty() && bodies[i].particles.states.empty();
    for (const Vector3& x : positions) body.bounds.extend(x);
    if (scene.bodies[i].shape && !scene.bodies[i].tetrahedra) {
      const auto shape = scene::build_shape(*scene.bodies[i].shape, scene.simulation.cell_size);
      for (const Vector3& x : positions) body.thickness = std::max(body.thickness, -2 * shape->distance(x));
      if (body.thickness >= 2 * shape->band()) body.thickness = 0;  // deeper than is known
    }
    facts.push_back(body);
  }
  return facts;
}

Motions motions_of(const Scene& scene, const std::vector<mpm::SampledBody>& bodies, const std::vector<BodyFacts>& facts) {
  const double end = scene.simulation.end_time, gravity = scene.simulation.gravity.norm();
  Box all;
  for (const BodyFacts& body : facts) all.extend(body.bounds);
  Motions motions;
  double fastest_body = 0, fastest_guide = 0, travelled = 0;
  for (std::size_t i = 0; i < bodies.size(); ++i)
    for (std::size_t k = 0; k < bodies[i].particles.positions.size(); ++k)
      fastest_body = std::max(fastest_body, bodies[i].velocity_of(k).norm());
  const auto guide = [&](const scene::RigidMotion& motion, const Box& box) {
    if (motion.at_rest()) return;
    follow(motion, box, end, [&](const Vector3& X, const Vector3& x, const Vector3& v) {
      fastest_guide = std::max(fastest_guide, v.norm());
      travelled = std::max(travelled, (x - X).norm());
    });
  };
  double widest = all.diagonal().norm();
  for (const auto& handle : scene.handles) guide(handle.motion, all);
  for (const auto& collider : scene.colliders) {
    const auto shape = scene::build_shape(collider.shape, scene.simulation.cell_size);
    const Box bounds = shape->bounds();
    const bool finite = !bounds.isEmpty() && bounds.sizes().allFinite();
    guide(collider.motion, finite ? bounds : all);
    for (int corner = 0; corner < 8; ++corner)
      widest = std::max(widest, std::abs(shape->distance(all.corner(Box::CornerType(corner)))));
    if (finite) widest = std::max(widest, all.merged(bounds).diagonal().norm());
  }
  const bool meets = bodies.size() + scene.colliders.size() + scene.handles.size() > 1;
  const double fall = meets ? std::min(gravity * end, std::sqrt(2 * gravity * widest)) : 0;
  motions.speed = (meets ? 2 * fastest_body : fastest_body) + fastest_guide + fall;
  motions.reach = (fastest_body + fastest_guide) * end + gravity * end * end / 2;
  if (scene.handles.size() + scene.colliders.size() > 1) motions.displacement = 2 * travelled;
  return motions;
}

/// Deformations of this size in all directions: pulled, pressed, sheared, swollen, shrunk.
std::vector<Matrix3> deformations(double strain, int dimension) {
  std::vector<Matrix3> all;
  for (const double e : {strain, -std::min(strain, 0.6), strain / 4, -strain / 4, strain / 16}) {
    all.push_back(Matrix3::Identity() + e * Vector3(1, 1, dimension == 3 ? 1 : 0).asDiagonal().toDenseMatrix());
    for (int i = 0; i < dimension; ++i) {
      const int k = (i + 1) % dimension;
      const Vector3 a = Vector3::Unit(i), b = Vector3::Unit(k), slant = (a + b).normalized();
      for (const Vector3& n : {a, slant}) all.push_back(Matrix3::Identity() + e * n * n.transpose());
      all.push_back(Matrix3::Identity() + 2 * e * a * b.transpose());
    }
  }
  return all;
}

/// Empty where laws cannot be asked at a point alone.
std::optional<LawResponse> response_of(const point::Laws& laws, double strain, int dimension) {
  std::vector<point::State> states;
  for (const Matrix3& F : deformations(strain, dimension)) {
    point::State state;
    state.deformation = F;
    state.variables = point::initial_variables(laws);
    states.push_back(std::move(state));
  }
  std::vector<point::Response> responses(states.size());
  point::make_evaluator(laws)->evaluate(states, responses);
  LawResponse result;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const point::Response& r = responses[i];
    if (!r.usable()) return std::nullopt;
    result.yields = result.yields || r.yielded || (r.deformation - states[i].deformation).norm() > 1e-4 * strain;
    result.damage = std::max(result.damage, laws.damage_is_local ? r.damage : r.driving_force / (1 + r.driving_force));
  }
  return result;
}

cleave_damage_model model_of(const point::Laws& laws) {
  cleave_damage_model model{};
  model.struct_size = sizeof model;
  laws.damage.damage().model(laws.damage.handle(), &model);
  return model;
}

/// Found by trying parameters in metres.
std::optional<LengthParameter> length_parameter(const Material& material, config::Precision precision,
                                                const plugins::Context& surroundings, plugins::Registry& registry) {
  for (const plugins::Parameter& parameter : registry.find(material.damage->id)->parameters) {
    if (parameter.type != CLEAVE_TYPE_NUMBER || parameter.unit != "m" || material.damage->parameters.contains(parameter.key))
      continue;
    const auto length_with = [&](double value) {
      Material with = material;
      with.damage->parameters[parameter.key] = value;
      return model_of(point::laws_of(with, precision, surroundings, registry)).length;
    };
    const double given = surroundings.cell_size;
    try {
      const double length = length_with(given);
      if (length > 0 && std::abs(length_with(2 * given) - 2 * length) < 1e-6 * length)
        return LengthParameter{parameter.key, given / length};
    } catch (const InputError&) {
      // not beside the parameters that are given
    }
  }
  return std::nullopt;
}

MaterialFacts facts_of_material(const Scene& scene, std::size_t index, const std::vector<BodyFacts>& bodies,
                                const Motions& motions, plugins::Registry& registry) {
  Material material = scene.materials[index];
  MaterialFacts facts;
  if (material.discretization) return facts;
  // directions of fibers do not matter where strains of all directions are tried
  if (material.fibers || std::any_of(scene.bodies.begin(), scene.bodies.end(), [](const auto& b) { return bool(b.fibers); }))
    material.fibers = config::Fibers{.second = Vector3::UnitY()};
  const plugins::Context surroundings{
      .dimension = scene.simulation.dimension, .cell_size = scene.simulation.cell_size, .density = material.density};
  const bool has_double = registry.find(material.elasticity.id)->can(CLEAVE_DOUBLE) &&
                          (!material.plasticity || registry.find(material.plasticity->id)->can(CLEAVE_DOUBLE)) &&
                          (!material.damage || registry.find(material.damage->id)->can(CLEAVE_DOUBLE));
  const auto precision = has_double ? config::Precision::double_precision : config::Precision::single_precision;
  const point::Laws laws = point::laws_of(material, precision, surroundings, registry);
  facts.stiffness = laws.stiffness;
  facts.wave_speed = std::sqrt(laws.stiffness / material.density);
  if (laws.damage) {
    const cleave_damage_model model = model_of(laws);
    facts.length = model.length;
    facts.explicit_damage = !laws.damage_is_local && model.integration == CLEAVE_INTEGRATION_EXPLICIT;
    plugins::Context twice = surroundings;
    twice.cell_size *= 2;
    facts.length_in_cells =
        facts.length > 0 && model_of(point::laws_of(material, precision, twice, registry)).length > 1.5 * facts.length;
    if (facts.length_in_cells) facts.fixes_length = length_parameter(material, precision, surroundings, registry);
  }

  const double gravity = scene.simulation.gravity.norm();
  bool foretold = !material.constraint;
  for (const BodyFacts& body : bodies) {
    if (body.material != index) continue;
    const double longest = extent(body.bounds, true, scene.simulation.dimension),
                 shortest = std::max(extent(body.bounds, false, scene.simulation.dimension), scene.simulation.cell_size);
    const double impact = motions.speed / facts.wave_speed, weight = material.density * gravity * longest / facts.stiffness,
                 pull = motions.displacement / longest;
    facts.strain.expected = std::max(facts.strain.expected, impact + weight + pull);
    facts.strain.largest = std::max(facts.strain.largest,
                                    concentration * (impact + weight * longest / shortest + motions.displacement / shortest));
    foretold = foretold && body.at_rest;
  }
  // beyond half its size a body does anything
  if (foretold && facts.strain.largest > 0 && facts.strain.largest < 0.5)
    facts.response = response_of(laws, facts.strain.largest, scene.simulation.dimension);
  return facts;
}

mpm::Bound first_step(const Scene& scene, plugins::Registry& registry) {
  return discretization::simulate(scene, registry)->largest_step();
}

}  // namespace

double least_memory(const Scene& scene) {
  constexpr double bytes = 80;
  double particles = 0;
  for (const auto& body : scene.bodies) {
    if (!body.shape || body.tetrahedra) continue;
    const Box box = scene::build_shape(*body.shape, scene.simulation.cell_size)->bounds();
    if (box.isEmpty() || !box.sizes().allFinite()) continue;
    // a shape rarely fills less than a hundredth of its box
    double filled = 0.01 * body.sampling.particles_per_cell;
    for (int i = 0; i < scene.simulation.dimension; ++i) filled *= box.sizes()[i] / scene.simulation.cell_size;
    particles += filled;
  }
  return bytes * particles;
}

Facts gather(const Scene& scene, plugins::Registry& registry) {
  Facts facts;
  {
    const auto bodies = mpm::sample_bodies(scene);
    facts.bodies = facts_of_bodies(scene, bodies);
    facts.motions = motions_of(scene, bodies, facts.bodies);
    for (const auto& collider : scene.colliders) {
      const auto shape = scene::build_shape(collider.shape, scene.simulation.cell_size);
      double gap = std::numeric_limits<double>::infinity();
      for (const auto& body : bodies)
        for (const Vector3& x : body.particles.positions) gap = std::min(gap, shape->distance(x));
      facts.collider_gap.push_back(gap);
    }
  }
  for (const BodyFacts& body : facts.bodies) facts.particles += body.particles;
  for (std::size_t i = 0; i < scene.materials.size(); ++i)
    facts.materials.push_back(facts_of_material(scene, i, facts.bodies, facts.motions, registry));

  const auto simulation = discretization::simulate(scene, registry);
  facts.step = simulation->largest_step();
  facts.bytes_per_particle = simulation->bytes_per_particle().empty() ? 0 : simulation->bytes_per_particle().back().second;
  Scene free = scene;
  free.simulation.time_step.reset();
  free.simulation.maximum_time_step = 0;
  facts.free_step = first_step(free, registry);
  const bool particles_only =
      std::none_of(scene.materials.begin(), scene.materials.end(), [](const Material& m) { return bool(m.discretization); });
  if (particles_only) {
    free.simulation.integrator = config::Integrator::symplectic;
    facts.symplectic_step = first_step(free, registry);
    free.simulation.integrator = config::Integrator::implicit;
    try {
      facts.implicit_step = first_step(free, registry);
    } catch (const InputError&) {
      // a law that implicit steps cannot use
    }
  }
  return facts;
}

bool prismatic(const Scene& scene) {
  const auto in_plane = [](const Vector3& v) { return v.z() == 0; };
  const auto moves_in_plane = [&](const scene::RigidMotion& motion) {
    const auto about_z = [](const Vector3& w) { return w.x() == 0 && w.y() == 0; };
    return in_plane(motion.velocity) && about_z(motion.angular_velocity) &&
           std::all_of(motion.keyframes.begin(), motion.keyframes.end(),
                       [&](const auto& k) { return in_plane(k.translation) && about_z(k.rotation); });
  };
  if (scene.simulation.dimension != 3 || !in_plane(scene.simulation.gravity)) return false;
  for (const auto& handle : scene.handles)
    if (!moves_in_plane(handle.motion)) return false;
  for (const auto& collider : scene.colliders)
    if (!moves_in_plane(collider.motion)) return false;
  for (const auto& material : scene.materials)
    if (material.discretization || material.constraint || (material.fibers && !in_plane(material.fibers->direction)))
      return false;

  constexpr int columns = 24, layers = 8;
  std::optional<std::pair<double, double>> ends;
  const auto same_along_z = [&](const scene::SignedDistance& shape, const Box& region) {
    for (int i = 0; i < columns; ++i)
      for (int k = 0; k < columns; ++k) {
        std::optional<bool> inside;
        for (int l = 0; l < layers; ++l) {
          const Vector3 s((i + 0.5) / columns, (k + 0.5) / columns, (l + 0.5) / layers);
          const bool here = shape.distance(region.min() + s.cwiseProduct(region.sizes())) < 0;
          if (inside && *inside != here) return false;
          inside = here;
        }
      }
    return true;
  };
  Box all;
  for (const auto& body : scene.bodies) {
    if (!body.shape || body.tetrahedra || body.particle_file || body.toughness || body.fibers) return false;
    if (!in_plane(body.velocity) || body.spin.angular_velocity.x() != 0 || body.spin.angular_velocity.y() != 0) return false;
    const auto shape = scene::build_shape(*body.shape, scene.simulation.cell_size);
    const Box box = shape->bounds();
    if (box.isEmpty() || !same_along_z(*shape, box)) return false;
    const std::pair own(box.min().z(), box.max().z());
    if (ends && (std::abs(ends->first - own.first) > 1e-6 || std::abs(ends->second - own.second) > 1e-6)) return false;
    ends = own;
    all.extend(box);
  }
  if (!ends || ends->first > 0 || ends->second < 0) return false;
  const auto varies = [&](const scene::ShapeSpec& spec) {
    const auto shape = scene::build_shape(spec, scene.simulation.cell_size);
    return !same_along_z(*shape, all);
  };
  for (const auto& collider : scene.colliders)
    if (varies(collider.shape)) return false;
  for (const auto& handle : scene.handles)
    if (varies(handle.region)) return false;
  // plane strain: what is long keeps its length but near its ends
  const double depth = all.sizes().z(), across = std::min(all.sizes().x(), all.sizes().y());
  return depth >= 4 * across;
}

}  // namespace cleave::advise
