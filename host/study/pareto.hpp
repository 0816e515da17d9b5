#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace cleave::study {

/// Indices of the points that no other beats: none costs at most as much with at most the error, and less of one of them. By
/// rising cost. Points whose cost or error is not finite take no part.
std::vector<std::size_t> pareto_front(std::span<const double> costs, std::span<const double> errors);

/// Slope of log y over log x between the two points of the smallest |x|; NaN where there are none, or not positive.
double observed_order(std::span<const double> x, std::span<const double> y);

}  // namespace cleave::study
