#pragma once

#include "mpm/simulation.hpp"

namespace cleave::discretization {

/// A scene in motion, whatever steps its bodies: the material point method, discretization plugins, or both side by side, with
/// the same steps. Ids, and the list of bodies, begin with those of the material point method. Throws InputError.
std::unique_ptr<mpm::Simulation> simulate(const config::Scene&, plugins::Registry&);

}  // namespace cleave::discretization
