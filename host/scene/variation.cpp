#include "scene/variation.hpp"

#include "common/error.hpp"
#include "scene/random.hpp"

#include <spdlog/fmt/fmt.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace cleave::scene {
namespace {

using Lattice = Eigen::Matrix<std::int64_t, 3, 1>;

/// Random numbers of a lattice cube: how many seeds it holds, and where and what each is.
enum Purpose { count_of_seeds, place_of_seed, value_of_seed };

/// A number with the Poisson distribution of mean 1, by inversion.
int poisson(double uniform) {
  int n = 0;
  double probability = std::exp(-1.0);
  for (double sum = probability; uniform >= sum && n < 16; sum += probability) probability /= ++n;
  return n;
}

/// Value of the Voronoi cell that holds x, lengths in units of the spacing. Seeds are drawn lattice cube by lattice cube.
class Voronoi {
 public:
  Voronoi(std::uint64_t seed, int dimension) : seed_(seed), dimension_(dimension) {}

  double operator()(const Vector3& x) const {
    Lattice home = Lattice::Zero();
    for (int axis = 0; axis < dimension_; ++axis) home[axis] = static_cast<std::int64_t>(std::floor(x[axis]));
    Nearest nearest;
    // Cubes at least `ring` cubes away hold no seed nearer than ring - 1.
    for (std::int64_t ring = 0; ring < 1 || nearest.distance2 > double((ring - 1) * (ring - 1)); ++ring)
      visit_ring(home, ring, x, nearest);
    return nearest.value;
  }

 private:
  struct Nearest {
    double distance2 = std::numeric_limits<double>::infinity();
    double value = 0;
  };

  void visit_ring(const Lattice& home, std::int64_t ring, const Vector3& x, Nearest& nearest) const {
    const std::int64_t depth = dimension_ == 3 ? ring : 0;
    for (std::int64_t k = -depth; k <= depth; ++k)
      for (std::int64_t j = -ring; j <= ring; ++j) {
        const bool on_side = std::abs(k) == ring || std::abs(j) == ring;
        for (std::int64_t i = -ring; i <= ring; i += on_side || ring == 0 ? 1 : 2 * ring)
          visit(home + Lattice(i, j, k), x, nearest);
      }
  }

  void visit(const Lattice& cube, const Vector3& x, Nearest& nearest) const {
    double gap2 = 0;
    for (int axis = 0; axis < dimension_; ++axis) {
      const double low = static_cast<double>(cube[axis]);
      const double gap = std::max({low - x[axis], x[axis] - low - 1, 0.0});
      gap2 += gap * gap;
    }
    if (gap2 >= nearest.distance2) return;
    const int seeds = poisson(hashed_uniform(seed_, cube[0], cube[1], cube[2], count_of_seeds));
    for (int s = 0; s < seeds; ++s) {
      double distance2 = 0;
      for (int axis = 0; axis < dimension_; ++axis) {
        const double within = hashed_uniform(seed_, cube[0], cube[1], cube[2], place_of_seed, s, axis);
        const double d = static_cast<double>(cube[axis]) + within - x[axis];
        distance2 += d * d;
      }
      if (distance2 >= nearest.distance2) continue;
      nearest.distance2 = distance2;
      nearest.value = hashed_uniform(seed_, cube[0], cube[1], cube[2], value_of_seed, s);
    }
  }

  std::uint64_t seed_;
  int dimension_;
};

/// A stationary Gaussian field by its spectral representation (Shinozuka and Deodatis 1991),
///   f(x) = sqrt(2/N) sum_n cos(k_n . x + phi_n),  k_n normal with variance 2 in each component,
/// whose correlation is exp(-r^2); its distribution function takes it to equally likely values in (0, 1).
class Noise {
 public:
  Noise(std::uint64_t seed, int dimension) {
    for (int n = 0; n < waves; ++n) {
      phase_[n] = 2 * std::numbers::pi * hashed_uniform(seed, n, 0);
      wave_[n] = Vector3::Zero();
      for (int axis = 0; axis < dimension; ++axis) {  // Box and Muller 1958
        const double radius = std::sqrt(-2 * std::log1p(-hashed_uniform(seed, n, 1, axis)));
        wave_[n][axis] = std::numbers::sqrt2 * radius * std::cos(2 * std::numbers::pi * hashed_uniform(seed, n, 2, axis));
      }
    }
  }

  double operator()(const Vector3& x) const {
    double sum = 0;
    for (int n = 0; n < waves; ++n) sum += std::cos(wave_[n].dot(x) + phase_[n]);
    return 0.5 * std::erfc(-sum / std::sqrt(double(waves)));
  }

 private:
  static constexpr int waves = 128;
  Vector3 wave_[waves];
  double phase_[waves];
};

template <class Pattern>
std::vector<double> sample(const Pattern& pattern, const VariationSpec& spec, const std::vector<Vector3>& positions) {
  std::vector<double> factors(positions.size());
  tbb::parallel_for(std::size_t{0}, positions.size(), [&](std::size_t i) {
    const double value = pattern(Vector3(positions[i] / spec.size));
    factors[i] = std::clamp(spec.minimum + value * (spec.maximum - spec.minimum), spec.minimum, spec.maximum);
  });
  return factors;
}

}  // namespace

std::vector<double> sample_variation(const VariationSpec& spec, const std::vector<Vector3>& positions, int dimension) {
  double farthest = 0;
  for (const Vector3& x : positions) farthest = std::max(farthest, x.head(dimension).cwiseAbs().maxCoeff());
  if (!(farthest / spec.size < 1e9))
    throw InputError(fmt::format("the size of the variation, {:.4g} m, is too small for a body that reaches to {:.4g} m",
                                 spec.size, farthest));
  return spec.pattern == VariationSpec::Pattern::voronoi ? sample(Voronoi(spec.seed, dimension), spec, positions)
                                                         : sample(Noise(spec.seed, dimension), spec, positions);
}

}  // namespace cleave::scene
