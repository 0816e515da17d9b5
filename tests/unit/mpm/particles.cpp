#include "mpm/particles.hpp"

#include "common/error.hpp"
#include "particle_kinds.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

namespace cleave::mpm {
namespace {

template <class K>
class SortedParticles : public testing::Test {};
TYPED_TEST_SUITE(SortedParticles, Kinds);

template <class T, int D>
Particles<T, D> cloud(std::size_t n, std::vector<NewParticle>& truth) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<double> state;
  for (std::size_t i = 0; i < n; i++) {
    NewParticle p;
    p.id = std::uint32_t(i);
    for (int a = 0; a < D; a++) {
      p.position[a] = 20 * uniform(random);
      p.velocity[a] = uniform(random);
      for (int c = 0; c < D; c++) p.deformation(a, c) += 0.1 * uniform(random);
    }
    p.volume = 0.1 + 0.05 * uniform(random);
    truth.push_back(p);
    state.push_back(double(i));
  }
  Particles<T, D> particles(TileLayout({.dimension = D, .state_components = 1}));
  particles.assign(truth, state, {});
  return particles;
}

/// Every particle is there once, in the block and in cell order of its position, with all its values.
template <class T, int D>
void expect_sound(const Particles<T, D>& particles, const std::vector<NewParticle>& truth) {
  constexpr int edge = GridShape<D>::block_edge;
  std::vector<int> seen(truth.size(), 0);
  const auto& l = particles.layout();
  std::uint64_t last_key = 0;
  for (const auto& b : particles.blocks()) {
    EXPECT_GE(morton_key(b.coordinate), last_key);
    last_key = morton_key(b.coordinate);
    int last_cell = 0;
    for (std::uint32_t i = 0; i < b.count; i++) {
      const std::uint64_t slot = b.first_tile * Particles<T, D>::lanes + i;
      const std::uint32_t id = particles.id(slot);
      ASSERT_LT(id, truth.size());
      seen[id]++;
      int cell = 0;
      for (int a = 0; a < D; a++) {
        const double x = double(particles.value(l.position, a, slot));
        EXPECT_GE(x, 0.5 - 1e-5);
        EXPECT_LT(x, edge + 0.5 + 1e-5);
        cell = cell * edge + std::min(std::max(int(std::floor(x - 0.5)), 0), edge - 1);
      }
      EXPECT_GE(cell, last_cell);
      last_cell = cell;
      EXPECT_LT((particles.position(b, slot) - truth[id].position).norm(), 1e-5);
      EXPECT_EQ(particles.value(l.volume, slot), T(truth[id].volume));
      EXPECT_EQ(particles.value(l.state, slot), T(id));
      EXPECT_EQ(particles.value(l.velocity, 0, slot), T(truth[id].velocity[0]));
      EXPECT_LT((particles.deformation_or_b(slot) - truth[id].deformation).norm(), 1e-6);
      EXPECT_NEAR(particles.jacobian(slot), truth[id].deformation.determinant(), 1e-5);
      EXPECT_EQ(particles.block_of(slot), &b);
    }
    // the rest of the last tile weighs nothing and is finite
    const std::uint64_t end = (b.first_tile + (b.count + Particles<T, D>::lanes - 1) / Particles<T, D>::lanes);
    for (std::uint64_t slot = b.first_tile * Particles<T, D>::lanes + b.count; slot < end * Particles<T, D>::lanes; slot++) {
      EXPECT_EQ(particles.value(l.volume, slot), T(0));
      EXPECT_TRUE(std::isfinite(double(particles.value(l.position, slot))));
    }
  }
  for (int s : seen) ASSERT_EQ(s, 1);
}

TYPED_TEST(SortedParticles, AreAllThereInBlockAndCellOrder) {
  std::vector<NewParticle> truth;
  auto particles = cloud<typename TypeParam::T, TypeParam::D>(5000, truth);
  expect_sound(particles, truth);
}

TYPED_TEST(SortedParticles, FindTheirNewHomesHoweverFarTheyMoved) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D;
  std::vector<NewParticle> truth;
  auto particles = cloud<T, D>(5000, truth);
  std::mt19937 random(12);
  for (double reach : {0.7, 3.0, 30.0}) {
    std::uniform_real_distribution<double> uniform(-reach, reach);
    particles.for_each([&](const auto& b, std::uint64_t slot) {
      for (int a = 0; a < D; a++) {
        T& x = particles.value(particles.layout().position, a, slot);
        x = T(double(x) + uniform(random));
        truth[particles.id(slot)].position[a] = double(b.coordinate[a]) * GridShape<D>::block_edge + double(x);
      }
    });
    particles.sort();
    expect_sound(particles, truth);
  }
}

TYPED_TEST(SortedParticles, RefuseToBeNowhere) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D;
  std::vector<NewParticle> truth;
  auto particles = cloud<T, D>(100, truth);
  particles.value(particles.layout().position, 0) = std::numeric_limits<T>::quiet_NaN();
  EXPECT_THROW(particles.sort(), SimulationError);
}

TEST(TileLayout, StoresOnlyWhatIsDeclared) {
  EXPECT_EQ(TileLayout({.dimension = 3, .stores_b = true}).stride, (3 + 3 + 9 + 1 + 6) * 64u);
  EXPECT_EQ(TileLayout({.dimension = 3}).stride, (3 + 3 + 9 + 1 + 9) * 64u);
  EXPECT_EQ(TileLayout({.dimension = 2, .stores_b = true}).stride, (2 + 2 + 4 + 1 + 4) * 64u);
  EXPECT_EQ(TileLayout({.dimension = 3, .fibers = 2, .state_components = 5}).stride, (3 + 3 + 9 + 1 + 9 + 6 + 5) * 64u);
  EXPECT_EQ(TileLayout({.dimension = 3, .stores_b = true, .state_components = 1, .damage = true, .toughness = true}).stride,
            (3 + 3 + 9 + 1 + 6 + 1 + 1 + 1) * 64u);
}

}  // namespace
}  // namespace cleave::mpm
