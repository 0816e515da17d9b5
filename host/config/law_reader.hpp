#pragma once

#include "config/table_reader.hpp"

namespace cleave::config {

/// { plugin = "split-neo-hookean", youngs_modulus = .. }, checked against the plugin's schema. Empty if there is no such
/// plugin; the reasons are reported.
std::optional<PluginUse> read_law(TableReader, plugins::Kind);

/// What a message advises where laws do not work together; the defaults are the words of a scene file.
struct Remedies {
  const char* fiber = "add to the material: fibers = { direction = [1, 0, 0] }";
  const char* both_fibers = "add to the material: fibers = { direction = [1, 0, 0], second = [0, 1, 0] }";
  const char* second_fiber = "add 'second' to 'fibers'";
  const char* single_precision = "set simulation.precision = \"single\"";
  const char* double_precision = "set simulation.precision = \"double\"";
};

/// Whether the laws of a material work together, in the precision of the scene and with the fibers it has.
void check_combination(const Material&, Precision, ReadContext&, const Remedies& = {});

}  // namespace cleave::config
