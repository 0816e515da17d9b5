#include "scene/blue_noise.hpp"

#include "scene/random.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace cleave::scene {
namespace {

/// Points of a torus sorted into buckets at least as wide as the distance at which they push each other.
class Torus {
 public:
  Torus(int dimension, double edge, double radius)
      : dimension_(dimension), edge_(edge), radius_(radius), buckets_(std::max(1, static_cast<int>(edge / radius))) {}

  void sort(const std::vector<Vector3>& points) {
    const std::size_t count = bucket_count();
    begins_.assign(count + 1, 0);
    bucket_of_.resize(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) ++begins_[(bucket_of_[i] = bucket_at(points[i])) + 1];
    std::partial_sum(begins_.begin(), begins_.end(), begins_.begin());
    sorted_.resize(points.size());
    std::vector<std::size_t> next(begins_.begin(), begins_.end() - 1);
    for (std::size_t i = 0; i < points.size(); ++i) sorted_[next[bucket_of_[i]]++] = points[i];
  }

  const std::vector<Vector3>& sorted() const { return sorted_; }

  /// Calls visit(difference to the neighbour, squared distance) for every other point nearer than the radius, in a fixed order.
  template <class Visit>
  void for_each_neighbour(std::size_t point, const Visit& visit) const {
    const Vector3& x = sorted_[point];
    const int i = bucket_index(x[0]), j = bucket_index(x[1]), k = dimension_ == 3 ? bucket_index(x[2]) : 0;
    const int reach = buckets_ >= 3 ? 1 : 0;  // narrower tori have no room for separate neighbours
    const int low = reach == 1 ? -1 : 0, high = reach == 1 ? 1 : buckets_ - 1;
    for (int dk = dimension_ == 3 ? low : 0; dk <= (dimension_ == 3 ? high : 0); ++dk) {
      for (int dj = low; dj <= high; ++dj) {
        for (int di = low; di <= high; ++di) {
          const std::size_t bucket = bucket_number(wrap(i + di), wrap(j + dj), dimension_ == 3 ? wrap(k + dk) : 0);
          for (std::size_t other = begins_[bucket]; other < begins_[bucket + 1]; ++other) {
            if (other == point) continue;
            Vector3 difference = sorted_[other] - x;
            for (double& component : difference) component -= edge_ * std::round(component / edge_);
            const double squared = difference.squaredNorm();
            if (squared < radius_ * radius_) visit(difference, squared);
          }
        }
      }
    }
  }

 private:
  std::size_t bucket_count() const { return static_cast<std::size_t>(std::pow(buckets_, dimension_) + 0.5); }
  int wrap(int i) const { return (i + buckets_) % buckets_; }
  int bucket_index(double x) const { return std::clamp(static_cast<int>(x / edge_ * buckets_), 0, buckets_ - 1); }
  std::size_t bucket_number(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(buckets_) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(buckets_) +
           static_cast<std::size_t>(i);
  }
  std::size_t bucket_at(const Vector3& x) const {
    return bucket_number(bucket_index(x[0]), bucket_index(x[1]), dimension_ == 3 ? bucket_index(x[2]) : 0);
  }

  int dimension_;
  double edge_, radius_;
  int buckets_;
  std::vector<std::size_t> begins_, bucket_of_;
  std::vector<Vector3> sorted_;
};

double wrapped(double x, double edge) {
  x -= edge * std::floor(x / edge);
  return x < edge ? x : 0.0;
}

}  // namespace

BlueNoiseTile make_blue_noise_tile(int points_per_cell, int dimension, std::uint64_t seed) {
  constexpr double enough_points = 32768;  // the pattern repeats so far apart that it shows nowhere
  constexpr int most_sweeps = 400;
  BlueNoiseTile tile;
  tile.dimension = dimension;
  tile.cells = std::max(4, static_cast<int>(std::lround(std::pow(enough_points / points_per_cell, 1.0 / dimension))));
  const double edge = tile.cells;
  const double spacing = std::pow(points_per_cell, -1.0 / dimension);
  const double radius = (dimension == 3 ? 0.85 : 0.80) * spacing;

  std::vector<Vector3> points;
  const int layers = dimension == 3 ? tile.cells : 1;
  for (int k = 0; k < layers; ++k) {
    for (int j = 0; j < tile.cells; ++j) {
      for (int i = 0; i < tile.cells; ++i) {
        for (int p = 0; p < points_per_cell; ++p) {
          const auto within = [&](int axis) { return hashed_uniform(seed, i, j, k, p, axis); };
          points.emplace_back(i + within(0), j + within(1), dimension == 3 ? k + within(2) : 0.0);
        }
      }
    }
  }

  Torus torus(dimension, edge, radius);
  for (int sweep = 0;; ++sweep) {
    torus.sort(points);
    const double nearest = tbb::parallel_deterministic_reduce(
        tbb::blocked_range<std::size_t>(0, points.size(), 1024), std::numeric_limits<double>::infinity(),
        [&](const tbb::blocked_range<std::size_t>& range, double least) {
          for (std::size_t i = range.begin(); i != range.end(); ++i) {
            Vector3 push = Vector3::Zero();
            torus.for_each_neighbour(i, [&](const Vector3& difference, double squared) {
              least = std::min(least, squared);
              const double distance = std::sqrt(squared);
              if (distance > 0) push -= 0.5 * (radius - distance) / distance * difference;
            });
            const Vector3 moved = torus.sorted()[i] + push;
            for (int axis = 0; axis < 3; ++axis) points[i][axis] = axis < dimension ? wrapped(moved[axis], edge) : 0.0;
          }
          return least;
        },
        [](double a, double b) { return std::min(a, b); });
    tile.minimum_distance = std::min(std::sqrt(nearest), radius);
    if (tile.minimum_distance >= 0.98 * radius || sweep == most_sweeps) break;
  }

  const auto cell_of = [&](const Vector3& x) {
    const auto coordinate = [&](int axis) {
      return static_cast<std::size_t>(std::min<int>(static_cast<int>(x[axis]), tile.cells - 1));
    };
    const auto n = static_cast<std::size_t>(tile.cells);
    return ((dimension == 3 ? coordinate(2) : 0) * n + coordinate(1)) * n + coordinate(0);
  };
  tile.cell_begins.assign(static_cast<std::size_t>(layers) * static_cast<std::size_t>(tile.cells * tile.cells) + 1, 0);
  for (const Vector3& x : torus.sorted()) ++tile.cell_begins[cell_of(x) + 1];
  std::partial_sum(tile.cell_begins.begin(), tile.cell_begins.end(), tile.cell_begins.begin());
  std::vector<std::size_t> next(tile.cell_begins.begin(), tile.cell_begins.end() - 1);
  tile.points.resize(points.size());
  for (const Vector3& x : torus.sorted()) tile.points[next[cell_of(x)]++] = x - x.array().floor().matrix();
  return tile;
}

}  // namespace cleave::scene
