// The choice of integrator = "auto", given what implicit steps cost.

#include "mpm/integrator_choice.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cleave::mpm {
namespace {

using ::testing::HasSubstr;

/// Steps of a simulation whose implicit step is worth so many symplectic ones of a millisecond.
IntegratorChoice::Steps worth(double steps) {
  return {.symplectic = {1e-3, "elastic wave"}, .implicit = {steps * 1e-3, "particle speed"}};
}

/// One Newton iteration with so many products.
SolveWork work(int products) { return {.evaluations = 2, .products = products, .tangents = 1}; }

IntegratorChoice::Trial always(SolveWork result) {
  return [=](double) { return result; };
}
const IntegratorChoice::Trial given_up = [](double) { return std::nullopt; };
const IntegratorChoice::Trial unexpected = [](double) -> std::optional<SolveWork> {
  ADD_FAILURE() << "a trial";
  return std::nullopt;
};

TEST(IntegratorChoice, TakesWhatIsCheaperAndSaysWhy) {
  const double cost = implicit_cost(work(30));
  for (const bool cheaper : {true, false}) {
    IntegratorChoice choice;
    const auto text = choice.choose(worth(cost * (cheaper ? 2 : 0.5)), always(work(30)));
    EXPECT_EQ(choice.implicit(), cheaper);
    ASSERT_TRUE(text);
    EXPECT_EQ(text->find(cheaper ? "implicit" : "symplectic"), 0u) << *text;
    EXPECT_THAT(*text, HasSubstr("1e+03 if symplectic (of 0.001 s, bounded by elastic wave)"));
    EXPECT_THAT(*text, HasSubstr(cheaper ? "to cost 500 symplectic" : "to cost 2e+03 symplectic"));
    EXPECT_THAT(*text, HasSubstr("bounded by particle speed"));
  }
}

/// Damage and constraints are paid for in every step: where they are dear, an implicit step that costs twice the symplectic
/// steps in its time is the cheaper one.
TEST(IntegratorChoice, CountsWhatStepsOfBothKindsPay) {
  const double cost = implicit_cost(work(30));
  for (const double share : {0.0, 1.0}) {
    const SharedWork shared{.driven = share, .damaged = share, .damage_iterations = 3 * share, .projected = share};
    IntegratorChoice choice;
    choice.choose(worth(cost / 2), always(work(30)));
    EXPECT_FALSE(choice.implicit());
    choice.took_symplectic_step(shared);
    const auto text = choice.choose(worth(cost / 2), always(work(30)));
    EXPECT_EQ(choice.implicit(), share > 0) << "at once: what it costs is known";
    if (share > 0) {
      EXPECT_THAT(text.value_or(""), HasSubstr("are for damage and constraints"));
    }
    for (int i = 0; i < 100 && choice.implicit(); i++) {  // as they end
      choice.took_implicit_step(work(30), worth(cost / 2).implicit.seconds);
      choice.choose(worth(cost / 2), always(work(30)));
    }
    EXPECT_FALSE(choice.implicit());
  }
  EXPECT_GT(shared_cost({.projected = 1, .projection_iterations = 4}), shared_cost({.projected = 1}));
}

TEST(IntegratorChoice, TriesNothingWhereThereIsNothingToGain) {
  IntegratorChoice choice;
  EXPECT_THAT(choice.choose(worth(implicit_cost(work(1))), unexpected).value_or(""), HasSubstr("at least"));
  for (int i = 0; i < 1000; i++) {
    choice.took_symplectic_step();
    EXPECT_FALSE(choice.choose(worth(1), unexpected)) << "said once";
  }
}

TEST(IntegratorChoice, SpendsATwentiethOnTrialsAtMost) {
  for (const bool gives_up : {false, true}) {
    IntegratorChoice choice;
    const double steps = 20000, limit = 100;
    double spent = 0;
    const auto trial = [&](double most) -> std::optional<SolveWork> {
      EXPECT_EQ(most, limit);
      spent += gives_up ? most : implicit_cost(work(75));
      return gives_up ? std::nullopt : std::optional(work(75));
    };
    for (int i = 0; i < steps; i++) {
      choice.choose(worth(limit), trial);
      EXPECT_FALSE(choice.implicit());
      choice.took_symplectic_step();
    }
    EXPECT_LE(spent, steps / 20 + limit);
    EXPECT_GT(spent, steps / 40) << "what was dear once may get cheap";
  }
}

TEST(IntegratorChoice, ReturnsToSymplecticStepsWhereImplicitOnesGetDear) {
  IntegratorChoice choice;
  const auto steps = worth(1000);
  choice.choose(steps, always(work(100)));
  ASSERT_TRUE(choice.implicit());
  for (int i = 0; i < 100; i++) {
    choice.took_implicit_step(work(200), 1);
    EXPECT_FALSE(choice.choose(steps, unexpected)) << "nothing has changed";
  }
  std::optional<std::string> text;
  int taken = 0;
  for (; choice.implicit() && taken < 100; taken++) {
    choice.took_implicit_step(work(2000), 1);
    text = choice.choose(steps, unexpected);
  }
  EXPECT_THAT(text.value_or(""), HasSubstr("symplectic steps: "));
  EXPECT_GT(taken, 1) << "one step may be an exception";
  EXPECT_LT(taken, 16);
}

TEST(IntegratorChoice, DoesNotWaverBetweenTwoThatCostTheSame) {
  const double cost = implicit_cost(work(100));
  for (const bool from_implicit : {true, false}) {
    IntegratorChoice choice;
    choice.choose(worth(cost * (from_implicit ? 1.5 : 0.5)), always(work(100)));
    ASSERT_EQ(choice.implicit(), from_implicit);
    int changes = 0;
    for (int i = 0; i < 20000; i++) {
      const auto steps = worth(cost * (i % 2 ? 1.15 : 0.9));
      const bool was = choice.implicit();
      choice.choose(steps, always(work(100)));
      changes += choice.implicit() != was;
      if (choice.implicit())
        choice.took_implicit_step(work(100), steps.implicit.seconds);
      else
        choice.took_symplectic_step();
    }
    EXPECT_LE(changes, 1);
  }
}

TEST(IntegratorChoice, GoesBackToImplicitStepsWhenTheyGetCheap) {
  IntegratorChoice choice;
  choice.choose(worth(100), given_up);
  EXPECT_FALSE(choice.implicit());
  int steps = 0;
  for (; !choice.implicit() && steps < 10000; steps++) {
    choice.took_symplectic_step();
    choice.choose(worth(100), always(work(10)));
  }
  EXPECT_GE(steps, 20 * 100);
  EXPECT_LT(steps, 20 * 100 + 2);
}

}  // namespace
}  // namespace cleave::mpm
