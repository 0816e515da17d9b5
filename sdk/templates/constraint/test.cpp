#include <cleave/testkit/grid_system.hpp>
#include <cleave/testkit/gtest.hpp>

#include <array>
#include <cmath>
#include <map>

namespace {
namespace kit = cleave::testkit;

/// Every check that `cleave check` makes, as a test of its own.
CLEAVE_CONFORMANCE_TESTS({{Type}}, PLUGIN);

/// Largest of the rates V_p a . (grad v) a, summed over the particles of each cell [m^3/s], of a system at rest: there a is the
/// fibre itself.
double largest_stretching(kit::GridSystem system) {
  system.gather_gradients();
  const std::size_t d = std::size_t(system.dimension);
  std::map<std::array<int, 3>, double> cells;
  for (std::size_t p = 0; p < system.particle_count(); ++p) {
    std::array<int, 3> cell{};
    double rate = 0;
    for (std::size_t i = 0; i < d; ++i) {
      cell[i] = int(std::floor(system.position[d * p + i]));
      for (std::size_t j = 0; j < d; ++j)
        rate += system.fiber[3 * p + i] * system.velocity_gradient[d * (d * p + i) + j] * system.fiber[3 * p + j];
    }
    cells[cell] += system.volume[p] * rate;
  }
  double largest = 0;
  for (const auto& [cell, rate] : cells) largest = std::max(largest, std::abs(rate));
  return largest;
}

TEST({{Type}}Projection, LeavesNoStretchingAlongTheFibres) {
  const kit::Plugin plugin(PLUGIN);
  for (const int dimension : {2, 3}) {
    const kit::ConstraintInstance law(plugin, {}, dimension);
    kit::Random random(1);
    kit::GridSystem system =
        random_block(random, {.dimension = dimension, .fibers = kit::Block::uniform, .strain = kit::Block::rest});
    const double before = largest_stretching(system);
    const kit::Projection projected = project(law, system);
    ASSERT_EQ(projected.result, CLEAVE_OK) << projected.words;
    system.velocity = projected.velocity;
    EXPECT_LT(largest_stretching(system), 1e-6 * before) << dimension << "D";
  }
}

}  // namespace
