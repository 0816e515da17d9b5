#pragma once

#include "common/types.hpp"

#include <span>
#include <vector>

namespace cleave::output {

/// Damage from which a particle counts as broken: (1 - d)^2, what is left of its stiffness, is a hundredth.
inline constexpr float broken_damage = 0.9f;

/// The points x with |radii^-1 axes^T (x - center)| < 1.
struct Ellipsoid {
  Eigen::Vector3f center, radii;  ///< m
  Eigen::Matrix3f axes;           ///< columns, orthonormal
};

/// An ellipsoid for each particle, whose union is a body without the bumps of single particles: its axes and their lengths are
/// the weighted principal components of the places of its neighbours, and its center is halfway to their weighted mean
/// (J. Yu, G. Turk, "Reconstructing surfaces of particle-based fluids using anisotropic kernels", ACM Transactions on Graphics
/// 32(1), 2013, Equations 6 and 9-11; with standard deviations in place of variances as lengths). Lengths are such that the
/// union ends half a spacing beyond the outermost particles and has no holes.
///
/// Cracks stay open: a broken particle is a small ball of its own and no neighbour, and neither are two particles neighbours
/// between which a broken one lies. `damage` may be empty: nothing is broken. `spacing`: mean distance of particles, m.
std::vector<Ellipsoid> particle_ellipsoids(std::span<const Eigen::Vector3f> places, std::span<const float> damage,
                                           float spacing);

}  // namespace cleave::output
