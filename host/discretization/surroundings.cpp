#include "discretization/surroundings.hpp"

#include "mpm/colliders.hpp"
#include "plugins/threads.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace cleave::discretization {

Surroundings::Surroundings(const config::Scene& scene, const std::vector<mpm::SampledBody>& bodies)
    : dimension_(scene.simulation.dimension), handles_(scene.handles), bodies_(bodies.size()), held_(handles_.size(), 0) {
  const double voxel = scene.simulation.cell_size / 2;
  for (const auto& c : scene.colliders) colliders_.push_back({c, scene::build_shape(c.shape, voxel), {}});
  for (std::size_t h = 0; h < handles_.size(); h++) {
    const auto region = scene::build_shape(handles_[h].region, voxel);
    const Pose start = handles_[h].motion.at(0);
    for (std::size_t b = 0; b < bodies.size(); b++) {
      if (!handles_[h].body.empty() && handles_[h].body != bodies[b].name) continue;
      const auto points = hold(bodies_[b].points, std::uint16_t(h), *region, start, bodies[b].particles.positions);
      const auto vertices =
          bodies[b].mesh ? hold(bodies_[b].vertices, std::uint16_t(h), *region, start, bodies[b].mesh->vertices) : 0;
      held_[h] += points > 0 ? points : vertices;
    }
  }
  table_.struct_size = sizeof table_;
  for (int a = 0; a < 3; a++) table_.gravity[a] = scene.simulation.gravity[a];
  table_.user = this;
  table_.collide = &collide;
  table_.handle = &handle;
}

std::size_t Surroundings::hold(Held& held, std::uint16_t handle, const scene::SignedDistance& region, const Pose& start,
                               const std::vector<Vector3>& places) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < places.size(); i++) {
    if (region.distance(places[i]) > 0) continue;
    if (held.handle.empty()) {
      held.handle.assign(places.size(), none);
      held.place.resize(places.size());
    }
    if (held.handle[i] != none) continue;
    held.handle[i] = handle;
    held.place[i] = start.to_scene(places[i]);
    count++;
  }
  return count;
}

const cleave_surroundings* Surroundings::during(double time, double time_step) {
  table_.threads = plugins::threads();
  time_step_ = time_step;
  for (auto& c : colliders_) c.pose = c.spec.motion.at(time + time_step);
  poses_.clear();
  for (const auto& h : handles_) poses_.push_back({time < h.release, h.motion.at(time), h.motion.at(time + time_step)});
  return &table_;
}

/// Contact as at the nodes of a grid, with each point its own node.
void Surroundings::collide(void* self, std::uint64_t count, const double* position, double* velocity) {
  const auto& s = *static_cast<const Surroundings*>(self);
  for (const auto& c : s.colliders_) {
    const bool moves = !c.spec.motion.at_rest();
    tbb::parallel_for(tbb::blocked_range<std::uint64_t>(0, count, 1024), [&](const auto& range) {
      for (std::uint64_t i = range.begin(); i < range.end(); i++) {
        const Vector3 x(position[3 * i], position[3 * i + 1], position[3 * i + 2]);
        const Vector3 place = moves ? c.pose.to_scene(x) : x;
        if (!(c.shape->distance(place) <= 0)) continue;
        Vector3 normal = c.shape->normal(place), wall = Vector3::Zero();
        if (moves) {
          normal = c.pose.rotation * normal;
          wall = c.pose.velocity_at(x);
        }
        if (s.dimension_ == 2) {
          wall.z() = normal.z() = 0;
          if (normal.squaredNorm() > 0) normal.normalize();
        }
        const Vector3 v(velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]);
        const Vector3 allowed = mpm::resolve_contact(c.spec.contact, c.spec.friction, normal, wall, v);
        for (std::uint64_t a = 0; a < 3; a++) velocity[3 * i + a] = allowed[Eigen::Index(a)];
      }
    });
  }
}

std::int32_t Surroundings::handle(void* self, std::uint64_t body, std::uint32_t entity, std::uint64_t index, double* position,
                                  double* velocity) {
  const auto& s = *static_cast<const Surroundings*>(self);
  if (entity > CLEAVE_VERTEX || body >= s.bodies_.size()) return 0;
  const Held& held = entity == CLEAVE_POINT ? s.bodies_[body].points : s.bodies_[body].vertices;
  if (index >= held.handle.size()) return 0;
  const std::uint16_t h = held.handle[index];
  if (h == none || !s.poses_[h].active) return 0;
  const Vector3& place = held.place[index];
  const Vector3 end = s.poses_[h].after.to_world(place), v = (end - s.poses_[h].before.to_world(place)) / s.time_step_;
  for (int a = 0; a < 3; a++) {
    position[a] = end[a];
    velocity[a] = v[a];
  }
  return 1;
}

}  // namespace cleave::discretization
