#pragma once

#include "scene/shape.hpp"

namespace cleave::scene {

/// The primitive of `spec` (box, sphere, cylinder, capsule, torus, tube, half-space) without its transform: exact distances,
/// analytic normals. Throws InputError if a length is not positive or a direction is zero.
std::unique_ptr<SignedDistance> make_primitive(const ShapeSpec& spec);

}  // namespace cleave::scene
