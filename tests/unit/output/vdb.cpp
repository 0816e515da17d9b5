#include "output/frame.hpp"
#include "run_directory.hpp"

#include <openvdb/openvdb.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/tools/LevelSetMeasure.h>
#include <openvdb/tools/LevelSetUtil.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

namespace cleave::output {
namespace {

namespace points = openvdb::points;

class VdbFrames : public RunDirectory {
 protected:
  openvdb::GridPtrVec grids(const std::string& name) {
    openvdb::initialize();
    openvdb::io::File file((directory / name).string());
    file.open(/*delayLoad=*/false);
    const openvdb::GridPtrVecPtr read = file.getGrids();
    return *read;
  }
};

class VdbPoints : public VdbFrames, public testing::WithParamInterface<int> {};

TEST_P(VdbPoints, ReadBackAsTheyWereWritten) {
  const ParticleFrame frame = random_frame(5000, GetParam());
  Writer(directory, {"vdb"}, false).frame(frame);

  std::set<std::int64_t> ids;
  const openvdb::GridPtrVec all = grids("points/frame_0007.vdb");
  ASSERT_EQ(all.size(), 2u);
  for (std::size_t body = 0; body < 2; ++body) {
    const auto grid = openvdb::gridPtrCast<points::PointDataGrid>(all[body]);
    ASSERT_TRUE(grid);
    EXPECT_EQ(grid->getName(), frame.bodies[body]);
    EXPECT_NEAR(grid->voxelSize().x(), 2 * frame.cell_size, 1e-12);
    EXPECT_DOUBLE_EQ(grid->metaValue<double>("time"), frame.time);
    EXPECT_EQ(grid->metaValue<std::int32_t>("frame"), 7);
    EXPECT_DOUBLE_EQ(grid->metaValue<double>("cell_size"), frame.cell_size);
    EXPECT_EQ(grid->metaValue<std::string>("scene_units"), "m, kg, s");
    EXPECT_EQ(grid->metaValue<std::string>("unit_stress"), "Pa");
    for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
      const points::AttributeHandle<openvdb::Vec3f> position(leaf->constAttributeArray("P")),
          velocity(leaf->constAttributeArray("v")), fiber(leaf->constAttributeArray("fiber"));
      const points::AttributeHandle<std::int64_t> id(leaf->constAttributeArray("id"));
      const points::AttributeHandle<float> radius(leaf->constAttributeArray("pscale")),
          damage(leaf->constAttributeArray("damage")), stress(leaf->constAttributeArray("stress")),
          gradient(leaf->constAttributeArray("F")), renamed(leaf->constAttributeArray("v_"));
      ASSERT_EQ(stress.stride(), 6u);
      ASSERT_EQ(gradient.stride(), 9u);
      for (auto index = leaf->beginIndexOn(); index; ++index) {
        ASSERT_TRUE(ids.insert(id.get(*index)).second);
        const auto i = static_cast<std::size_t>(id.get(*index));
        ASSERT_LT(i, 5000u);
        ASSERT_EQ(body, i < 3334 ? 0u : 1u);
        const openvdb::Vec3d world = grid->indexToWorld(openvdb::Vec3d(position.get(*index)) + index.getCoord().asVec3d());
        for (int c = 0; c < 3; ++c) {
          ASSERT_NEAR(world[c], frame.positions[i][c], 1e-7);  // single precision ends at 4e-6 here
          ASSERT_EQ(velocity.get(*index)[c], frame.velocities[i][c]);
          ASSERT_EQ(fiber.get(*index)[c], frame.attributes[1].values[3 * i + static_cast<std::size_t>(c)]);
        }
        const double volume = GetParam() == 2 ? std::numbers::pi * std::pow(radius.get(*index), 2)
                                              : 4 * std::numbers::pi / 3 * std::pow(radius.get(*index), 3);
        ASSERT_NEAR(volume, frame.volumes[i], 1e-6 * frame.volumes[i]);
        ASSERT_EQ(damage.get(*index), frame.attributes[0].values[i]);
        for (openvdb::Index c = 0; c < 6; ++c) ASSERT_EQ(stress.get(*index, c), frame.attributes[2].values[6 * i + c]);
        for (openvdb::Index c = 0; c < 9; ++c) ASSERT_EQ(gradient.get(*index, c), frame.attributes[3].values[9 * i + c]);
        ASSERT_EQ(renamed.get(*index), frame.attributes[4].values[i]);
      }
    }
  }
  EXPECT_EQ(ids.size(), 5000u);
}

INSTANTIATE_TEST_SUITE_P(Dimensions, VdbPoints, testing::Values(2, 3));

TEST_F(VdbFrames, ParticlesWithoutAPlaceAreCountedInsteadOfWritten) {
  ParticleFrame frame = random_frame(300);
  frame.positions[4].x() = std::nan("");
  frame.positions[7].y() = 1e30;
  frame.positions[10].z() = -INFINITY;
  Writer(directory, {"vdb"}, true).frame(frame);
  const auto grid = openvdb::gridPtrCast<points::PointDataGrid>(grids("points/frame_0007.vdb")[0]);
  EXPECT_EQ(points::pointCount(grid->tree()), 200u - 3);
  EXPECT_EQ(grid->metaValue<std::int64_t>("particles_left_out"), 3);
  EXPECT_EQ(grids("surface/frame_0007.vdb")[0]->metaValue<std::int64_t>("particles_left_out"), 3);
}

TEST_F(VdbFrames, ABodyWithoutParticlesKeepsItsGrid) {
  ParticleFrame frame = random_frame(30);
  frame.bodies.push_back("gone");
  frame.body_ends.push_back(30);
  Writer(directory, {"vdb"}, true).frame(frame);
  for (const char* name : {"points/frame_0007.vdb", "surface/frame_0007.vdb"}) {
    const openvdb::GridPtrVec all = grids(name);
    ASSERT_EQ(all.size(), name[0] == 's' ? 6u : 3u) << name;  // surfaces come with the damage on them
    const auto gone = std::find_if(all.begin(), all.end(), [](const auto& grid) { return grid->getName() == "gone"; });
    ASSERT_NE(gone, all.end()) << name;
    EXPECT_EQ((*gone)->activeVoxelCount(), 0u) << name;
  }
}

/// Particles at random within the cells of a lattice, as sampling makes them, of those that are in the shape.
template <class Inside>
ParticleFrame sampled(double spacing, double extent, double jitter, const Inside& inside) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> offset(-jitter / 2, jitter / 2);
  ParticleFrame frame;
  frame.cell_size = 2 * spacing;
  frame.bodies = {"solid"};
  const int n = static_cast<int>(std::ceil(extent / spacing));
  for (int i = -n; i < n; ++i)
    for (int j = -n; j < n; ++j)
      for (int k = -n; k < n; ++k) {
        const Vector3 center(i + 0.5, j + 0.5, k + 0.5), shift(offset(random), offset(random), offset(random));
        if (inside(Vector3(spacing * center))) frame.positions.push_back(spacing * (center + shift));
      }
  const std::size_t particles = frame.positions.size();
  frame.body_ends = {particles};
  frame.velocities.assign(particles, Eigen::Vector3f::Zero());
  frame.volumes.assign(particles, static_cast<float>(spacing * spacing * spacing));
  return frame;
}

class VdbSurface : public VdbFrames {
 protected:
  openvdb::FloatGrid::Ptr surface(const ParticleFrame& frame) {
    Writer(directory, {}, true).frame(frame);
    return openvdb::gridPtrCast<openvdb::FloatGrid>(grids("surface/frame_0000.vdb").at(0));
  }
};

TEST_F(VdbSurface, EnclosesTheVolumeOfTheBall) {
  for (const double jitter : {0.0, 1.0}) {
    const ParticleFrame frame = sampled(0.05, 1, jitter, [](const Vector3& x) { return x.norm() < 1; });
    const openvdb::FloatGrid::Ptr grid = surface(frame);
    ASSERT_TRUE(grid);
    EXPECT_EQ(grid->getGridClass(), openvdb::GRID_LEVEL_SET);
    EXPECT_EQ(grid->getName(), "solid");
    const double volume = 4 * std::numbers::pi / 3;
    EXPECT_NEAR(openvdb::tools::levelSetVolume(*grid), volume, 0.04 * volume) << "jitter " << jitter;
    RecordProperty("volume_ratio_jitter_" + std::to_string(jitter),
                   std::to_string(openvdb::tools::levelSetVolume(*grid) / volume));
  }
}

TEST_F(VdbSurface, IsOneClosedSmoothSkinWithADistanceInside) {
  const openvdb::FloatGrid::Ptr grid = surface(sampled(0.05, 1, 1.0, [](const Vector3& x) { return x.norm() < 1; }));
  std::vector<openvdb::FloatGrid::Ptr> pieces;
  openvdb::tools::segmentSDF(*grid, pieces);
  EXPECT_EQ(pieces.size(), 1u);
  const openvdb::FloatGrid::ConstAccessor values = grid->getConstAccessor();
  for (auto value = grid->cbeginValueAll(); value; ++value) {
    const double distance = grid->indexToWorld(value.getCoord()).length() - 1;
    if (!value.isVoxelValue()) continue;
    ASSERT_TRUE(distance > -0.1 || *value < 0) << "a hole at " << value.getCoord();
    ASSERT_TRUE(distance < 0.1 || *value > 0) << "a bump at " << value.getCoord();
  }
  EXPECT_FLOAT_EQ(values.getValue({0, 0, 0}), -grid->background());
  EXPECT_FALSE(values.isValueOn({0, 0, 0}));
}

TEST_F(VdbSurface, KeepsSingleParticlesAndSeparatesPieces) {
  ParticleFrame frame = sampled(0.1, 0.5, 0, [](const Vector3& x) { return x.norm() < 0.5 && std::abs(x.x()) > 0.1; });
  for (Vector3& x : frame.positions) x.x() += x.x() > 0 ? 0.2 : -0.2;
  frame.positions[0] = {3, 3, 3};
  std::vector<openvdb::FloatGrid::Ptr> pieces;
  openvdb::tools::segmentSDF(*surface(frame), pieces);
  EXPECT_EQ(pieces.size(), 3u);
}

}  // namespace
}  // namespace cleave::output
