#pragma once

#include "output/frame.hpp"

#include <set>
#include <string>
#include <vector>

namespace cleave::output {

/// Hands out names that every format accepts (letters, digits, underscores), each once: one already taken gets an underscore.
class UniqueNames {
 public:
  explicit UniqueNames(std::set<std::string> taken = {}) : taken_(std::move(taken)) {}
  std::string add(const std::string& wish);

 private:
  std::set<std::string> taken_;
};

/// What each attribute is called in every format. The names the formats use themselves (P, id, v, velocity, pscale, body, x, y,
/// z, vx, vy, vz, Cd, Color, red, green, blue) are taken.
std::vector<std::string> attribute_names(const ParticleFrame&);

/// "" for a scalar, x y z, xx yy zz xy xz yz, or xx xy xz yx ... zz; numbers from 0 for any other count.
std::vector<std::string> component_suffixes(int components);

/// Radius of the ball (2D: disk) of a particle's rest volume, m.
float particle_radius(float volume, int dimension);

/// Of one particle, with z = 0 in 2D.
inline Vector3 position_of(const ParticleFrame& frame, std::size_t particle) {
  Vector3 position = frame.positions[particle];
  if (frame.dimension == 2) position.z() = 0;
  return position;
}

}  // namespace cleave::output
