#include "scene_testing.hpp"

#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <cmath>

namespace cleave::scene {
namespace {

using testing::HasSubstr;

openvdb::FloatGrid::Ptr sphere(const std::string& name, double radius, const Vector3& center, double voxel) {
  const openvdb::Vec3f at(static_cast<float>(center[0]), static_cast<float>(center[1]), static_cast<float>(center[2]));
  auto grid =
      openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(static_cast<float>(radius), at, static_cast<float>(voxel), 4);
  grid->setName(name);
  return grid;
}

class LevelSetFiles : public testing::Test {
 protected:
  static void SetUpTestSuite() { openvdb::initialize(); }

  std::filesystem::path save(const std::string& name, const openvdb::GridCPtrVec& grids) const {
    openvdb::io::File((directory.path() / name).string()).write(grids);
    return directory.path() / name;
  }
  static ShapeSpec spec_of(const std::filesystem::path& file, const std::string& grid = {}) {
    ShapeSpec spec;
    spec.type = ShapeSpec::Type::level_set;
    spec.file = file;
    spec.grid = grid;
    return spec;
  }
  static std::string error_of(const ShapeSpec& spec) {
    return input_error([&] { build_shape(spec, 0.1); });
  }

  TemporaryDirectory directory;
};

TEST_F(LevelSetFiles, KeepTheirDistances) {
  const Vector3 center(1, 2, 3);
  const auto shape = build_shape(spec_of(save("sphere.vdb", {sphere("ball", 1, center, 0.05)})), 0.1);
  RandomPoints points(1.3);
  for (int i = 0; i < 20000; ++i) {
    const Vector3 x = center + points.next();
    const double expected = (x - center).norm() - 1, distance = shape->distance(x);
    if (std::abs(expected) < shape->band()) {
      ASSERT_NEAR(distance, expected, 2e-3);
      ASSERT_LT((shape->normal(x) - (x - center).normalized()).norm(), 0.02);
    } else {
      ASSERT_EQ(distance < 0, expected < 0);
      ASSERT_GE(std::abs(distance), shape->band() - 2e-3);
      ASSERT_LE(std::abs(distance), std::abs(expected) + 2e-3);
    }
  }
  EXPECT_TRUE(shape->bounds().isApprox(Box(center.array() - 1, center.array() + 1), 1e-3));
  EXPECT_LT(shape->distance(center), 0);
}

TEST_F(LevelSetFiles, GiveTheGridAskedForOrTheFirstLevelSet) {
  auto density = openvdb::FloatGrid::create(0);
  density->setName("density");
  density->setGridClass(openvdb::GRID_FOG_VOLUME);
  const auto file =
      save("several.vdb", {density, sphere("ball", 1, Vector3::Zero(), 0.05), sphere("large", 2, Vector3::Zero(), 0.1)});
  EXPECT_NEAR(build_shape(spec_of(file), 0.1)->bounds().max()[0], 1, 2e-3);
  EXPECT_NEAR(build_shape(spec_of(file, "large"), 0.1)->bounds().max()[0], 2, 2e-3);
  EXPECT_THAT(error_of(spec_of(file, "huge")), HasSubstr("several.vdb: no grid named 'huge'; it has 'ball' (float, level set), "
                                                         "'density' (float, fog volume), 'large' (float, level set)"));
  EXPECT_THAT(error_of(spec_of(file, "density")), HasSubstr("the grid 'density' is not a level set"));
}

TEST_F(LevelSetFiles, AreScaledCentredAndTurned) {
  auto grid = sphere("ball", 1, Vector3(5, 0, 0), 0.05);
  ShapeSpec spec = spec_of(save("sphere.vdb", {grid}));
  spec.file_size = 1;
  spec.centered = true;
  spec.center = Vector3(0, 1, 0);
  spec.translation = Vector3(0, 0, 2);
  const auto shape = build_shape(spec, 0.1);
  EXPECT_NEAR(shape->distance({0, 1.55, 2}), 0.05, 1e-3);
  EXPECT_NEAR(shape->distance({0, 1.45, 2}), -0.05, 1e-3);

  grid->transform().postRotate(0.7, openvdb::math::Z_AXIS);
  const auto turned = build_shape(spec_of(save("turned.vdb", {grid})), 0.1);
  const Vector3 center(5 * std::cos(0.7), turned->bounds().center()[1], 0);
  EXPECT_NEAR(std::abs(center[1]), 5 * std::sin(0.7), 2e-3);
  EXPECT_NEAR(turned->distance(center + Vector3(0.6, 0.6, 0.6)), std::sqrt(1.08) - 1, 2e-3);
}

TEST_F(LevelSetFiles, ThatCannotBeUsedAreRefusedByName) {
  EXPECT_THAT(error_of(spec_of(directory.path() / "absent.vdb")), HasSubstr("absent.vdb: no such file"));
  EXPECT_THAT(error_of(spec_of(directory.write("text.vdb", "not a grid"))), HasSubstr("text.vdb: not a readable OpenVDB file"));
  const auto whole = save("whole.vdb", {sphere("ball", 1, Vector3::Zero(), 0.05)});
  std::filesystem::resize_file(whole, std::filesystem::file_size(whole) / 2);
  EXPECT_THAT(error_of(spec_of(whole)), HasSubstr("whole.vdb: not a readable OpenVDB file"));
  EXPECT_THAT(error_of(spec_of(save("none.vdb", {}))),
              HasSubstr("no level set of single precision in the file; it has no grids"));
  auto empty = openvdb::createLevelSet<openvdb::FloatGrid>(0.1);
  empty->setName("void");
  EXPECT_THAT(error_of(spec_of(save("empty.vdb", {empty}))), HasSubstr("the level set 'void' has no inside"));
  auto stretched = sphere("ball", 1, Vector3::Zero(), 0.05);
  stretched->transform().postScale(openvdb::Vec3d(1, 2, 1));
  EXPECT_THAT(error_of(spec_of(save("stretched.vdb", {stretched}))), HasSubstr("are not cubes"));
}

}  // namespace
}  // namespace cleave::scene
