#pragma once

#include "../mpm/scenes.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace cleave::test {

/// A scene of one body with a constraint.
struct Constrained : PointScene {
  using PointScene::PointScene;

  void constrain(const std::string& id, const plugins::GivenParameters& parameters = {}) {
    config::Material& material = scene.materials[0];
    material.constraint.emplace();
    material.constraint->id = id;
    material.constraint->parameters = parameters;
  }
  void lay_fibers(const Vector3& direction) {
    scene.materials[0].fibers.emplace();
    scene.materials[0].fibers->direction = direction;
  }
  void hold(const Vector3& center, const Vector3& size) {
    config::Handle h;
    h.name = "handle-" + std::to_string(scene.handles.size());
    h.region.center = center;
    h.region.size = size;
    scene.handles.push_back(h);
  }
  void add_wall(const Vector3& point, const Vector3& normal, config::Contact contact) {
    scene.colliders.push_back(half_space(contact, normal, point));
  }
};

}  // namespace cleave::test
