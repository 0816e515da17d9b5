#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cleave {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;
using Index3 = Eigen::Vector3i;

/// Axis-aligned box, metres. Empty if min > max in any component; infinite extents are allowed (half-space).
using Box = Eigen::AlignedBox3d;

}  // namespace cleave
