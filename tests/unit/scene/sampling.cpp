#include "scene/sampling.hpp"
#include "scene/blue_noise.hpp"
#include "scene_testing.hpp"

#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

namespace cleave::scene {
namespace {

using std::numbers::pi;
using testing::HasSubstr;
using Type = ShapeSpec::Type;

constexpr std::array all_patterns = {SamplingPattern::regular, SamplingPattern::jittered, SamplingPattern::blue_noise};

std::unique_ptr<SignedDistance> box(const Vector3& center, const Vector3& size) {
  ShapeSpec spec;
  spec.center = center;
  spec.size = size;
  return build_shape(spec, 0.1);
}

std::unique_ptr<SignedDistance> solid(Type type) {
  ShapeSpec spec;
  spec.type = type;
  spec.center = Vector3(0.13, -0.07, 0.21);
  spec.axis = Vector3(1, 2, -0.5);
  spec.radius = 0.6;
  spec.inner_radius = 0.35;
  spec.tube_radius = 0.2;
  spec.height = 0.9;
  return build_shape(spec, 0.1);
}

SamplingSpec pattern_of(SamplingPattern pattern, int particles_per_cell = 8, std::uint64_t seed = 1) {
  SamplingSpec spec;
  spec.pattern = pattern;
  spec.particles_per_cell = particles_per_cell;
  spec.seed = seed;
  return spec;
}

double total(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum;
}

/// The distance of each point to its nearest other one.
std::vector<double> nearest_distances(const std::vector<Vector3>& points, double reach) {
  std::map<std::array<int, 3>, std::vector<std::size_t>> buckets;
  const auto bucket = [&](const Vector3& x) {
    return std::array<int, 3>{static_cast<int>(std::floor(x[0] / reach)), static_cast<int>(std::floor(x[1] / reach)),
                              static_cast<int>(std::floor(x[2] / reach))};
  };
  for (std::size_t i = 0; i < points.size(); ++i) buckets[bucket(points[i])].push_back(i);
  std::vector<double> nearest(points.size(), reach);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto b = bucket(points[i]);
    for (int n = 0; n < 27; ++n) {
      const auto found = buckets.find({b[0] + n % 3 - 1, b[1] + n / 3 % 3 - 1, b[2] + n / 9 - 1});
      if (found == buckets.end()) continue;
      for (const std::size_t j : found->second) {
        if (j != i) nearest[i] = std::min(nearest[i], (points[i] - points[j]).norm());
      }
    }
  }
  return nearest;
}

TEST(Sampling, FillsClosedFormVolumes) {
  const double r = 0.6, ri = 0.35, h = 0.9, rt = 0.2;
  const std::map<Type, double> volumes = {{Type::sphere, 4.0 / 3 * pi * r * r * r},
                                          {Type::cylinder, pi * r * r * h},
                                          {Type::capsule, pi * r * r * (h + 4.0 / 3 * r)},
                                          {Type::torus, 2 * pi * pi * r * rt * rt},
                                          {Type::tube, pi * (r * r - ri * ri) * h}};
  for (const auto& [type, volume] : volumes) {
    const auto shape = solid(type);
    for (const SamplingPattern pattern : all_patterns) {
      const ParticleSource particles = sample(*shape, pattern_of(pattern), 0.04, 3);
      EXPECT_NEAR(total(particles.volumes), volume, 0.01 * volume)
          << static_cast<int>(type) << ' ' << static_cast<int>(pattern);
    }
  }
}

TEST(Sampling, FillsClosedFormAreasInTwoDimensions) {
  ShapeSpec ball;
  ball.type = Type::sphere;
  ball.radius = 0.5;
  ball.center = Vector3(0, 0, 0.3);  // the plane z = 0 cuts a disc of radius 0.4
  const auto shape = build_shape(ball, 0.1);
  for (const SamplingPattern pattern : all_patterns) {
    const ParticleSource particles = sample(*shape, pattern_of(pattern, 4), 0.01, 2);
    EXPECT_NEAR(total(particles.volumes), pi * 0.16, 0.01 * pi * 0.16);
    EXPECT_DOUBLE_EQ(particles.volumes[0], 0.01 * 0.01 / 4);
    for (const Vector3& x : particles.positions) ASSERT_EQ(x[2], 0);
  }
}

TEST(Sampling, PutsEveryParticleInside) {
  const auto shape = solid(Type::tube);
  for (const SamplingPattern pattern : all_patterns) {
    const ParticleSource particles = sample(*shape, pattern_of(pattern), 0.05, 3);
    ASSERT_EQ(particles.volumes.size(), particles.positions.size());
    for (const Vector3& x : particles.positions) ASSERT_LT(shape->distance(x), 0);
  }
}

TEST(Sampling, MissesNoSubCellWhereWholeBlocksAreSkipped) {
  const auto shape = solid(Type::torus);
  const double edge = 0.05 / 2;
  std::set<std::array<int, 3>> expected, found;
  for (int k = -60; k < 60; ++k) {
    for (int j = -60; j < 60; ++j) {
      for (int i = -60; i < 60; ++i) {
        if (shape->distance(edge * Vector3(i + 0.5, j + 0.5, k + 0.5)) < 0) expected.insert({i, j, k});
      }
    }
  }
  for (const Vector3& x : sample(*shape, pattern_of(SamplingPattern::regular), 0.05, 3).positions) {
    found.insert({static_cast<int>(std::floor(x[0] / edge)), static_cast<int>(std::floor(x[1] / edge)),
                  static_cast<int>(std::floor(x[2] / edge))});
  }
  EXPECT_EQ(found, expected);
}

TEST(Sampling, RegularlyFillsCellCentresOfTheGrid) {
  const ParticleSource one =
      sample(*box(Vector3(0.5, 0.5, 0.5), Vector3(1, 1, 1)), pattern_of(SamplingPattern::regular, 1), 0.25, 3);
  EXPECT_EQ(one.positions.size(), 64u);
  for (const Vector3& x : one.positions) {
    const Vector3 in_cells = x / 0.25;
    ASSERT_LT((in_cells - (in_cells.array().floor() + 0.5).matrix()).norm(), 1e-12);
  }
  EXPECT_EQ(
      sample(*box(Vector3(0.5, 0.5, 0), Vector3(1, 1, 1)), pattern_of(SamplingPattern::regular, 9), 0.25, 2).positions.size(),
      16u * 9u);
}

TEST(Sampling, JittersInsideItsOwnSubCell) {
  const double edge = 0.25 / 2;
  SamplingSpec spec = pattern_of(SamplingPattern::jittered);
  for (const double jitter : {0.0, 0.5, 1.0}) {
    spec.jitter = jitter;
    const ParticleSource particles = sample(*box(Vector3(0, 0, 0), Vector3(2, 2, 2)), spec, 0.25, 3);
    ASSERT_EQ(particles.positions.size(), 4096u);  // the box's faces lie on the grid
    std::set<std::array<int, 3>> cells;
    double furthest = 0;
    for (const Vector3& x : particles.positions) {
      const Vector3 corner = (x / edge).array().floor();
      cells.insert({static_cast<int>(corner[0]), static_cast<int>(corner[1]), static_cast<int>(corner[2])});
      furthest = std::max(furthest, (x / edge - corner - Vector3::Constant(0.5)).cwiseAbs().maxCoeff());
    }
    EXPECT_EQ(cells.size(), 4096u);
    EXPECT_LE(furthest, jitter / 2 + 1e-12);
    EXPECT_GE(furthest, 0.99 * jitter / 2 - 1e-12);
  }
}

TEST(Sampling, RepeatsExactlyOnAnyNumberOfThreads) {
  const auto shape = solid(Type::torus);
  for (const int dimension : {2, 3}) {
    for (const SamplingPattern pattern : all_patterns) {
      const SamplingSpec spec = pattern_of(pattern, dimension == 3 ? 8 : 4);
      std::vector<Vector3> reference;
      for (const std::size_t threads : {1u, 2u, 4u}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        const ParticleSource particles = sample(*shape, spec, 0.02, dimension);
        if (threads == 1) reference = particles.positions;
        ASSERT_TRUE(particles.positions == reference) << threads << " threads";
      }
      EXPECT_GT(reference.size(), 500u);
    }
  }
}

TEST(Sampling, DependsOnTheSeed) {
  const auto shape = solid(Type::sphere);
  for (const SamplingPattern pattern : {SamplingPattern::jittered, SamplingPattern::blue_noise}) {
    EXPECT_NE(sample(*shape, pattern_of(pattern, 8, 1), 0.1, 3).positions,
              sample(*shape, pattern_of(pattern, 8, 2), 0.1, 3).positions);
  }
}

TEST(BlueNoise, KeepsParticlesApartWhereJitteringDoesNot) {
  for (const int dimension : {2, 3}) {
    const double cell = 0.1, spacing = cell / 2;
    const int per_cell = dimension == 3 ? 8 : 4;
    const double width = dimension == 3 ? 2.4 : 12;
    const auto shape = box(Vector3(0.03, 0.01, 0), Vector3(width, width, width));
    const auto least = [&](SamplingPattern pattern) {
      const auto nearest =
          nearest_distances(sample(*shape, pattern_of(pattern, per_cell), cell, dimension).positions, 2 * spacing);
      return *std::min_element(nearest.begin(), nearest.end());
    };
    const double jittered = least(SamplingPattern::jittered), blue = least(SamplingPattern::blue_noise);
    EXPECT_LT(jittered, 0.15 * spacing);
    EXPECT_GT(blue, (dimension == 3 ? 0.98 * 0.85 : 0.98 * 0.80) * spacing * (1 - 1e-12));
  }
}

TEST(BlueNoise, HasTheDensityAskedForWithinTwoPercent) {
  for (const int per_cell : {1, 2, 5, 8, 12, 27}) {  // perfect cubes and others
    const double cell = 0.05 * std::cbrt(per_cell / 8.0);
    const auto shape = box(Vector3(0.017, 0.3, -0.2), Vector3(0.9, 1.1, 1.3));
    const ParticleSource particles = sample(*shape, pattern_of(SamplingPattern::blue_noise, per_cell), cell, 3);
    EXPECT_NEAR(total(particles.volumes), 0.9 * 1.1 * 1.3, 0.005 * 0.9 * 1.1 * 1.3) << per_cell;
  }
}

// Random points of the same density in the same windows vary by the square root of their number.
TEST(BlueNoise, IsMoreEvenThanRandomAtEveryScale) {
  for (const int dimension : {2, 3}) {
    const auto shape = box(Vector3(0, 0, 0), Vector3(8, 8, 8));
    const ParticleSource particles =
        sample(*shape, pattern_of(SamplingPattern::blue_noise, dimension == 3 ? 8 : 16), 0.25, dimension);
    for (const double window : {0.3, 0.5, 1.0}) {
      RandomPoints centers(3.3);
      double sum = 0, squares = 0;
      constexpr int windows = 60;
      for (int i = 0; i < windows; ++i) {
        Vector3 center = centers.next();
        if (dimension == 2) center[2] = 0;
        double count = 0;
        for (const Vector3& x : particles.positions) count += ((x - center).cwiseAbs().array() < window / 2).all();
        sum += count;
        squares += count * count;
      }
      const double mean = sum / windows, variance = squares / windows - mean * mean;
      EXPECT_LT(variance, 0.6 * mean) << "window " << window << " in " << dimension << "D";
    }
  }
}

TEST(BlueNoise, TilesReachTheirMinimumDistance) {
  for (const int dimension : {2, 3}) {
    for (const int per_cell : {1, 4, 64}) {
      const BlueNoiseTile tile = make_blue_noise_tile(per_cell, dimension, 5);
      const auto cells = static_cast<std::size_t>(std::pow(tile.cells, dimension) + 0.5);
      EXPECT_EQ(tile.points.size(), cells * static_cast<std::size_t>(per_cell));
      EXPECT_EQ(tile.cell_begins.size(), cells + 1);
      EXPECT_GT(tile.minimum_distance * std::pow(per_cell, 1.0 / dimension), dimension == 3 ? 0.98 * 0.85 : 0.98 * 0.80);
    }
  }
}

TEST(Sampling, OfAMeshFillsItsVolume) {
  const std::filesystem::path file = shared_mesh("stanford-bunny.obj");
  if (file.empty()) GTEST_SKIP() << "stanford-bunny.obj is not in the data directory (set CLEAVE_DATA_DIR)";
  ShapeSpec spec;
  spec.type = Type::mesh;
  spec.file = file;
  spec.file_size = 1;
  const auto bunny = build_shape(spec, 0.01);
  for (const SamplingPattern pattern : all_patterns) {
    const ParticleSource particles = sample(*bunny, pattern_of(pattern), 0.02, 3);
    EXPECT_NEAR(total(particles.volumes), 0.20008, 0.01 * 0.20008);
    for (const Vector3& x : particles.positions) ASSERT_LT(bunny->distance(x), 0);
  }
}

TEST(Sampling, RefusesWhatItCannotFill) {
  ShapeSpec half;
  half.type = Type::half_space;
  const auto floor = build_shape(half, 0.1), cube = box(Vector3(0, 0, 0.5), Vector3(1, 1, 0.9));
  const auto error_of = [](const SignedDistance& shape, SamplingSpec spec, double cell_size, int dimension) {
    return input_error([&] { sample(shape, spec, cell_size, dimension); });
  };
  const SamplingSpec plain;
  EXPECT_THAT(error_of(*floor, plain, 0.1, 3), HasSubstr("unbounded"));
  EXPECT_THAT(error_of(*cube, pattern_of(SamplingPattern::regular, 1), 10, 3), HasSubstr("no particle lies inside the shape"));
  EXPECT_THAT(error_of(*cube, pattern_of(SamplingPattern::jittered, 4), 0.1, 2), HasSubstr("plane z = 0"));
  EXPECT_THAT(error_of(*cube, pattern_of(SamplingPattern::jittered, 9), 0.1, 3), HasSubstr("9 particles per cell"));
  EXPECT_THAT(error_of(*cube, pattern_of(SamplingPattern::jittered, 0), 0.1, 3), HasSubstr("between 1 and 4096"));
  EXPECT_THAT(error_of(*cube, plain, 0, 3), HasSubstr("cell size must be positive"));
  EXPECT_THAT(error_of(*cube, plain, 1e-8, 3), HasSubstr("use larger cells"));
  SamplingSpec wild;
  wild.jitter = 1.5;
  EXPECT_THAT(error_of(*cube, wild, 0.1, 3), HasSubstr("jitter"));
  ShapeSpec nothing;
  nothing.type = Type::intersection;
  nothing.children.resize(2);
  nothing.children[1].center = Vector3(5, 0, 0);
  EXPECT_THAT(error_of(*build_shape(nothing, 0.1), plain, 0.1, 3), HasSubstr("the shape is empty"));
}

}  // namespace
}  // namespace cleave::scene
