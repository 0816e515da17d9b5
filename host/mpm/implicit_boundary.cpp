#include "mpm/implicit_boundary.hpp"

#include <algorithm>
#include <cmath>

namespace cleave::mpm {

namespace {
/// Directions that differ by less prescribe one and the same component.
constexpr double distinct = 0.1;
/// Relative change of friction's impulse that asks for another solve.
constexpr double settled = 0.05;
}  // namespace

template <class T, int D>
ImplicitBoundary<T, D>::ImplicitBoundary(const std::vector<HeldNode>& handles, const std::vector<ContactNode>& contacts,
                                         const T* free_motion) {
  for (const auto& c : contacts) {
    if (!(free_motion[4 * c.node] > T(0))) continue;
    contacts_.emplace_back();
    static_cast<ContactNode&>(contacts_.back()) = c;
  }
  std::stable_sort(contacts_.begin(), contacts_.end(), [](const auto& a, const auto& b) { return a.node < b.node; });
  for (std::size_t i = 0; i < contacts_.size(); i++) {
    if (i == 0 || contacts_[i].node != contacts_[i - 1].node) nodes_.push_back({contacts_[i].node, false, i, 0});
    nodes_.back().count++;
  }
  const std::size_t touched = nodes_.size();  // in the order of the nodes
  for (const auto& f : handles) {
    if (!(free_motion[4 * f.node] > T(0))) continue;
    const auto end = nodes_.begin() + std::ptrdiff_t(touched);
    const auto found =
        std::lower_bound(nodes_.begin(), end, f.node, [](const Node& n, std::size_t node) { return n.node < node; });
    const bool has_contact = found != end && found->node == f.node;
    const std::size_t index = has_contact ? std::size_t(found - nodes_.begin()) : nodes_.size();
    if (!has_contact) nodes_.push_back({f.node, true, 0, 0});
    Node& n = nodes_[index];
    n.fixed = true;
    n.velocity = at(free_motion, f.node);  // a handle that pushes into a collider yields to it
    for (std::size_t i = n.first; i < n.first + n.count; i++)
      n.velocity =
          resolve_contact(contacts_[i].contact, contacts_[i].friction, contacts_[i].normal, contacts_[i].velocity, n.velocity);
  }
  for (Node& n : nodes_) {
    if (!n.fixed)
      for (std::size_t i = n.first; i < n.first + n.count; i++) {
        Contact& c = contacts_[i];
        const Vector3 relative = at(free_motion, n.node) - c.velocity;
        const double inward = -relative.dot(c.normal);
        c.holds = c.contact != config::Contact::separate || c.normal.isZero() || inward > 0;
        c.sticks = c.contact == config::Contact::sticky || c.normal.isZero();
        if (c.sticks || !c.holds || c.friction == 0) continue;
        const Vector3 tangential = relative + inward * c.normal;
        const double stopped = c.friction * std::max(inward, 0.0), speed = tangential.norm();
        if (speed <= stopped)
          c.sticks = true;
        else
          c.friction_impulse = -(stopped * double(free_motion[4 * n.node]) / speed) * tangential;
      }
    constrain(n);
  }
}

template <class T, int D>
void ImplicitBoundary<T, D>::constrain(Node& n) {
  if (n.fixed) {
    n.free.setZero();
    return;
  }
  n.free.setIdentity();
  n.velocity.setZero();
  for (std::size_t i = n.first; i < n.first + n.count; i++)
    if (const Contact& c = contacts_[i]; c.holds && c.sticks) {
      n.free.setZero();
      n.velocity = c.velocity;
      return;
    }
  for (std::size_t i = n.first; i < n.first + n.count; i++) {
    const Contact& c = contacts_[i];
    if (!c.holds) continue;
    const Vector3 direction = n.free * c.normal;
    const double length = direction.norm();
    if (length < distinct) continue;
    const Vector3 e = direction / length;
    n.velocity += (c.velocity - n.velocity).dot(c.normal) / length * e;
    n.free -= e * e.transpose();
  }
}

template <class T, int D>
void ImplicitBoundary<T, D>::impose(T* velocity) const {
  for (const Node& n : nodes_) put(velocity, n.node, n.free * at(velocity, n.node) + n.velocity);
}

template <class T, int D>
void ImplicitBoundary<T, D>::project(T* vector) const {
  for (const Node& n : nodes_) put(vector, n.node, n.free * at(vector, n.node));
}

template <class T, int D>
void ImplicitBoundary<T, D>::add_friction(T* gradient) const {
  for (const Contact& c : contacts_)
    if (!c.friction_impulse.isZero()) put(gradient, c.node, at(gradient, c.node) - c.friction_impulse);
}

template <class T, int D>
double ImplicitBoundary<T, D>::friction_energy(const T* velocity) const {
  double sum = 0;
  for (const Contact& c : contacts_) sum -= c.friction_impulse.dot(at(velocity, c.node));
  return sum;
}

template <class T, int D>
bool ImplicitBoundary<T, D>::update(const T* velocity, const T* gradient, const T* mass, double error) {
  bool changed = false;
  for (Node& n : nodes_) {
    if (n.fixed) continue;
    bool other = false;
    const double m = double(mass[4 * n.node]), slack = std::sqrt(m) * error;
    const Vector3 v = at(velocity, n.node);
    Vector3 reaction = at(gradient, n.node);
    bool stuck = false;
    for (std::size_t i = n.first; i < n.first + n.count; i++) {
      Contact& c = contacts_[i];
      if (c.contact == config::Contact::sticky || c.normal.isZero()) {
        stuck = true;
        continue;
      }
      if (stuck) continue;
      const Vector3 relative = v - c.velocity;
      if (!c.holds) {
        if (relative.dot(c.normal) < -error / std::sqrt(m)) {
          c.holds = other = true;
          c.sticks = c.friction > 0;
        }
        continue;
      }
      const double normal = reaction.dot(c.normal);
      if (c.contact == config::Contact::separate && normal < -slack) {
        c.holds = c.sticks = false;
        c.friction_impulse.setZero();
        other = true;
        continue;
      }
      if (c.friction == 0) {
        reaction -= normal * c.normal;
        continue;
      }
      const double most = c.friction * std::max(normal, 0.0);
      if (c.sticks) {
        stuck = true;
        const Vector3 tangential = reaction - normal * c.normal;
        const double size = tangential.norm();
        if (size <= most + slack) continue;
        c.sticks = false;
        c.friction_impulse = most / size * tangential;
        other = true;
      } else {
        const Vector3 sliding = relative - relative.dot(c.normal) * c.normal;
        const double speed = sliding.norm();
        if (sliding.dot(c.friction_impulse) > 0 || speed == 0) {  // friction has turned the motion: it ends it
          c.sticks = other = true;
          c.friction_impulse.setZero();
          continue;
        }
        const Vector3 impulse = -most / speed * sliding;
        if ((impulse - c.friction_impulse).norm() > settled * most + slack) other = true;
        c.friction_impulse = impulse;
        reaction -= normal * c.normal;
      }
    }
    if (!other) continue;
    changed = true;
    constrain(n);
  }
  return changed;
}

template <class T, int D>
void ImplicitBoundary<T, D>::close(T* velocity) const {
  for (const Contact& c : contacts_) {
    if (c.holds || c.normal.isZero()) continue;
    const Vector3 v = at(velocity, c.node);
    const double inward = -(v - c.velocity).dot(c.normal);
    if (inward > 0) put(velocity, c.node, v + inward * c.normal);
  }
}

template <class T, int D>
std::vector<HeldNode> ImplicitBoundary<T, D>::held() const {
  std::vector<HeldNode> all;
  for (const Node& n : nodes_) {
    if (n.free.isZero()) {
      all.push_back({n.node, Vector3::Zero()});
      continue;
    }
    for (std::size_t i = n.first; i < n.first + n.count; i++)
      if (contacts_[i].holds) all.push_back({n.node, contacts_[i].normal});
  }
  return all;
}

template class ImplicitBoundary<float, 2>;
template class ImplicitBoundary<float, 3>;
template class ImplicitBoundary<double, 2>;
template class ImplicitBoundary<double, 3>;

}  // namespace cleave::mpm
