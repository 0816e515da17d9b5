#pragma once

#include "config/table_reader.hpp"

namespace cleave::config {

/// { edge_length = .., method = "lattice" } of a body with a shape, or { file = .., file_size = .., .. } of one without. Empty
/// if it cannot be used; the reasons are reported.
std::optional<scene::TetrahedraSpec> read_tetrahedra(TableReader);

/// Words of the file for methods, in the order of the enumeration.
const std::vector<std::string>& method_names();

}  // namespace cleave::config
