#pragma once

#include "output/frame.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace cleave::output {

/// The surface of a body's particles as triangles.
struct SurfaceMesh {
  std::vector<Eigen::Vector3f> vertices, normals;  ///< m; unit, outwards
  std::vector<std::uint32_t> triangles;            ///< 3 vertices each
};

/// Distance of neighbouring particles of a body: the edge of a cube (2D: square) of the median of their rest volumes, m.
double particle_spacing(const ParticleFrame&, std::size_t body);

/// Zero set of the level set that write_surface_vdb() writes, its voxels `coarseness` times as wide. Particles whose places are
/// not finite, or more than 2^22 voxels from the origin, are left out.
SurfaceMesh surface_mesh(const ParticleFrame&, std::size_t body, double coarseness = 1);

/// A quantity of a body's particles at other places, `components` numbers each: the mean over particles within 1.5 spacings,
/// with weights (1 - (r/R)^2)^2; zeros where there are none.
std::vector<float> interpolate(const ParticleFrame&, std::size_t body, std::span<const float> values, int components,
                               std::span<const Eigen::Vector3f> places);

}  // namespace cleave::output
