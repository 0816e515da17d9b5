// When coarse factors are made: once what was spent without them has come to their price.

#include "mpm/coarse_choice.hpp"
#include "scenes.hpp"

#include <gtest/gtest.h>

namespace cleave::test {
namespace {

using mpm::CoarseChoice;

/// Directions of easy steps take no more products than with factors: rent never adds up.
TEST(CoarseChoice, EasyStepsDoWithout) {
  CoarseChoice choice(10);
  for (int i = 0; i < 1000; i++) {
    EXPECT_FALSE(choice.due(3, 1));
    EXPECT_TRUE(choice.took(3, false, 1, 1));
  }
}

TEST(CoarseChoice, RentsUpToThePrice) {
  CoarseChoice choice(10);
  int spent = 0;
  while (!choice.due(spent, 1)) spent++;
  EXPECT_EQ(spent, 4 + 10 + 1) << "beyond the usual four";
  CoarseChoice another(10);
  int directions = 0;
  for (; !another.due(6, 1); directions++) another.took(6, false, 1, 1);
  EXPECT_EQ(directions, 5) << "two too many in each";
}

TEST(CoarseChoice, MakesThemAnewWhenTheyAreWorn) {
  CoarseChoice choice(10);
  choice.made(40);
  for (int i = 0; i < 8; i++) {
    EXPECT_FALSE(choice.due(1000, 1)) << "what is usual is not known yet";
    EXPECT_TRUE(choice.took(7, true, 1, 1)) << "seven in place of forty";
  }
  int directions = 0;
  for (; !choice.due(8, 1); directions++) EXPECT_TRUE(choice.took(8, true, 1, 1));
  EXPECT_EQ(directions, 10) << "one too many in each";
}

TEST(CoarseChoice, DropsThemWhereTheySaveNothing) {
  for (const double cost_with : {1.0, 1.5}) {
    CoarseChoice choice(10);
    choice.made(9);
    bool kept = true;
    for (int i = 0; i < 8; i++) kept = choice.took(7, true, cost_with, 1);
    EXPECT_EQ(kept, 7 * cost_with < 9);
  }
}

/// A stiff bar that sags from its held end. Diagonal blocks carry residuals from cell to cell, so that iterations would grow
/// with its length; the coarse space carries them along it at once.
TEST(CoarseSpace, CarriesResidualsAlongALongBar) {
  const auto iterations = [](int cells) {
    constexpr double dx = 0.05;
    PointScene s(2, dx, lattice(2, dx, 2, Vector3(-2 * dx, 0, 0), Vector3(cells * dx, 4 * dx, 0)),
                 "elasticity/split-neo-hookean", {{"youngs_modulus", 1e9}, {"poissons_ratio", 0.3}}, 1000);
    s.scene.simulation.gravity = Vector3(0, -1, 0);
    s.scene.simulation.integrator = config::Integrator::implicit;
    s.scene.simulation.maximum_time_step = 0.02;
    s.scene.colliders.push_back(half_space(config::Contact::sticky, Vector3(1, 0, 0)));
    const auto simulation = s.start();
    for (int i = 0; i < 3; i++) simulation->step(10);
    simulation->measure();
    for (int i = 0; i < 5; i++) simulation->step(10);
    const auto r = simulation->measure();
    return r.linear_iterations / r.newton_iterations;
  };
  EXPECT_LT(iterations(128), 60) << "products a direction: 25, and 210 by diagonal blocks alone";
}

}  // namespace
}  // namespace cleave::test
