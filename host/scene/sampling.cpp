#include "scene/sampling.hpp"

#include "common/error.hpp"
#include "common/memory.hpp"
#include "scene/blue_noise.hpp"
#include "scene/random.hpp"

#include <spdlog/fmt/fmt.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace cleave::scene {
namespace {

using Lattice = Eigen::Matrix<std::int64_t, 3, 1>;

/// One point in each cube of a lattice with nodes at multiples of `edge`, at its centre or moved at random.
struct JitteredPattern {
  int dimension;
  double edge;
  double jitter;  ///< 0: regular
  std::uint64_t seed;

  double points_per_cube() const { return 1; }
  template <class Emit>
  void points_in(const Lattice& cube, const Emit& emit) const {
    Vector3 x = Vector3::Zero();
    for (int axis = 0; axis < dimension; ++axis) {
      double within = 0.5;
      if (jitter > 0) within += jitter * (hashed_uniform(seed, cube[0], cube[1], cube[2], axis) - 0.5);
      x[axis] = (static_cast<double>(cube[axis]) + within) * edge;
    }
    emit(x);
  }
};

/// The points of a blue noise tile repeated over space, a grid cell at a time.
struct BlueNoisePattern {
  const BlueNoiseTile& tile;
  double edge;

  double points_per_cube() const { return double(tile.points.size()) / double(tile.cell_begins.size() - 1); }

  template <class Emit>
  void points_in(const Lattice& cell, const Emit& emit) const {
    const auto n = static_cast<std::int64_t>(tile.cells);
    const auto wrapped = [n](std::int64_t i) { return static_cast<std::size_t>((i % n + n) % n); };
    const std::size_t layer = tile.dimension == 3 ? wrapped(cell[2]) : 0;
    const std::size_t place =
        (layer * static_cast<std::size_t>(n) + wrapped(cell[1])) * static_cast<std::size_t>(n) + wrapped(cell[0]);
    for (std::size_t p = tile.cell_begins[place]; p < tile.cell_begins[place + 1]; ++p) {
      emit(edge * (cell.cast<double>() + tile.points[p]));
    }
  }
};

/// Fills a shape block by block. Distances bound how far the surface is, so that whole blocks are known to be empty or full.
template <class Pattern>
class Filling {
 public:
  Filling(const SignedDistance& shape, const Pattern& pattern, double edge, int dimension)
      : shape_(shape), pattern_(pattern), edge_(edge), dimension_(dimension) {}

  std::vector<Vector3> positions() {
    find_blocks();
    std::vector<Vector3> all;
    std::vector<std::vector<Vector3>> found(std::min(batch, blocks_.size()));
    for (std::size_t first = 0; first < blocks_.size(); first += batch) {
      const std::size_t n = std::min(batch, blocks_.size() - first);
      tbb::parallel_for(std::size_t{0}, n, [&](std::size_t b) {
        found[b].clear();
        fill(blocks_[first + b].lowest, block_level, blocks_[first + b].full, found[b]);
      });
      for (std::size_t b = 0; b < n; ++b) all.insert(all.end(), found[b].begin(), found[b].end());
    }
    return all;
  }

 private:
  static constexpr int block_level = 3;      // blocks of 8 lattice cubes a side are the unit of parallel work
  static constexpr std::size_t batch = 256;  // blocks whose points are held twice
  struct Block {
    Lattice lowest;
    bool full;
  };
  enum class Side { outside, across, inside };

  Side side_of(const Lattice& lowest, int level) const {
    const double half = 0.5 * edge_ * static_cast<double>(std::int64_t{1} << level);
    Vector3 center = Vector3::Zero();
    for (int axis = 0; axis < dimension_; ++axis) center[axis] = static_cast<double>(lowest[axis]) * edge_ + half;
    const double distance = shape_.distance(center), reach = half * std::sqrt(dimension_) * (1 + 1e-9);
    return distance > reach ? Side::outside : distance < -reach ? Side::inside : Side::across;
  }

  template <class Visit>
  void for_each_child(const Lattice& lowest, int level, const Visit& visit) const {
    const std::int64_t half = std::int64_t{1} << (level - 1);
    for (int child = 0; child < 1 << dimension_; ++child) {
      visit(Lattice(lowest + half * Lattice(child & 1, child >> 1 & 1, child >> 2 & 1)));
    }
  }

  void find_blocks() {
    const Box bounds = shape_.bounds();
    Lattice least = Lattice::Zero(), greatest = Lattice::Zero();
    std::int64_t widest = 1;
    double cubes = 1;
    for (int axis = 0; axis < dimension_; ++axis) {
      const double low = std::floor(bounds.min()[axis] / edge_), high = std::floor(bounds.max()[axis] / edge_);
      cubes *= high - low + 1;
      if (!(std::max(std::abs(low), std::abs(high)) < 2e9) || !(cubes < 1e12)) {
        throw InputError(fmt::format("a shape {:.4g} m across cannot be filled with particles {:.4g} m apart; use larger cells",
                                     bounds.sizes()[axis], edge_));
      }
      constexpr std::int64_t whole_blocks = ~((std::int64_t{1} << block_level) - 1);
      least[axis] = static_cast<std::int64_t>(low) & whole_blocks;
      greatest[axis] = static_cast<std::int64_t>(high);
      widest = std::max(widest, greatest[axis] - least[axis] + 1);
    }
    greatest_ = greatest;
    int level = block_level;
    while (std::int64_t{1} << level < widest) ++level;
    check_memory(pattern_.points_per_cube() * cubes_in(least, level));
    find_blocks_in(least, level, false);
  }

  /// Lattice cubes of the shape, blocks that its surface crosses counted as half full.
  double cubes_in(const Lattice& lowest, int level) const {
    if ((lowest.array() > greatest_.array()).any()) return 0;
    const Side side = side_of(lowest, level);
    const double all = std::pow(2.0, dimension_ * level);
    if (side == Side::outside) return 0;
    if (side == Side::inside) return all;
    if (level == block_level) return all / 2;
    double cubes = 0;
    for_each_child(lowest, level, [&](const Lattice& child) { cubes += cubes_in(child, level - 1); });
    return cubes;
  }

  static void check_memory(double particles) {
    constexpr double bytes_per_particle = 150;  // as sampled, and as the leanest material stores it
    const double memory = available_memory();
    if (particles * bytes_per_particle > memory)
      throw InputError(
          fmt::format("about {:.3g} particles take at least {:.3g} GB, {:.3g} GB of memory are available; use "
                      "larger cells or fewer particles per cell",
                      particles, 1e-9 * particles * bytes_per_particle, 1e-9 * memory));
  }

  void find_blocks_in(const Lattice& lowest, int level, bool full) {
    if ((lowest.array() > greatest_.array()).any()) return;
    if (!full) {
      const Side side = side_of(lowest, level);
      if (side == Side::outside) return;
      full = side == Side::inside;
    }
    if (level == block_level) {
      blocks_.push_back({lowest, full});
      return;
    }
    for_each_child(lowest, level, [&](const Lattice& child) { find_blocks_in(child, level - 1, full); });
  }

  void fill(const Lattice& lowest, int level, bool full, std::vector<Vector3>& found) const {
    if (level == 0) {
      pattern_.points_in(lowest, [&](const Vector3& x) {
        if (full || shape_.distance(x) < 0) found.push_back(x);
      });
      return;
    }
    for_each_child(lowest, level, [&](const Lattice& child) {
      // Below two cubes a side the points themselves are cheaper to test than their cubes.
      const Side side = full || level < 2 ? Side::across : side_of(child, level - 1);
      if (side != Side::outside) fill(child, level - 1, full || side == Side::inside, found);
    });
  }

  const SignedDistance& shape_;
  const Pattern& pattern_;
  double edge_;
  int dimension_;
  Lattice greatest_;
  std::vector<Block> blocks_;
};

void check(const SamplingSpec& spec, double cell_size, int dimension) {
  if (dimension != 2 && dimension != 3) throw InputError("sampling: the dimension must be 2 or 3");
  if (!(cell_size > 0) || !std::isfinite(cell_size)) throw InputError("sampling: the cell size must be positive");
  if (spec.particles_per_cell < 1 || spec.particles_per_cell > 4096) {
    throw InputError("sampling: particles per cell must be between 1 and 4096");
  }
  if (!(spec.jitter >= 0 && spec.jitter <= 1)) throw InputError("sampling: jitter must be between 0 and 1");
}

/// The number of sub-cells along the edge of a grid cell.
int subdivision(int particles_per_cell, int dimension) {
  const int n = static_cast<int>(std::lround(std::pow(particles_per_cell, 1.0 / dimension)));
  if ((dimension == 3 ? n * n * n : n * n) != particles_per_cell) {
    throw InputError(fmt::format("sampling: {} particles per cell cannot be laid out evenly; use {} or {}, or blue noise",
                                 particles_per_cell, dimension == 3 ? n * n * n : n * n,
                                 dimension == 3 ? (n + 1) * (n + 1) * (n + 1) : (n + 1) * (n + 1)));
  }
  return n;
}

}  // namespace

ParticleSource sample(const SignedDistance& shape, const SamplingSpec& spec, double cell_size, int dimension) {
  check(spec, cell_size, dimension);
  const Box bounds = shape.bounds();
  if (bounds.isEmpty()) throw InputError("the shape is empty: its parts have nothing in common");
  for (int axis = 0; axis < dimension; ++axis) {
    if (!std::isfinite(bounds.min()[axis]) || !std::isfinite(bounds.max()[axis])) {
      throw InputError("the shape is unbounded and cannot be filled with particles; intersect it with a box");
    }
  }

  ParticleSource particles;
  if (spec.pattern == SamplingPattern::blue_noise) {
    const BlueNoiseTile tile = make_blue_noise_tile(spec.particles_per_cell, dimension, spec.seed);
    const BlueNoisePattern pattern{tile, cell_size};
    particles.positions = Filling(shape, pattern, cell_size, dimension).positions();
  } else {
    const double edge = cell_size / subdivision(spec.particles_per_cell, dimension);
    const double jitter = spec.pattern == SamplingPattern::jittered ? spec.jitter : 0;
    const JitteredPattern pattern{dimension, edge, jitter, spec.seed};
    particles.positions = Filling(shape, pattern, edge, dimension).positions();
  }
  if (particles.positions.empty()) {
    const Vector3 size = bounds.sizes();
    throw InputError(
        dimension == 3
            ? fmt::format("no particle lies inside the shape, which is {:.4g} x {:.4g} x {:.4g} m; use cells smaller "
                          "than {:.4g} m",
                          size[0], size[1], size[2], cell_size)
            : fmt::format("no particle lies inside the shape, whose bounds are {:.4g} x {:.4g} m; in 2D it must cross "
                          "the plane z = 0, and cells must be smaller than {:.4g} m",
                          size[0], size[1], cell_size));
  }
  particles.volumes.assign(particles.positions.size(), std::pow(cell_size, dimension) / spec.particles_per_cell);
  return particles;
}

}  // namespace cleave::scene
