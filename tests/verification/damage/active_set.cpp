// Blocks that damage cannot reach are left out of its evolution. That, and the number of threads, may not change a bit.

#include "damage_scenes.hpp"

#include <tbb/global_control.h>

namespace cleave::test {
namespace {

struct Case {
  int dimension;
  config::Precision precision;
  bool explicitly, cubic;
};

class ActiveSet : public testing::TestWithParam<Case> {};

/// A bar with a notch, torn from it.
struct NotchedBar : DamageScene {
  static constexpr double dx = 1. / 16;
  explicit NotchedBar(const Case& c) : DamageScene(c.dimension, dx, points(c.dimension), {.E = 1e5}, {}) {
    // a law with a threshold: most of the bar is never driven
    scene.materials[0].damage =
        use("damage/anisotropic", {{"critical_stress", 6e3},
                                   {"viscosity", 2e-3},
                                   {"structural_alpha", std::vector<double>{}},
                                   {"length_scale", 0.08},
                                   {"integration", std::string(c.explicitly ? "explicit" : "implicit")}});
    scene.simulation.precision = c.precision;
    scene.simulation.maximum_time_step = 4e-4;
    scene.simulation.damage.tolerance = 1e-5;
    if (c.cubic) scene.simulation.damage.laplacian = config::Laplacian::cubic;
    hold(-2, -1.3, Vector3(-1, 0, 0));
    hold(1.3, 2, Vector3(1, 0, 0));
  }

 private:
  static std::vector<Point> points(int dimension) {
    auto points = lattice(dimension, dx, 2, Vector3(-1.5, -0.25, -0.125), Vector3(1.5, 0.25, 0.125));
    const auto in_notch = [](const Point& p) { return std::abs(p.x.x()) < 0.5 * dx && p.x.y() > 0.1; };
    points.erase(std::remove_if(points.begin(), points.end(), in_notch), points.end());
    for (auto& p : points) p.v.x() = 2 * std::clamp(p.x.x(), -0.3, 0.3);
    return points;
  }
};

TEST_P(ActiveSet, AndThreadsDoNotChangeABit) {
  const auto& c = GetParam();
  struct Run {
    bool active_set;
    std::size_t threads;
  };
  std::vector<std::vector<mpm::ParticleState>> results;
  for (const Run r : {Run{false, 1}, Run{true, 1}, Run{true, 2}, Run{true, 4}}) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, r.threads);
    NotchedBar s(c);
    s.scene.simulation.damage.active_set = r.active_set;
    const auto simulation = s.start();
    run(*simulation, 0.036);
    results.push_back(simulation->state());
    const double active = simulation->measure().damage_active;
    if (r.active_set) {
      EXPECT_LT(active, 0.6) << "some blocks were left out";
      EXPECT_GT(active, 0.05);
    } else {
      EXPECT_EQ(active, 1);
    }
  }
  double highest = 0;
  for (std::size_t r = 1; r < results.size(); r++)
    for (std::size_t i = 0; i < results[0].size(); i++) {
      ASSERT_EQ(results[r][i].damage, results[0][i].damage) << "run " << r << ", particle " << i;
      ASSERT_EQ(results[r][i].velocity, results[0][i].velocity);
      ASSERT_EQ(results[r][i].strain, results[0][i].strain);
      highest = std::max(highest, results[0][i].damage);
    }
  EXPECT_GT(highest, 0.25) << "a crack grew";
}

constexpr auto single = config::Precision::single_precision, twice = config::Precision::double_precision;
INSTANTIATE_TEST_SUITE_P(All, ActiveSet,
                         testing::Values(Case{2, single, false, false}, Case{2, twice, false, false},
                                         Case{3, single, false, false}, Case{3, twice, false, false},
                                         Case{2, single, true, false}, Case{2, twice, true, false},
                                         Case{3, single, true, false}, Case{3, twice, true, true}, Case{2, single, true, true}),
                         [](const auto& info) {
                           const Case& c = info.param;
                           return std::string(c.explicitly ? c.cubic ? "Cubic" : "Weak" : "Implicit") +
                                  std::to_string(c.dimension) + "D" + (c.precision == single ? "Single" : "Double");
                         });

/// A bar at rest that breaks at once in one cell: how far damage comes in a single step is up to the solver, be it by many
/// iterations over a length of many cells, or by an explicit step in parts.
TEST(ActiveSet, GrowsWithDamageInsideAStep) {
  for (bool explicitly : {false, true}) {
    const double dx = 0.1;
    const Solid solid;
    const PhaseField law{.l0 = (explicitly ? 1.5 : 4) * dx, .eta = 1e-3, .explicitly = explicitly};
    auto points = lattice(3, dx, 2, Vector3(-4, -0.2, -0.2), Vector3(4, 0.2, 0.2));
    for (auto& p : points)
      if (std::abs(p.x.x() - 4.75 * dx) < 0.3 * dx) p.F = stretched_to(solid, law.energy(1e3));  // at the edge of a block
    std::vector<std::vector<mpm::ParticleState>> results;
    for (bool active_set : {false, true}) {
      DamageScene s(3, dx, points, solid, law);
      s.scene.simulation.damage.active_set = active_set;
      s.hold(-10, 10);
      const auto simulation = s.start();
      simulation->step(100);
      results.push_back(simulation->state());
    }
    double farthest = 0;
    for (std::size_t i = 0; i < points.size(); i++) {
      ASSERT_EQ(results[1][i].damage, results[0][i].damage) << (explicitly ? "explicit" : "implicit") << " at " << points[i].x;
      if (results[0][i].damage > 0) farthest = std::max(farthest, std::abs(points[i].x.x() - 4.75 * dx) / dx);
    }
    EXPECT_GT(farthest, explicitly ? 8.75 : 20) << "cells: beyond the blocks that are next but one";
  }
}

}  // namespace
}  // namespace cleave::test
