#pragma once

#include "scene/shape.hpp"

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cleave::scene {

enum class SamplingPattern {
  regular,    ///< the centres of equal sub-cells of the grid
  jittered,   ///< the same, each moved at random inside its sub-cell
  blue_noise  ///< random with a minimum distance (Poisson disk), density as asked
};

struct SamplingSpec {
  SamplingPattern pattern = SamplingPattern::jittered;
  int particles_per_cell = 8;  ///< regular, jittered: a perfect cube (3D) or square (2D), checked by the configuration
  double jitter = 1.0;         ///< jittered: fraction of the sub-cell, 0..1
  std::uint64_t seed = 1;
};

/// Initial particles of one body, structure of arrays. Optional arrays are empty if the source did not give them.
struct ParticleSource {
  std::vector<Vector3> positions;                     ///< m
  std::vector<double> volumes;                        ///< m^3 (2D: m^2)
  std::vector<Vector3> velocities;                    ///< m/s; empty: the body's
  std::vector<Matrix3> deformation;                   ///< F; empty: identity
  std::map<std::string, std::vector<double>> states;  ///< by column name of a particle file
};

/// Fills the inside of a shape with particles of equal volume, in a reproducible order (same seed, same particles, whatever
/// the number of threads). In 2D the plane z = 0 is filled. The grid has nodes at multiples of cell_size.
/// Every particle has the volume cell_size^dimension / particles_per_cell, which also is the density of each pattern, so that
/// the volumes add up to the shape's as cells get smaller.
/// Throws InputError if the shape is unbounded or holds no particle.
ParticleSource sample(const SignedDistance&, const SamplingSpec&, double cell_size, int dimension);

/// Reads a particle file: CSV with a header, columns x,y,z (z optional in 2D), then any of vx,vy,vz, volume, F00..F22, and
/// state variables by name. Lines starting with '#' are skipped. Of a deformation gradient, 3D needs all nine components and 2D
/// the four in the plane; in 2D everything out of the plane but F22 must be 0. `default_volume` applies where there is no
/// volume column. Throws InputError with file:line and column name.
ParticleSource read_particles(const std::filesystem::path&, int dimension, double default_volume);

}  // namespace cleave::scene
