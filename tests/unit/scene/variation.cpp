#include "scene/variation.hpp"
#include "scene_testing.hpp"

#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace cleave::scene {
namespace {

using Pattern = VariationSpec::Pattern;

VariationSpec spec_of(Pattern pattern, double size = 0.1, std::uint64_t seed = 1) {
  VariationSpec spec;
  spec.pattern = pattern;
  spec.size = size;
  spec.minimum = 0.5;
  spec.maximum = 2.5;
  spec.seed = seed;
  return spec;
}

std::vector<Vector3> random_points(int count, double half_width) {
  std::vector<Vector3> x;
  RandomPoints random(half_width);
  for (int i = 0; i < count; ++i) x.push_back(random.next());
  return x;
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / double(values.size());
}

/// Correlation of the factors at points a distance apart, over many points and seeds.
double correlation(Pattern pattern, double distance, int dimension, const auto& transform) {
  double products = 0, squares = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    auto x = random_points(1000, 3);
    const auto here = sample_variation(spec_of(pattern, 0.1, seed), x, dimension);
    RandomPoints random(1, 3);
    for (Vector3& p : x) {
      Vector3 d = random.next();
      if (dimension == 2) d.z() = 0;
      p += distance * d.normalized();
    }
    const auto there = sample_variation(spec_of(pattern, 0.1, seed), x, dimension);
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double a = transform(here[i]), b = transform(there[i]);
      products += a * b;
      squares += (a * a + b * b) / 2;
    }
  }
  return products / squares;
}

class EachPattern : public testing::TestWithParam<std::tuple<Pattern, int>> {
 protected:
  Pattern pattern() const { return std::get<0>(GetParam()); }
  int dimension() const { return std::get<1>(GetParam()); }
};

TEST_P(EachPattern, IsAsOftenInEveryTenthOfItsBounds) {
  const auto values = sample_variation(spec_of(pattern()), random_points(100000, 5), dimension());
  int tenths[10] = {};
  for (const double v : values) {
    ASSERT_GE(v, 0.5);
    ASSERT_LE(v, 2.5);
    ++tenths[std::min(9, int((v - 0.5) / 0.2))];
  }
  EXPECT_NEAR(mean(values), 1.5, 0.02);
  for (const int n : tenths) EXPECT_NEAR(n / 10000.0, 1, 0.12);
}

TEST_P(EachPattern, DependsOnThePositionAloneNotOnOrderOrThreads) {
  auto x = random_points(5000, 2);
  auto values = sample_variation(spec_of(pattern()), x, dimension());
  std::reverse(x.begin(), x.end());
  std::reverse(values.begin(), values.end());
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(sample_variation(spec_of(pattern()), x, dimension()), values);
}

TEST_P(EachPattern, ChangesWithTheSeed) {
  const auto x = random_points(20000, 2);
  const auto one = sample_variation(spec_of(pattern(), 0.1, 1), x, dimension());
  const auto other = sample_variation(spec_of(pattern(), 0.1, 2), x, dimension());
  double covariance = 0;
  for (std::size_t i = 0; i < x.size(); ++i) covariance += (one[i] - 1.5) * (other[i] - 1.5) / double(x.size());
  EXPECT_NEAR(covariance * 3, 0, 0.06) << "in units of the variance, 1/3";
}

TEST_P(EachPattern, ScalesWithItsSize) {
  const auto x = random_points(2000, 2);
  auto doubled = x;
  for (Vector3& p : doubled) p *= 2;
  EXPECT_EQ(sample_variation(spec_of(pattern(), 0.125), x, dimension()),
            sample_variation(spec_of(pattern(), 0.25), doubled, dimension()));
}

TEST_P(EachPattern, LooksAtDepthOnlyInThreeDimensions) {
  auto x = random_points(1000, 2);
  const auto values = sample_variation(spec_of(pattern()), x, dimension());
  for (Vector3& p : x) p.z() += 1;
  EXPECT_EQ(sample_variation(spec_of(pattern()), x, dimension()) == values, dimension() == 2);
}

INSTANTIATE_TEST_SUITE_P(Patterns, EachPattern,
                         testing::Combine(testing::Values(Pattern::voronoi, Pattern::noise), testing::Values(2, 3)));

/// Inverse of the map from the Gaussian field to the factor, by bisection.
double gaussian_of(double factor) {
  double low = -10, high = 10;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (0.5 + 2 * 0.5 * std::erfc(-middle / std::sqrt(2.0)) < factor ? low : high) = middle;
  }
  return low;
}

TEST(Noise, HasTheCorrelationOfItsSize) {
  for (const int dimension : {2, 3})
    for (const double r : {0.25, 0.5, 1.0, 1.5, 3.0})
      EXPECT_NEAR(correlation(Pattern::noise, 0.1 * r, dimension, gaussian_of), std::exp(-r * r), 0.04) << r;
}

TEST(Noise, IsSmooth) {
  const auto x = random_points(2000, 2);
  auto moved = x;
  for (Vector3& p : moved) p.x() += 1e-6;
  const auto a = sample_variation(spec_of(Pattern::noise), x, 3), b = sample_variation(spec_of(Pattern::noise), moved, 3);
  // The gradient of the field is that of sqrt(2/N) sum cos(k . x), at most some |k| ~ 5/size.
  for (std::size_t i = 0; i < x.size(); ++i) ASSERT_LT(std::abs(a[i] - b[i]), 2 * 0.4 * 8 / 0.1 * 1e-6);
}

TEST(Voronoi, HasOneValuePerCellAndOneCellPerSizeCubed) {
  // Over a box of 8^3 sizes: cells that touch it number about 512 and some cut by its surface.
  const auto x = random_points(200000, 0.4);
  std::map<double, int> cells;
  for (const double v : sample_variation(spec_of(Pattern::voronoi), x, 3)) ++cells[v];
  EXPECT_GT(cells.size(), 512u * 0.9);
  EXPECT_LT(cells.size(), 512u * 1.7);
}

/// Two points are in the same cell of a Poisson-Voronoi tessellation with a probability that only depends on their distance;
/// along a line the cells of the plane are cut in pieces of mean length pi/4 sizes, those of space in 0.6872 sizes.
TEST(Voronoi, CutsALineAsOftenAsAPoissonTessellation) {
  for (const int dimension : {2, 3}) {
    std::vector<Vector3> line;
    constexpr int steps = 400000;
    for (int i = 0; i < steps; ++i) line.emplace_back(0.1 * 0.01 * i, 0.03 * std::sqrt(2) * 0.1 * 0.01 * i, 0.7);
    const auto values = sample_variation(spec_of(Pattern::voronoi), line, dimension);
    int crossings = 0;
    for (int i = 1; i < steps; ++i) crossings += values[std::size_t(i)] != values[std::size_t(i - 1)];
    const double length = 0.01 * steps * std::sqrt(1 + 2 * 0.03 * 0.03);
    EXPECT_NEAR(length / crossings, dimension == 2 ? 0.7854 : 0.6872, 0.025) << dimension;
  }
}

TEST(Variation, WithoutRangeIsConstant) {
  VariationSpec spec = spec_of(Pattern::noise);
  spec.minimum = spec.maximum = 0.7;
  for (const double v : sample_variation(spec, random_points(100, 1), 3)) EXPECT_EQ(v, 0.7);
}

TEST(Variation, RefusesASizeThatCoordinatesCannotResolve) {
  EXPECT_THAT(input_error([] { sample_variation(spec_of(Pattern::voronoi, 1e-12), {Vector3(1, 0, 0)}, 3); }),
              testing::HasSubstr("1e-12 m, is too small for a body that reaches to 1 m"));
}

}  // namespace
}  // namespace cleave::scene
