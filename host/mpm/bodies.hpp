#pragma once

#include "config/scene.hpp"
#include "scene/sampling.hpp"
#include "scene/tetrahedral_mesh.hpp"

#include <optional>
#include <string>
#include <vector>

namespace cleave::mpm {

/// A body of the scene as particles, before they are handed to a material's storage.
struct SampledBody {
  std::string name;
  std::size_t material = 0;         ///< index into the scene's materials
  scene::ParticleSource particles;  ///< velocities and deformation possibly empty
  /// Where there are no velocities: velocity + angular_velocity x (position - center)
  Vector3 velocity = Vector3::Zero(), angular_velocity = Vector3::Zero(), center = Vector3::Zero();
  Matrix3 velocity_gradient = Matrix3::Zero();  ///< of the initial motion, 1/s
  scene::FiberField fibers;                     ///< empty if neither the body nor its material has fibers
  std::vector<double> toughness;                ///< factor on the damage law's toughness, per particle; empty: 1
  /// Of a body of tetrahedra, whose particles are their barycentres in the same order.
  std::optional<scene::TetrahedralMesh> mesh;
  std::vector<Vector3> vertex_velocities;  ///< m/s, of the vertices of the mesh; filled by sample_bodies()

  Vector3 velocity_of(std::size_t particle) const;
  Vector3 velocity_at(const Vector3&) const;  ///< of the initial motion as a rigid body
};

/// Samples or reads a body. Throws InputError naming it.
SampledBody sample_body(const config::Scene&, const config::Body&);
/// All bodies, with the velocity of each particle.
std::vector<SampledBody> sample_bodies(const config::Scene&);

}  // namespace cleave::mpm
