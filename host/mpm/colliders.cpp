#include "mpm/colliders.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace cleave::mpm {

Vector3 resolve_contact(config::Contact contact, double friction, const Vector3& normal, const Vector3& collider_velocity,
                        const Vector3& v) {
  // deep inside a level set there is no direction to go
  if (contact == config::Contact::sticky || normal.isZero()) return collider_velocity;
  const Vector3 relative = v - collider_velocity;
  const double inward = relative.dot(normal);
  if (contact == config::Contact::separate && inward >= 0) return v;
  Vector3 tangential = relative - inward * normal;
  const double speed = tangential.norm(), stopped = friction * std::max(-inward, 0.0);
  tangential = speed > stopped ? Vector3(tangential * (1 - stopped / speed)) : Vector3(Vector3::Zero());
  return collider_velocity + tangential;
}

template <class T, int D>
Colliders<T, D>::Colliders(const std::vector<config::Collider>& colliders, double cell_size) : cell_size_(cell_size) {
  for (const auto& c : colliders) colliders_.push_back({c, scene::build_shape(c.shape, cell_size / 2), {}});
}

template <class T, int D>
std::vector<typename Colliders<T, D>::Contact> Colliders<T, D>::find_contacts(const Grid<T, D>& grid, const Collider& collider,
                                                                              const scene::RigidMotion::Pose& pose) const {
  constexpr int nodes = Grid<T, D>::block_nodes;
  const double half_diagonal = cell_size_ * (Grid<T, D>::edge - 1) / 2.0 * std::sqrt(double(D));
  const bool moves = !collider.spec.motion.at_rest();
  const auto to_scene = [&](const Vector3& x) { return moves ? pose.to_scene(x) : x; };
  std::vector<std::vector<Contact>> found(grid.blocks());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid.blocks(), 32), [&](const auto& range) {
    for (std::size_t b = range.begin(); b < range.end(); b++) {
      const Vector3 first = grid.node_coordinates(b * nodes).template cast<double>() * cell_size_;
      const Vector3 last = grid.node_coordinates(b * nodes + nodes - 1).template cast<double>() * cell_size_;
      if (collider.shape->distance(to_scene((first + last) / 2)) > half_diagonal * 1.0001) continue;
      for (int n = 0; n < nodes; n++) {
        const Vector3 x = to_scene(grid.node_coordinates(b * nodes + n).template cast<double>() * cell_size_);
        // A node on the surface is the collider's: else a wall along a node plane would begin one cell inside.
        if (collider.shape->distance(x) > 0) continue;
        Vector3 normal = collider.shape->normal(x);
        if (moves) normal = pose.rotation * normal;
        if constexpr (D == 2) {
          normal.z() = 0;
          if (normal.squaredNorm() > 0) normal.normalize();
        }
        found[b].push_back({b * nodes + n, normal});
      }
    }
  });
  std::vector<Contact> all;
  for (const auto& list : found) all.insert(all.end(), list.begin(), list.end());
  return all;
}

template <class T, int D>
void Colliders<T, D>::prepare(const Grid<T, D>& grid) {
  for (auto& c : colliders_)
    if (c.spec.motion.at_rest()) c.at_rest = find_contacts(grid, c, {});
}

template <class T, int D>
void Colliders<T, D>::apply(Grid<T, D>& grid, double time, std::vector<HeldNode>* held) const {
  for (const auto& c : colliders_) {
    const bool at_rest = c.spec.motion.at_rest();
    const auto pose = at_rest ? scene::RigidMotion::Pose{} : c.spec.motion.at(time);
    std::vector<Contact> moving;
    if (!at_rest) moving = find_contacts(grid, c, pose);
    const auto& contacts = at_rest ? c.at_rest : moving;
    std::vector<std::uint8_t> holds(held ? contacts.size() : 0, 0);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, contacts.size(), 512), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); i++) {
        T* node = grid.node(contacts[i].node);
        if (!(node[0] > 0)) continue;
        Vector3 v = Vector3::Zero(), wall = Vector3::Zero();
        for (int a = 0; a < D; a++) v[a] = double(node[1 + a]);
        if (!at_rest) {
          wall = pose.velocity_at(grid.node_coordinates(contacts[i].node).template cast<double>() * cell_size_);
          if constexpr (D == 2) wall.z() = 0;
        }
        if (held)
          holds[i] = c.spec.contact != config::Contact::separate || contacts[i].normal.isZero() ||
                     (v - wall).dot(contacts[i].normal) < 0;
        v = resolve_contact(c.spec.contact, c.spec.friction, contacts[i].normal, wall, v);
        for (int a = 0; a < D; a++) node[1 + a] = T(v[a]);
      }
    });
    const bool sticky = c.spec.contact == config::Contact::sticky;
    for (std::size_t i = 0; i < holds.size(); i++)
      if (holds[i]) held->push_back({contacts[i].node, sticky ? Vector3(Vector3::Zero()) : contacts[i].normal});
  }
}

template <class T, int D>
std::vector<ContactNode> Colliders<T, D>::contacts(const Grid<T, D>& grid, double time) const {
  std::vector<ContactNode> all;
  for (const auto& c : colliders_) {
    const bool at_rest = c.spec.motion.at_rest();
    const auto pose = at_rest ? scene::RigidMotion::Pose{} : c.spec.motion.at(time);
    std::vector<Contact> moving;
    if (!at_rest) moving = find_contacts(grid, c, pose);
    for (const Contact& contact : at_rest ? c.at_rest : moving) {
      if (!(grid.node(contact.node)[0] > 0)) continue;
      Vector3 wall = Vector3::Zero();
      if (!at_rest) wall = pose.velocity_at(grid.node_coordinates(contact.node).template cast<double>() * cell_size_);
      if constexpr (D == 2) wall.z() = 0;
      all.push_back({contact.node, contact.normal, wall, c.spec.contact, c.spec.friction});
    }
  }
  return all;
}

template <class T, int D>
double Colliders<T, D>::maximum_speed(double time) const {
  double fastest = 0;
  for (const auto& c : colliders_) {
    if (c.spec.motion.at_rest()) continue;
    const auto pose = c.spec.motion.at(time);
    const Box box = c.shape->bounds();
    double speed = pose.velocity.norm();
    if (!box.isEmpty() && box.sizes().allFinite())
      speed += pose.angular_velocity.norm() * (box.sizes().norm() + (box.center() - pose.center).norm());
    fastest = std::max(fastest, speed);
  }
  return fastest;
}

template class Colliders<float, 2>;
template class Colliders<float, 3>;
template class Colliders<double, 2>;
template class Colliders<double, 3>;

}  // namespace cleave::mpm
