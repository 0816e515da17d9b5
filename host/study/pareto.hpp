#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace cleave::study {

/// Errors that differ by less than this part are taken for the same.
inline constexpr double as_accurate = 0.01;

/// Indices of the points that none beats which costs at most as much and is as accurate. By rising cost. Points whose cost or
/// error is not finite take no part.
std::vector<std::size_t> pareto_front(std::span<const double> costs, std::span<const double> errors);

/// Slope of log y over log x between the two points of the smallest |x|; NaN where there are none, or not positive.
double observed_order(std::span<const double> x, std::span<const double> y);

}  // namespace cleave::study
