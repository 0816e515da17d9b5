#pragma once

#include "config/scene.hpp"
#include "mpm/bodies.hpp"

#include <cleave/discretization.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace cleave::discretization {

/// What a plugin may ask of the scene during a step: gravity, colliders, and where handles take its points.
class Surroundings {
 public:
  /// `bodies` as the plugin numbers them.
  Surroundings(const config::Scene&, const std::vector<mpm::SampledBody>& bodies);
  Surroundings(const Surroundings&) = delete;
  Surroundings& operator=(const Surroundings&) = delete;

  /// How many of the points each handle of the scene holds; of a body whose vertices it holds and no point, the vertices.
  const std::vector<std::size_t>& held() const { return held_; }
  /// For the step from `time` to `time + time_step`; valid until the next call, for any number of threads.
  const cleave_surroundings* during(double time, double time_step);

 private:
  static constexpr std::uint16_t none = 0xffff;
  using Pose = scene::RigidMotion::Pose;

  struct Collider {
    config::Collider spec;
    std::unique_ptr<scene::SignedDistance> shape;
    Pose pose;  ///< at the end of the step
  };
  struct HandlePoses {
    bool active;
    Pose before, after;
  };
  /// Which handle holds each of a body's points, or vertices, and their place in its region; empty if none holds any.
  struct Held {
    std::vector<std::uint16_t> handle;
    std::vector<Vector3> place;
  };
  struct HeldBody {
    Held points, vertices;
  };
  /// Returns how many of the places, that nothing holds yet, the region does.
  static std::size_t hold(Held&, std::uint16_t handle, const scene::SignedDistance& region, const Pose& start,
                          const std::vector<Vector3>& places);

  static void collide(void* self, std::uint64_t count, const double* position, double* velocity);
  static std::int32_t handle(void* self, std::uint64_t body, std::uint32_t entity, std::uint64_t index, double* position,
                             double* velocity);

  int dimension_;
  std::vector<Collider> colliders_;
  std::vector<config::Handle> handles_;
  std::vector<HeldBody> bodies_;
  std::vector<std::size_t> held_;
  std::vector<HandlePoses> poses_;
  double time_step_ = 0;
  cleave_surroundings table_{};
};

}  // namespace cleave::discretization
