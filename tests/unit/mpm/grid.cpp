#include "mpm/grid.hpp"

#include <gtest/gtest.h>

#include <set>

namespace cleave::mpm {
namespace {

TEST(MortonKey, IsUniqueOverTheWholeRange) {
  std::set<std::uint64_t> keys;
  for (int x : {-farthest_block, -2, -1, 0, 1, 7, farthest_block})
    for (int y : {-farthest_block, -1, 0, 3, farthest_block})
      for (int z : {-farthest_block, -1, 0, farthest_block}) EXPECT_TRUE(keys.insert(morton_key({x, y, z})).second);
}

TEST(BlockDirectory, FindsWhatWasInsertedAndNothingElse) {
  BlockDirectory directory;
  directory.reset(2);  // grows by itself
  for (std::uint32_t i = 0; i < 5000; i++) EXPECT_EQ(directory.insert(i * 977, i), i);
  EXPECT_EQ(directory.insert(977, 42), 1u) << "the first value stays";
  for (std::uint32_t i = 0; i < 5000; i++) EXPECT_EQ(directory.find(i * 977), i);
  EXPECT_EQ(directory.find(5), BlockDirectory::none);
}

TEST(Grid, HoldsEveryNodeAParticleCanReach) {
  Grid<float, 3> grid;
  grid.rebuild({{0, 0, 0}, {1, 0, 0}, {-7, 3, 2}});
  EXPECT_EQ(grid.blocks(), 36u + 27u);
  BlockView block{};
  grid.link(block, {-7, 3, 2});
  for (int i = 0; i < 27; i++) {
    ASSERT_LT(block.neighbours[i], grid.blocks());
    const auto& c = grid.coordinate(block.neighbours[i]);
    EXPECT_EQ(c, (BlockCoordinate{-7 + i / 9 - 1, 3 + i / 3 % 3 - 1, 2 + i % 3 - 1}));
  }
  EXPECT_EQ(grid.find({5, 5, 5}), BlockDirectory::none);
}

TEST(Grid, NumbersNodesBothWays) {
  Grid<double, 2> flat;
  flat.rebuild({{-1, 2, 0}});
  for (std::size_t n = 0; n < flat.nodes(); n++) EXPECT_EQ(flat.node_index(flat.node_coordinates(n)), n);
  Grid<double, 3> deep;
  deep.rebuild({{-1, 2, 0}});
  for (std::size_t n = 0; n < deep.nodes(); n++) EXPECT_EQ(deep.node_index(deep.node_coordinates(n)), n);
  EXPECT_EQ(deep.node_index({100, 0, 0}), ~std::size_t(0));
}

}  // namespace
}  // namespace cleave::mpm
