#pragma once

#include "point/evaluator.hpp"

#include <functional>
#include <string>
#include <vector>

namespace cleave::point {

enum class PathKind { uniaxial_strain, uniaxial_stress, simple_shear, hydrostatic, triaxial };

/// The words of the command line, in the order of the enumeration.
const std::vector<std::string>& path_names();

struct LoadPath {
  PathKind kind = PathKind::uniaxial_strain;
  double amplitude = 0;    ///< engineering strain along axis 0 (stretch - 1); of simple shear gamma = F01
  int steps = 100;         ///< equal increments from 0 to the amplitude
  double confinement = 0;  ///< Pa, Cauchy pressure of a triaxial path
};

/// One point of a path. Where no state could be found, unknown components are NaN and the response says why.
struct PathPoint {
  int step = 0;
  Matrix3 deformation = Matrix3::Identity();  ///< total F
  double damage = 0;
  Response response;
};

/// Drives one material point from rest along a path, slowly, and reports step 0 (rest, or the confined state) and every step
/// after it. The elastic F of a step is multiplied by the increment of the total F, so plastic flow and history accumulate.
///
/// Stress-controlled components are those of Cauchy stress. The unknown F is upper triangular, which fixes the rotation: axis 0
/// keeps its direction. They are found by Newton's method with a differenced tangent and a line search; a step that finds no
/// state, or in which a law asks for a smaller one, is halved (up to 8 times).
///
/// Damage is in equilibrium at a uniform state, d = D/(1+D), and never heals; a local law's own d is taken.
///
/// Ends early, after reporting the point, if a step has no usable state. Returns whether the path was completed.
bool drive(const Laws&, Evaluator&, const LoadPath&, const std::function<void(const PathPoint&)>& report);

}  // namespace cleave::point
