#pragma once

#include "config/scene.hpp"
#include "mpm/bodies.hpp"
#include "mpm/time_step.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cleave::advise {

/// What a body is and has to bear.
struct BodyFacts {
  std::size_t material = 0;
  std::int64_t particles = 0;
  Box bounds;
  double thickness = 0;  ///< m, twice the depth of its innermost particle; 0 where it comes from a file of particles
  bool at_rest = true;   ///< no deformation is given
};

/// What moves, and how fast. Speeds and reach are upper bounds.
struct Motions {
  double speed = 0;         ///< m/s, of bodies, handles and colliders against each other
  double reach = 0;         ///< m that anything can go until the end
  double displacement = 0;  ///< m that handles and colliders move against each other; 0 where only one of them is there
};

/// Strain of a material: what is to be expected, and what it can hardly exceed.
struct Strain {
  double expected = 0, largest = 0;
};

/// What a law does with strained points, of whichever plugin: asked by evaluating it.
struct LawResponse {
  bool yields = false;
  double damage = 0;  ///< where damage comes to rest at the largest driving force, or what a local law gives
};

/// A parameter in metres that a damage law's length is proportional to.
struct LengthParameter {
  std::string key;
  double per_length = 1;
};

struct MaterialFacts {
  double stiffness = 0;   ///< kappa + 4/3 mu at rest [Pa]
  double wave_speed = 0;  ///< of pressure [m/s]
  Strain strain;
  std::optional<LawResponse> response;  ///< to the largest strain; empty where it cannot be foretold
  double length = 0;                    ///< l of damage, d - l^2 lap d = ... [m]; 0: none or local
  bool length_in_cells = false;         ///< it follows the cell size
  std::optional<LengthParameter> fixes_length;
  bool explicit_damage = false;
};

struct Facts {
  std::vector<BodyFacts> bodies;         ///< as in the scene
  std::vector<MaterialFacts> materials;  ///< as in the scene; nothing of those that a discretization steps
  std::vector<double> collider_gap;      ///< m between each collider and the nearest particle at the start
  Motions motions;
  std::int64_t particles = 0;
  mpm::Bound step{}, free_step{};  ///< at the start: of the scene, and without limits that the scene sets
  std::optional<mpm::Bound> implicit_step, symplectic_step;
  double bytes_per_particle = 0;
};

/// Samples the bodies, makes the laws and asks for the first step. Throws InputError.
Facts gather(const config::Scene&, plugins::Registry&);

/// Bytes that a scene takes at least, before anything is sampled: an estimate from the boxes of its shapes.
double least_memory(const config::Scene&);

/// Whether shape and fibers of all bodies are the same at every z between the ends of each, and what moves stays in the plane.
bool prismatic(const config::Scene&);

}  // namespace cleave::advise
