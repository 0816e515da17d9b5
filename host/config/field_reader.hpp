#pragma once

#include "config/table_reader.hpp"

namespace cleave::config {

/// { layout = "helical", center = [..], axis = [..], angle = .. }: how the fibers of a body lie. Empty if it cannot be used;
/// the reasons are reported.
std::optional<Fibers> read_fibers(TableReader);

/// { pattern = "voronoi", size = .., minimum = .., maximum = .., seed = .. }. Empty if it cannot be used.
std::optional<scene::VariationSpec> read_variation(TableReader);

/// Words of the file for layouts and patterns, in the order of the enumerations.
const std::vector<std::string>& layout_names();
const std::vector<std::string>& pattern_names();

}  // namespace cleave::config
