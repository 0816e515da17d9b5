#include "study/pareto.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace cleave::study {

std::vector<std::size_t> pareto_front(std::span<const double> costs, std::span<const double> errors) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < costs.size(); ++i)
    if (std::isfinite(costs[i]) && std::isfinite(errors[i])) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return costs[a] != costs[b] ? costs[a] < costs[b] : errors[a] < errors[b];
  });
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    const bool better = front.empty() || errors[i] < (1 - as_accurate) * errors[front.back()];
    const bool equal = !front.empty() && errors[i] == errors[front.back()] && costs[i] == costs[front.back()];
    if (better || equal) front.push_back(i);
  }
  return front;
}

double observed_order(std::span<const double> x, std::span<const double> y) {
  std::vector<std::size_t> order(x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return std::abs(x[a]) < std::abs(x[b]); });
  if (order.size() < 2) return std::numeric_limits<double>::quiet_NaN();
  const std::size_t fine = order[0], coarse = order[1];
  if (!(x[fine] > 0 && y[fine] > 0 && y[coarse] > 0 && x[coarse] > x[fine])) return std::numeric_limits<double>::quiet_NaN();
  return std::log(y[coarse] / y[fine]) / std::log(x[coarse] / x[fine]);
}

}  // namespace cleave::study
