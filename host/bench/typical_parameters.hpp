#pragma once

#include "plugins/schema.hpp"

#include <string>
#include <vector>

namespace cleave::bench {

/// Values for the parameters that a law wants to be given, from its schema alone, most ordinary first: the middle of what
/// materials have, then other places in that range, for every alternative set in turn. What is in `given` is kept.
///
/// What is in Pa becomes `stress` and what is in J/m^3 a hundredth of it, if it is not 0: laws other than elastic ones have
/// strengths, which go with the stiffness of the material.
std::vector<plugins::GivenParameters> typical_parameters(const plugins::Description&, const plugins::GivenParameters& given,
                                                         double stress);

/// The parameters by which a law comes to read fibres, where it does not by default; empty if there are none.
plugins::GivenParameters fiber_parameters(const plugins::Description&);

}  // namespace cleave::bench
