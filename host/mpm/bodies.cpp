#include "mpm/bodies.hpp"

#include "common/error.hpp"

#include <cmath>

namespace cleave::mpm {

SampledBody sample_body(const config::Scene& scene, const config::Body& body) {
  const auto& sim = scene.simulation;
  SampledBody s;
  s.name = body.name;
  for (std::size_t m = 0; m < scene.materials.size(); m++)
    if (scene.materials[m].name == body.material) s.material = m;
  try {
    if (body.tetrahedra) {
      s.mesh = scene::build_tetrahedra(*body.tetrahedra, body.shape ? &*body.shape : nullptr);
      s.particles.positions = scene::barycentres(*s.mesh);
      s.particles.volumes = scene::volumes(*s.mesh);
    } else if (body.shape) {
      const auto shape = scene::build_shape(*body.shape, sim.cell_size / 2);
      s.particles = scene::sample(*shape, body.sampling, sim.cell_size, sim.dimension);
    } else {
      const double volume = std::pow(sim.cell_size, sim.dimension) / body.sampling.particles_per_cell;
      s.particles = scene::read_particles(*body.particle_file, sim.dimension, volume);
    }
    const auto& positions = s.particles.positions;
    if (const auto& fibers = body.fibers ? body.fibers : scene.materials[s.material].fibers)
      s.fibers = scene::lay_fibers(*fibers, positions, sim.cell_size, sim.dimension);
    if (body.toughness) s.toughness = scene::sample_variation(*body.toughness, positions, sim.dimension);
  } catch (const InputError& e) {
    throw InputError(error_at(body.where) + "body '" + body.name + "': " + e.what());
  }
  const auto& p = s.particles;
  if (!p.velocities.empty()) return s;
  s.velocity = body.velocity;
  s.angular_velocity = body.spin.angular_velocity;
  if (body.spin.center) {
    s.center = *body.spin.center;
  } else if (!p.positions.empty()) {
    double total = 0;
    for (std::size_t i = 0; i < p.positions.size(); i++) {
      s.center += p.volumes[i] * p.positions[i];
      total += p.volumes[i];
    }
    s.center /= total;
  }
  // the affine field starts with the spin: without it the first transfer would lose angular momentum
  const Vector3& w = s.angular_velocity;
  s.velocity_gradient << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return s;
}

Vector3 SampledBody::velocity_of(std::size_t particle) const {
  return particles.velocities.empty() ? velocity_at(particles.positions[particle]) : particles.velocities[particle];
}

Vector3 SampledBody::velocity_at(const Vector3& x) const { return velocity + angular_velocity.cross(x - center); }

std::vector<SampledBody> sample_bodies(const config::Scene& scene) {
  std::vector<SampledBody> bodies;
  for (const auto& body : scene.bodies) {
    bodies.push_back(sample_body(scene, body));
    SampledBody& s = bodies.back();
    std::vector<Vector3> velocities(s.particles.positions.size());
    for (std::size_t i = 0; i < velocities.size(); i++) velocities[i] = s.velocity_of(i);
    s.particles.velocities = std::move(velocities);
    if (s.mesh)
      for (const Vector3& x : s.mesh->vertices) s.vertex_velocities.push_back(s.velocity_at(x));
  }
  return bodies;
}

}  // namespace cleave::mpm
