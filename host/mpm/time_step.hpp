#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <string>

namespace cleave::mpm {

/// A candidate for the step size and what it protects.
struct Bound {
  double seconds;
  const char* name;
};

/// Splits the time to a target into equal steps not larger than the bound, so that frames never leave a tiny remainder.
/// A bound that divides the time to a part in a million is used as it is.
inline double equal_steps(double remaining, double bound) {
  const double ratio = remaining / bound, nearest = std::round(ratio);
  if (nearest >= 1 && std::abs(ratio - nearest) < 1e-6 * nearest) return nearest == 1 ? remaining : bound;
  return ratio <= 1 ? remaining : remaining / std::ceil(ratio);
}

}  // namespace cleave::mpm
