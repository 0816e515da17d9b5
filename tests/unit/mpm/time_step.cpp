#include "mpm/time_step.hpp"

#include <gtest/gtest.h>

namespace cleave::mpm {
namespace {

TEST(EqualSteps, NeverExceedTheBoundNorLeaveARemainder) {
  for (double bound : {1e-4, 3.3e-3, 0.7, 1.0, 5.0})
    for (double remaining : {1e-3, 0.04, 1.0, 1.0 / 24}) {
      double left = remaining, smallest = 1e9, largest = 0;
      int steps = 0;
      while (left > 1e-12 * remaining) {
        const double dt = equal_steps(left, bound);
        EXPECT_LE(dt, bound * (1 + 1e-6));
        smallest = std::min(smallest, dt);
        largest = std::max(largest, dt);
        left -= dt;
        ASSERT_LT(++steps, 100000);
      }
      EXPECT_EQ(steps, std::max(1, int(std::ceil(remaining / bound - 1e-6))));
      EXPECT_NEAR(smallest, largest, 1e-6 * largest);
    }
}

TEST(EqualSteps, KeepsAStepThatDividesTheTime) {
  double left = 40 * 2e-4;
  for (int i = 0; i < 39; i++) {
    EXPECT_EQ(equal_steps(left, 2e-4), 2e-4);
    left -= 2e-4;
  }
  EXPECT_EQ(equal_steps(left, 2e-4), left);
}

}  // namespace
}  // namespace cleave::mpm
