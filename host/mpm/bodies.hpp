#pragma once

#include "config/scene.hpp"
#include "scene/sampling.hpp"

#include <string>
#include <vector>

namespace cleave::mpm {

/// A body of the scene as particles, before they are handed to a material's storage.
struct SampledBody {
  std::string name;
  std::size_t material = 0;                     ///< index into the scene's materials
  scene::ParticleSource particles;              ///< velocities filled in (body velocity, spin), deformation possibly empty
  Matrix3 velocity_gradient = Matrix3::Zero();  ///< of the initial motion, 1/s
  scene::FiberField fibers;                     ///< empty if neither the body nor its material has fibers
  std::vector<double> toughness;                ///< factor on the damage law's toughness, per particle; empty: 1
};

/// Samples or reads every body. Throws InputError naming the body.
std::vector<SampledBody> sample_bodies(const config::Scene&);

}  // namespace cleave::mpm
