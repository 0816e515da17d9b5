#include "contact.hpp"

#include <atomic>

namespace cleave::peridynamics {
namespace {

constexpr std::uint64_t grain = 2048;
constexpr double closing = 1.1;  ///< contacts within so many times their distance are about to close

const Contact::Body& body_of(std::span<const Contact::Body> bodies, std::size_t point) {
  const auto after = [](std::size_t p, const Contact::Body& body) { return p < body.last; };
  return *std::upper_bound(bodies.begin(), bodies.end(), point, after);
}

}  // namespace

bool Contact::moved(const Threads& threads, std::span<const double> position) const {
  if (near_position_.size() != position.size()) return true;
  std::atomic<bool> far = false;
  threads.for_ranges(position.size() / 3, grain, [&](std::uint64_t first, std::uint64_t last) {
    double most = 0;
    for (std::size_t i = first; i < last; ++i) {
      double square = 0;
      for (std::size_t a = 0; a < 3; ++a) {
        const double d = position[3 * i + a] - near_position_[3 * i + a];
        square += d * d;
      }
      most = std::max(most, square);
    }
    if (most > 0.25 * slack_ * slack_) far = true;
  });
  return far;
}

void Contact::find_neighbours(std::span<const Body> bodies, std::span<const double> position) {
  double largest = 0, smallest = HUGE_VAL;
  for (const Body& body : bodies) {
    largest = std::max(largest, body.spacing);
    smallest = std::min(smallest, body.spacing);
  }
  slack_ = 0.3 * smallest;
  reach_ = closing * distance_ * largest + slack_;
  near_position_.assign(position.begin(), position.end());
  cells_.emplace(position, reach_);
  pairs_.resize(position.size() / 3);
}

void Contact::find_pairs(std::span<const Body> bodies, std::uint32_t i, bool with_bonds) {
  const Body& body = body_of(bodies, i);
  pairs_[i].with_bonds = with_bonds;
  auto& pairs = pairs_[i].list;
  pairs.clear();
  const double* at = &near_position_[3 * std::size_t(i)];
  cells_->near(at, [&](std::uint32_t j) {
    double square = 0;
    for (std::size_t a = 0; a < 3; ++a) {
      const double d = near_position_[3 * std::size_t(j) + a] - at[a];
      square += d * d;
    }
    if (j == i || !(square < reach_ * reach_)) return;
    const bool same = j >= body.first && j < body.last;
    Pair pair{j, false, distance_ * body.spacing, 0};
    if (same) {
      if (const auto bond = body.solid->bond(i - body.first, j - body.first)) {
        if (!with_bonds) return;
        pair = {j, true, std::min(pair.distance, bond->rest_length), bond->slot};
      }
    } else {
      pair.distance = 0.5 * distance_ * (body.spacing + body_of(bodies, j).spacing);
    }
    pairs.push_back(pair);
  });
  std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) { return a.other < b.other; });
}

void Contact::push(const Threads& threads, std::span<const Body> bodies, std::span<const double> position,
                   std::span<const double> damage, std::span<double> force) {
  if (moved(threads, position)) {
    find_neighbours(bodies, position);
    threads.for_ranges(pairs_.size(), grain, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t k = first; k < last; ++k) {
        const std::uint32_t i = cells_->point(k);
        find_pairs(bodies, i, damage[i] > 0);
      }
    });
  }
  std::vector<double> stiffest((pairs_.size() + grain - 1) / grain);
  threads.for_ranges(pairs_.size(), grain, [&](std::uint64_t first, std::uint64_t last) {
    for (std::uint64_t i = first; i < last; ++i) {
      if (damage[i] > 0 && !pairs_[i].with_bonds) find_pairs(bodies, std::uint32_t(i), true);
      if (pairs_[i].list.empty()) continue;
      const Body& body = body_of(bodies, i);
      double sum = 0;
      for (const Pair& pair : pairs_[i].list) {
        double y[3], square = 0;
        for (std::size_t a = 0; a < 3; ++a) {
          y[a] = position[3 * std::size_t(pair.other) + a] - position[3 * i + a];
          square += y[a] * y[a];
        }
        const double length = std::sqrt(square);
        if (length >= closing * pair.distance || (pair.bonded && body.solid->intact(pair.slot))) continue;
        const double stiffness = bulk_ * (dimension_ == 3 ? pair.distance / distance_ : 1);
        sum += stiffness;
        if (length >= pair.distance || length == 0) continue;
        for (std::size_t a = 0; a < 3; ++a) force[3 * i + a] -= stiffness * (pair.distance - length) * y[a] / length;
      }
      stiffest[first / grain] = std::max(stiffest[first / grain], sum);
    }
  });
  stiffness_ = 0;
  for (const double sum : stiffest) stiffness_ = std::max(stiffness_, sum);
}

}  // namespace cleave::peridynamics
