// Norms, the Pareto front, orders, and the boundary of stability.

#include "common/error.hpp"
#include "study/measure.hpp"
#include "study/pareto.hpp"
#include "study/stability.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cleave::study {
namespace {

using testing::ElementsAre;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TEST(ErrorNorms, AreThoseOfTheLengthsOfVectors) {
  const Samples samples{{3, 4}, {0, 0}, {0, 1}, {0, 2}};
  EXPECT_DOUBLE_EQ(norm_of(samples, Norm::l2), std::sqrt((25 + 0 + 1 + 4) / 4.));
  EXPECT_DOUBLE_EQ(norm_of(samples, Norm::maximum), 5);
  EXPECT_DOUBLE_EQ(norm_of(samples, Norm::last), 2);
  EXPECT_TRUE(std::isnan(norm_of({{1}, {nan}, {2}}, Norm::maximum))) << "a number that is none is not passed over";
}

TEST(ErrorNorms, AreRelativeToWhatIsExpectedOrToAScale) {
  const Samples actual{{1.1}, {2.2}}, expected{{1}, {2}};
  EXPECT_NEAR(error_between(actual, expected, Norm::l2, true, {}), 0.1, 1e-14);
  EXPECT_NEAR(error_between(actual, expected, Norm::maximum, false, {}), 0.2, 1e-14);
  EXPECT_NEAR(error_between(actual, expected, Norm::maximum, true, 4), 0.05, 1e-14);
  EXPECT_THROW(error_between(actual, {{0}, {0}}, Norm::l2, true, {}), InputError) << "relative to nothing";
  EXPECT_THROW(error_between(actual, {{1}}, Norm::l2, true, {}), InputError);
}

TEST(Interpolation, IsLinearAndEndsWhereTheTableDoes) {
  const std::vector<double> at{0, 1, 3};
  const Samples values{{0, 1}, {2, 1}, {4, 0}};
  EXPECT_THAT(interpolated(at, values, std::vector<double>{0, 0.25, 2, 3}),
              ElementsAre(ElementsAre(0, 1), ElementsAre(0.5, 1), ElementsAre(3, 0.5), ElementsAre(4, 0)));
  EXPECT_THROW(interpolated(at, values, std::vector<double>{3.1}), InputError);
}

TEST(ParetoFront, LeavesOutWhatAnotherPointBeats) {
  const std::vector<double> costs{1, 2, 2, 4, 3, nan, 5, 0.5}, errors{9, 4, 5, 1, 4, 0, 1, nan};
  // (2, 5) and (3, 4) are beaten by (2, 4), (5, 1) by (4, 1)
  EXPECT_THAT(pareto_front(costs, errors), ElementsAre(0, 1, 3));
  EXPECT_THAT(pareto_front(std::vector<double>{1, 1}, std::vector<double>{2, 2}), ElementsAre(0, 1))
      << "neither beats its equal";
  EXPECT_THAT(pareto_front(std::vector<double>{1, 2, 3}, std::vector<double>{1, 0.995, 0.98}), ElementsAre(0, 2))
      << "nothing is paid for half a percent";
}

TEST(ObservedOrder, IsThatOfTheTwoFinestPoints) {
  EXPECT_NEAR(observed_order(std::vector<double>{0.4, 0.1, 0.2}, std::vector<double>{1, 0.01, 0.04}), 2, 1e-12);
  EXPECT_TRUE(std::isnan(observed_order(std::vector<double>{0.1}, std::vector<double>{1})));
  EXPECT_TRUE(std::isnan(observed_order(std::vector<double>{0.1, 0.2}, std::vector<double>{0, 1})));
}

TEST(StabilityBoundary, HoldsAtMostAFactorTwoBelowAndNeverAbove) {
  const std::vector<double> steps{1, 2, 4, 8, 16};
  constexpr State ok = State::stable, bad = State::failed;
  const auto verdict = [&](std::vector<State> states, double predicted) {
    return std::string(boundary_of(steps, states, predicted).verdict);
  };
  EXPECT_EQ(verdict({ok, ok, ok, bad, bad}, 3), "holds");
  EXPECT_EQ(verdict({ok, ok, ok, bad, bad}, 7.9), "holds") << "the boundary may be anywhere up to 8";
  EXPECT_EQ(verdict({ok, ok, ok, bad, bad}, 8), "above the boundary");
  EXPECT_EQ(verdict({ok, ok, ok, bad, bad}, 1.9), "below half of the boundary");
  EXPECT_EQ(verdict({ok, bad, ok, ok, ok}, 3), "above the boundary") << "what is stable beyond a failure does not count";
  EXPECT_EQ(verdict({ok, State::degraded, bad, bad, bad}, 1.5), "holds") << "degraded is not stable";
  EXPECT_EQ(verdict({ok, ok, ok, ok, ok}, 12), "not reached");
  EXPECT_EQ(verdict({ok, ok, ok, ok, ok}, 7), "below half of the boundary");
  EXPECT_EQ(verdict({bad, bad, bad, bad, bad}, 0.5), "not resolved");
  const Boundary boundary = boundary_of(steps, {ok, ok, ok, bad, bad}, 5);
  EXPECT_DOUBLE_EQ(*boundary.low, 0.8);
  EXPECT_DOUBLE_EQ(*boundary.high, 1.6);
}

}  // namespace
}  // namespace cleave::study
