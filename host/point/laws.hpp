#pragma once

#include "config/scene.hpp"
#include "plugins/registry.hpp"

#include <optional>
#include <string>
#include <vector>

namespace cleave::point {

/// The laws of a material as the command line names them.
struct LawChoice {
  std::string elasticity;
  std::optional<std::string> plasticity, damage;
  std::vector<std::string> sets;                   ///< "elasticity.youngs_modulus=1000"
  std::optional<std::string> fiber, second_fiber;  ///< "x,y,z", reference frame
  std::string precision = "double";
  double cell_size = 0;  ///< m, of lengths given in cells; 0: there is no grid
};

/// The laws of a material point with their parameters, checked against each other.
struct Laws {
  plugins::Instance elasticity, plasticity, damage;  ///< the latter two may be empty
  std::optional<config::Fibers> fibers;              ///< if given or needed; the second completes an orthonormal frame
  config::Precision precision = config::Precision::double_precision;
  double residual = 0;   ///< r of g(d) = (1-r)(1-d)^2 + r
  double viscosity = 0;  ///< eta of the evolution of damage [s]
  bool damage_is_local = false;
  double stiffness = 0;  ///< kappa + 4/3 mu of the elastic law at rest: what a stress is small against [Pa]

  double degradation(double d) const { return (1 - residual) * (1 - d) * (1 - d) + residual; }
  /// Damage of a uniform state after `seconds` of eta dd/dt = <(1 - d) D - d> at a constant driving force.
  double damage_after(double seconds, double damage, double driving_force) const;
};

/// Throws InputError that names the option at fault. What is worth a warning is appended to `warnings`.
Laws make_laws(const LawChoice&, plugins::Registry&, std::vector<std::string>& warnings);

/// Those of a material of a scene; of its fibers only uniform ones are known at a point. Throws InputError.
Laws laws_of(const config::Material&, config::Precision, plugins::Context surroundings, plugins::Registry&);

}  // namespace cleave::point
