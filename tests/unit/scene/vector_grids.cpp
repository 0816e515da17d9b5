#include "scene/fiber_field.hpp"
#include "scene_testing.hpp"

#include <openvdb/openvdb.h>

#include <cmath>
#include <numbers>

namespace cleave::scene {
namespace {

using testing::HasSubstr;

/// Voxels of 0.1 m over a cube of 2 m, each holding what `value` gives at its centre.
template <class Grid, class Value>
typename Grid::Ptr grid_of(const std::string& name, const Value& value) {
  auto grid = Grid::create();
  grid->setName(name);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
  auto voxels = grid->getAccessor();
  for (int i = -10; i <= 10; ++i)
    for (int j = -10; j <= 10; ++j)
      for (int k = -10; k <= 10; ++k) {
        const Vector3 v = value(Vector3(0.1 * i, 0.1 * j, 0.1 * k));
        using Component = typename Grid::ValueType::ValueType;
        voxels.setValue({i, j, k}, typename Grid::ValueType(Component(v[0]), Component(v[1]), Component(v[2])));
      }
  return grid;
}

Vector3 swirl(const Vector3& x) { return Vector3(1 + 0.2 * x.y(), 0.5 * x.x(), 0.3 * x.z() - 0.4); }
Vector3 crossing(const Vector3& x) { return Vector3(x.z(), 1, 0.1 * x.x()); }

class FiberGrids : public testing::Test {
 protected:
  static void SetUpTestSuite() { openvdb::initialize(); }

  FiberSpec spec_of(const openvdb::GridCPtrVec& grids, const std::string& name = {}, const std::string& second = {}) const {
    FiberSpec spec;
    spec.layout = FiberSpec::Layout::grid;
    spec.file = directory.path() / "fibers.vdb";
    openvdb::io::File(spec.file.string()).write(grids);
    spec.grid = name;
    spec.second_grid = second;
    return spec;
  }
  static std::vector<Vector3> points(int dimension = 3) {
    std::vector<Vector3> x;
    RandomPoints random(1);
    for (int i = 0; i < 500; ++i) x.push_back(random.next());
    if (dimension == 2)
      for (Vector3& p : x) p.z() = 0;
    return x;
  }
  static std::string error_of(const FiberSpec& spec, const std::vector<Vector3>& x) {
    return input_error([&] { lay_fibers(spec, x, 0.1, 3); });
  }

  TemporaryDirectory directory;
};

/// Trilinear interpolation reproduces linear functions.
TEST_F(FiberGrids, GiveTheNormalisedVectorAtEachPoint) {
  const auto x = points();
  for (const auto& spec :
       {spec_of({grid_of<openvdb::Vec3SGrid>("fiber", swirl)}), spec_of({grid_of<openvdb::Vec3DGrid>("fiber", swirl)})}) {
    const FiberField field = lay_fibers(spec, x, 0.1, 3);
    for (std::size_t i = 0; i < x.size(); ++i) {
      ASSERT_LT((field.first[i] - swirl(x[i]).normalized()).norm(), 1e-6);
      ASSERT_NEAR(field.first[i].norm(), 1, 1e-14);
      ASSERT_NEAR(field.first[i].dot(field.second[i]), 0, 1e-14);
    }
  }
}

TEST_F(FiberGrids, HoldBothDirections) {
  auto density = openvdb::FloatGrid::create(0);
  density->setName("density");
  const auto spec =
      spec_of({density, grid_of<openvdb::Vec3SGrid>("a", swirl), grid_of<openvdb::Vec3SGrid>("b", crossing)}, "", "b");
  const auto x = points();
  const FiberField field = lay_fibers(spec, x, 0.1, 3);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Vector3 a = swirl(x[i]).normalized(), b = crossing(x[i]);
    ASSERT_LT((field.first[i] - a).norm(), 1e-6) << "the first grid of vectors";
    ASSERT_LT((field.second[i] - (b - b.dot(a) * a).normalized()).norm(), 1e-5);
  }
}

TEST_F(FiberGrids, MayPointToEitherSide) {
  int flips = 0;
  const auto scattered = [&](const Vector3& x) { return Vector3((++flips % 2 ? -1 : 1) * swirl(x)); };
  const auto spec = spec_of({grid_of<openvdb::Vec3SGrid>("fiber", scattered)});
  const auto x = points();
  const FiberField field = lay_fibers(spec, x, 0.1, 3);
  for (std::size_t i = 0; i < x.size(); ++i) ASSERT_NEAR(std::abs(field.first[i].dot(swirl(x[i]).normalized())), 1, 1e-6);
}

TEST_F(FiberGrids, AreTakenIntoThePlaneInTwoDimensions) {
  const auto spec = spec_of({grid_of<openvdb::Vec3SGrid>("fiber", swirl)});
  const auto x = points(2);
  const FiberField field = lay_fibers(spec, x, 0.1, 2);
  for (std::size_t i = 0; i < x.size(); ++i) {
    Vector3 expected = swirl(x[i]);
    expected.z() = 0;
    ASSERT_LT((field.first[i] - expected.normalized()).norm(), 1e-6);
    ASSERT_EQ(field.second[i].z(), 0);
  }
}

TEST_F(FiberGrids, ThatCannotBeUsedSayWhy) {
  auto density = openvdb::FloatGrid::create(0);
  density->setName("density");
  const auto fiber = grid_of<openvdb::Vec3SGrid>("fiber", swirl);
  const std::vector<Vector3> x = {Vector3(0, 0, 0), Vector3(3, 0, 0), Vector3(0.5, 0, 0), Vector3(4, 0, 0)};
  EXPECT_THAT(error_of(spec_of({density}), x),
              HasSubstr("fibers.vdb: no grid of vectors in the file; it has 'density' (float)"));
  EXPECT_THAT(error_of(spec_of({density, fiber}, "fibre"), x),
              HasSubstr("no grid of vectors named 'fibre'; it has 'density' (float), 'fiber' (vec3s)"));
  EXPECT_THAT(error_of(spec_of({fiber}), x),
              HasSubstr("the grid 'fiber' has no direction at 2 of 4 particles, such as the one at (3, 0, 0) m"));
  FiberSpec text = spec_of({fiber});
  text.file = directory.write("text.vdb", "not a grid");
  EXPECT_THAT(error_of(text, x), HasSubstr("text.vdb: not a readable OpenVDB file"));
}

}  // namespace
}  // namespace cleave::scene
