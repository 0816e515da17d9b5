// What sorting particles promises: the same particles bit by bit, in one order, however many there are and wherever they go.

#include "mpm/particles.hpp"

#include "common/error.hpp"
#include "particle_kinds.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstring>
#include <map>
#include <random>
#include <tuple>

namespace cleave::mpm {
namespace {

template <class K>
class Sort : public testing::Test {};
TYPED_TEST_SUITE(Sort, Kinds);

/// Every stored number of a particle, and where it is.
template <class T>
struct Stored {
  BlockCoordinate block;
  std::vector<T> numbers;
};

template <class T, int D>
std::vector<T> numbers(const Particles<T, D>& particles, std::uint64_t slot) {
  std::vector<T> r;
  for (std::uint32_t at = 0; at < particles.layout().stride; at += CLEAVE_TILE_BYTES) r.push_back(particles.value(at, slot));
  return r;
}

template <class T, int D>
std::map<std::uint32_t, Stored<T>> all_of(const Particles<T, D>& particles) {
  std::map<std::uint32_t, Stored<T>> r;
  particles.for_each([&](const auto& b, std::uint64_t slot) {
    EXPECT_TRUE(r.emplace(particles.id(slot), Stored<T>{b.coordinate, numbers(particles, slot)}).second);
  });
  return r;
}

/// `n` particles with everything a material can store, no two numbers alike, in a cube `size` cells wide.
template <class T, int D>
Particles<T, D> filled(std::size_t n, double size) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<NewParticle> list(n);
  std::vector<double> state(3 * n), fibers(6 * n);
  for (std::size_t i = 0; i < n; i++) {
    NewParticle& p = list[i];
    p.id = std::uint32_t(n - 1 - i);
    for (int a = 0; a < D; a++) p.position[a] = size * (uniform(random) - 0.5);
    for (int a = 0; a < D; a++) p.velocity[a] = uniform(random);
    p.velocity_gradient = p.velocity_gradient.unaryExpr([&](double) { return uniform(random); });
    p.volume = 0.1 + uniform(random);
    p.deformation = p.deformation.unaryExpr([&](double x) { return x + 0.1 * uniform(random); });
    p.damage = uniform(random);
    p.toughness = uniform(random);
  }
  for (double& x : state) x = uniform(random);
  for (double& x : fibers) x = uniform(random);
  Particles<T, D> particles(
      TileLayout({.dimension = D, .fibers = 2, .state_components = 3, .damage = true, .toughness = true}));
  particles.assign(list, state, fibers);
  return particles;
}

template <class T, int D>
void move_all(Particles<T, D>& particles, double reach, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-reach, reach);
  std::map<std::uint32_t, std::array<T, 3>> by_id;  // whatever the order of the particles, each moves the same way
  particles.for_each([&](const auto&, std::uint64_t slot) { by_id[particles.id(slot)] = {}; });
  for (auto& [id, step] : by_id)
    for (T& s : step) s = T(uniform(random));
  particles.for_each([&](const auto&, std::uint64_t slot) {
    for (int a = 0; a < D; a++) particles.value(particles.layout().position, a, slot) += by_id[particles.id(slot)][a];
  });
}

TYPED_TEST(Sort, ChangesNothingButTheOriginOfPositions) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D, edge = GridShape<D>::block_edge;
  for (const std::size_t n : {std::size_t(1), std::size_t(700), std::size_t(20000)}) {
    auto particles = filled<T, D>(n, D == 3 ? 24 : 90);
    for (unsigned round = 0; round < 3; round++) {
      move_all(particles, 1.5, round);
      auto before = all_of(particles);
      particles.sort();
      const auto after = all_of(particles);
      ASSERT_EQ(after.size(), n);
      for (const auto& [id, p] : after) {
        Stored<T>& was = before.at(id);
        for (int a = 0; a < D; a++) was.numbers[std::size_t(a)] += T((was.block[a] - p.block[a]) * edge);
        EXPECT_EQ(std::memcmp(was.numbers.data(), p.numbers.data(), p.numbers.size() * sizeof(T)), 0) << "particle " << id;
      }
    }
  }
}

TYPED_TEST(Sort, OrdersByBlockThenCellThenFormerPlace) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D, edge = GridShape<D>::block_edge;
  auto particles = filled<T, D>(20000, D == 3 ? 24 : 90);
  move_all(particles, 1.5, 3);
  std::map<std::uint32_t, std::uint64_t> place;
  particles.for_each([&](const auto&, std::uint64_t slot) { place[particles.id(slot)] = slot; });
  particles.sort();
  std::tuple<std::uint64_t, int, std::uint64_t> last{0, -1, 0};
  std::uint64_t tiles = 0;
  for (const auto& b : particles.blocks()) {
    EXPECT_GT(b.count, 0u);
    EXPECT_EQ(b.first_tile, tiles);
    tiles += (b.count + Particles<T, D>::lanes - 1) / Particles<T, D>::lanes;
  }
  EXPECT_EQ(particles.tiles(), tiles);
  particles.for_each([&](const auto& b, std::uint64_t slot) {
    int cell = 0;
    for (int a = 0; a < D; a++) {
      const int c = int(std::floor(double(particles.value(particles.layout().position, a, slot)) - 0.5));
      // a position in a block that is rounded up may lie on its end
      cell = cell * edge + std::clamp(c, 0, edge - 1);
    }
    const std::tuple now{morton_key(b.coordinate), cell, place.at(particles.id(slot))};
    EXPECT_LT(last, now);
    last = now;
  });
}

TYPED_TEST(Sort, FollowsParticlesApartAndTogetherAgain) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D, edge = GridShape<D>::block_edge;
  auto particles = filled<T, D>(3000, edge);
  const auto start = all_of(particles);
  const std::size_t tiles = particles.tiles();
  // each particle to a block of its own: many times the tiles
  particles.for_each([&](const auto&, std::uint64_t slot) {
    particles.value(particles.layout().position, 0, slot) += T(4 * edge) * T(particles.id(slot));
  });
  particles.sort();
  EXPECT_EQ(particles.blocks().size(), 3000u);
  EXPECT_GT(particles.tiles(), 7 * tiles);
  EXPECT_EQ(all_of(particles).size(), 3000u);
  for (const auto& b : particles.blocks()) {  // one particle, and copies of it without volume
    auto alone = numbers(particles, b.first_tile * Particles<T, D>::lanes);
    alone[particles.layout().volume / CLEAVE_TILE_BYTES] = 0;
    for (int l = 1; l < Particles<T, D>::lanes; l++)
      EXPECT_EQ(numbers(particles, b.first_tile * Particles<T, D>::lanes + std::uint64_t(l)), alone);
  }
  particles.for_each([&](const auto&, std::uint64_t slot) {
    particles.value(particles.layout().position, 0, slot) -= T(4 * edge) * T(particles.id(slot));
  });
  particles.sort();
  EXPECT_LE(particles.tiles(), tiles + 8);
  for (const auto& [id, p] : all_of(particles)) {
    const auto& was = start.at(id);
    for (std::size_t c = std::size_t(D); c < p.numbers.size(); c++) EXPECT_EQ(p.numbers[c], was.numbers[c]);
  }
}

TYPED_TEST(Sort, DoesNotDependOnThreads) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D;
  std::vector<std::vector<char>> tiles;
  for (const std::size_t threads : {1, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    auto particles = filled<T, D>(20000, D == 3 ? 24 : 90);
    move_all(particles, 2, 1);
    particles.sort();
    tiles.emplace_back(particles.data(), particles.data() + particles.tiles() * particles.layout().stride);
  }
  EXPECT_TRUE(tiles[0] == tiles[1]);
}

TYPED_TEST(Sort, MovesNothingIfAParticleIsNowhere) {
  using T = typename TypeParam::T;
  constexpr int D = TypeParam::D;
  auto particles = filled<T, D>(2000, D == 3 ? 24 : 90);
  move_all(particles, 2, 1);
  const std::uint64_t last = particles.blocks().back().first_tile * Particles<T, D>::lanes;
  particles.value(particles.layout().position, last) = std::numeric_limits<T>::infinity();
  const auto before = all_of(particles);
  EXPECT_THROW(particles.sort(), SimulationError);
  const auto after = all_of(particles);
  for (const auto& [id, p] : before) {
    EXPECT_EQ(p.block, after.at(id).block);
    EXPECT_EQ(p.numbers, after.at(id).numbers);
  }
}

TYPED_TEST(Sort, IsOfNoConsequenceWithoutParticles) {
  Particles<typename TypeParam::T, TypeParam::D> particles(TileLayout({.dimension = TypeParam::D}));
  particles.assign(std::vector<NewParticle>(), {}, {});
  particles.sort();
  EXPECT_EQ(particles.size(), 0u);
  EXPECT_TRUE(particles.blocks().empty());
}

TEST(Buffer, ExtendsWithItsContents) {
  Buffer buffer;
  std::vector<unsigned char> bytes(3 << 20);
  std::mt19937 random(1);
  for (auto& b : bytes) b = static_cast<unsigned char>(random());
  buffer.extend(bytes.size());
  std::memcpy(buffer.data(), bytes.data(), bytes.size());
  for (std::size_t size = 2 * bytes.size(); size < (200u << 20); size *= 3) {
    buffer.extend(size);
    ASSERT_GE(buffer.bytes(), size);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(buffer.data()) % (2u << 20), 0u);
    EXPECT_EQ(std::memcmp(buffer.data(), bytes.data(), bytes.size()), 0);
    buffer.data()[size - 1] = 1;  // is there
  }
}

}  // namespace
}  // namespace cleave::mpm
