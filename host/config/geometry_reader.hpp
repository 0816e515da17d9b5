#pragma once

#include "config/table_reader.hpp"

namespace cleave::config {

/// { type = "sphere", center = [..], radius = .. }: a shape tree. Empty if it cannot be used; the reasons are reported.
std::optional<scene::ShapeSpec> read_shape(TableReader);

/// Where and how large the contents of a file are: file_size, centered, center, scale, rotate, translate.
void read_place_of_file(TableReader&, scene::ShapeSpec&);

/// { velocity, angular_velocity, center, start, end } or { center, keyframes }.
scene::RigidMotion read_motion(TableReader);

/// Angular velocity (degrees/s in the file, rad/s here): a number about z in 2D, a list of 3 in 3D.
/// The same form holds for rotation vectors ("degrees").
std::optional<Vector3> read_rotation(TableReader&, std::string_view key, const std::string& unit);

/// Word of the file for a shape type, and the types in the order of the enumeration.
const std::vector<std::string>& shape_names();

}  // namespace cleave::config
