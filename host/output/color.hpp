#pragma once

#include "output/frame.hpp"

#include <optional>
#include <string>

namespace cleave::output {

/// What particles and meshes are coloured by.
struct ColorBy {
  std::string name;  ///< "body", "speed", or an attribute: its value, the length of a vector, the Frobenius norm of a tensor
  std::optional<std::pair<double, double>> range;  ///< shown from the first to the last colour; not of "body" and "piece"
  bool operator==(const ColorBy&) const = default;
};

/// The viridis map of Matplotlib (N. Smith, S. van der Walt; CC0) through ten of its colours, for x in [0, 1]; grey for what is
/// not a number.
Color viridis(double x);
/// One of eight colours that people who see few of them tell apart (M. Okabe, K. Ito 2008); grey for -1.
Color color_of_number(std::int64_t);

/// Gives particles, and vertices of meshes where they have what is asked for, their colours. Without a range it is [0, 1] for
/// damage. Throws InputError if frames do not hold the attribute or have no range for it.
void color(ParticleFrame&, const ColorBy&);

}  // namespace cleave::output
