#pragma once

#include "plugins/registry.hpp"

namespace cleave::benchmarks {

void register_return_mappings(plugins::Registry&);
/// Whether the iterative returns agree.
bool same_returns(plugins::Registry&);

}  // namespace cleave::benchmarks
