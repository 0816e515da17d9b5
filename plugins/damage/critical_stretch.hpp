/// The tensile energy density at a critical stretch, by which demos of the papers give the toughness of a material.
#ifndef CLEAVE_PLUGINS_DAMAGE_CRITICAL_STRETCH_HPP
#define CLEAVE_PLUGINS_DAMAGE_CRITICAL_STRETCH_HPP

#include <cleave/parameters.hpp>

namespace cleave {

/// Below, the energy is lost in the rounding errors of energies of order kappa.
inline constexpr Bounds resolvable_stretch = at_least(1e-6);

/// psi_plus((1 + x) I) [J/m^3] of the material's elastic law, for the parameter `critical_stretch` = x.
inline double energy_at_critical_stretch(double x, const Surroundings& surroundings) {
  if (!surroundings.elastic) throw ParameterError{"critical_stretch", "needs the elastic law of the material for its energy"};
  const double energy = surroundings.elastic.tensile_energy_at_stretch(1 + x);
  if (energy > 0 && std::isfinite(energy)) return energy;
  throw ParameterError{"critical_stretch", "needs an elastic law that has a tensile energy at this stretch"};
}

}  // namespace cleave

#endif
