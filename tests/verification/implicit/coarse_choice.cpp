// When coarse factors are made: once what was spent without them has come to their price.

#include "mpm/coarse_choice.hpp"

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

}  // namespace
}  // namespace cleave::test
