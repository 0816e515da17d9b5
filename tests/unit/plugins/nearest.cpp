#include "common/nearest.hpp"

#include <gtest/gtest.h>

namespace cleave {
namespace {

TEST(EditDistance, CountsInsertionsDeletionsSubstitutionsAndSwaps) {
  EXPECT_EQ(edit_distance("stress", "stress", 9), 0u);
  EXPECT_EQ(edit_distance("stress", "stres", 9), 1u);
  EXPECT_EQ(edit_distance("strss", "stress", 9), 1u);
  EXPECT_EQ(edit_distance("strain", "stress", 9), 3u);
  EXPECT_EQ(edit_distance("srtess", "stress", 9), 1u);
  EXPECT_EQ(edit_distance("", "abc", 9), 3u);
}

TEST(EditDistance, StopsJustAboveItsBound) { EXPECT_EQ(edit_distance("aaaaaaaa", "bbbbbbbb", 3), 4u); }

TEST(Nearest, FindsTheMisspeltWord) {
  const std::vector<std::string> keys{"youngs_modulus", "poissons_ratio", "shear_modulus"};
  EXPECT_EQ(nearest("young_modulus", keys), "youngs_modulus");
  EXPECT_EQ(nearest("poisson_ratio", keys), "poissons_ratio");
}

TEST(Nearest, SuggestsNothingForAWordUnlikeAll) {
  EXPECT_EQ(nearest("colour", {"youngs_modulus", "density"}), std::nullopt);
  EXPECT_EQ(nearest("xy", {"d"}), std::nullopt);
}

}  // namespace
}  // namespace cleave
