#pragma once

#include "config/table_reader.hpp"

namespace cleave::config {

/// { plugin = "split-neo-hookean", youngs_modulus = .. }, checked against the plugin's schema. Empty if there is no such
/// plugin; the reasons are reported.
std::optional<PluginUse> read_law(TableReader, plugins::Kind);

/// Whether the laws of a material work together, in the precision of the scene and with the fibers it has.
void check_combination(const Material&, Precision, ReadContext&);

}  // namespace cleave::config
