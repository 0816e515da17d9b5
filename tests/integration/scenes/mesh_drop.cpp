// The Stanford bunny, about 200000 particles, falls on the floor and bounces: what comes out has to be plausible physics and
// files that others can open.

#include "../../reference_data.hpp"
#include "program.hpp"

#include <openvdb/openvdb.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>

#include <boost/property_tree/xml_parser.hpp>
#include <cmath>

namespace cleave::test {
namespace {

fs::path mesh(const std::string& name) { return reference_data() / "meshes" / name; }

class MeshDrop : public Program {
 protected:
  std::string scene = (fs::path(CLEAVE_SOURCE_DIR) / "configs/scenes/mesh_drop.toml").string();
};

TEST_F(MeshDrop, BunnyFallsAndBounces) {
  const fs::path bunny = mesh("stanford-bunny.obj");
  if (!fs::exists(bunny)) GTEST_SKIP() << bunny << " is not there";
  const Outcome run =
      cleave("run '" + scene + "' --out run --set body.0.shape.file='\"" + bunny.string() +
             "\"' --set simulation.cell_size=0.0155 --set simulation.end_time=0.7 --set simulation.frame_rate=10 "
             "--set 'collider.block.shape.center=[9,0,0]' --quiet");
  ASSERT_EQ(run.status, 0) << run.err;
  const auto summary = json(directory / "run/summary.json");
  EXPECT_GT(summary.get<int>("particles"), 150000);
  EXPECT_LT(summary.get<int>("particles"), 250000);

  const auto frames = table(directory / "run/frames.csv");
  const auto kinetic = numbers(frames.at("kinetic_energy")), elastic = numbers(frames.at("elastic_energy")),
             gravity = numbers(frames.at("gravity_energy")), mass = numbers(frames.at("mass")),
             volume = numbers(frames.at("volume")), pz = numbers(frames.at("momentum_z")),
             px = numbers(frames.at("momentum_x")), height = numbers(frames.at("center_of_mass_z")),
             low = numbers(frames.at("minimum_J")), high = numbers(frames.at("maximum_J"));
  const double total = kinetic[0] + elastic[0] + gravity[0];
  double lowest_speed = 0, highest_speed = 0;
  for (std::size_t i = 0; i < kinetic.size(); i++) {
    EXPECT_NEAR(mass[i], mass[0], 1e-6 * mass[0]);
    EXPECT_NEAR(volume[i], volume[0], 0.1 * volume[0]) << "frame " << i;
    EXPECT_LT(kinetic[i] + elastic[i] + gravity[i], total * 1.01) << "frame " << i << ": energy must not be made";
    EXPECT_GT(low[i], 0.2);
    EXPECT_LT(high[i], 3);
    EXPECT_LT(std::abs(px[i]), 0.5 * mass[0]) << "no push sideways beyond friction";
    lowest_speed = std::min(lowest_speed, pz[i] / mass[0]);
    highest_speed = std::max(highest_speed, pz[i] / mass[0]);
  }
  // free fall until the feet touch
  EXPECT_NEAR(height[1], height[0] - 0.5 * 9.81 * 0.01, 1e-3);
  EXPECT_NEAR(pz[1] / mass[1], -9.81 * 0.1, 1e-3);
  EXPECT_LT(lowest_speed, -1.5) << "it falls";
  EXPECT_GT(highest_speed, 0.3) << "it bounces";

  // read back
  openvdb::initialize();
  openvdb::io::File file((directory / "run/points/frame_0007.vdb").string());
  file.open(false);
  const auto grids = file.getGrids();
  ASSERT_EQ(grids->size(), 1u);
  const auto points = openvdb::gridPtrCast<openvdb::points::PointDataGrid>((*grids)[0]);
  ASSERT_TRUE(points);
  EXPECT_EQ(openvdb::points::pointCount(points->tree()), summary.get<openvdb::Index64>("particles"));
  openvdb::io::File surface((directory / "run/surface/frame_0007.vdb").string());
  surface.open(false);
  const auto level_set = openvdb::gridPtrCast<openvdb::FloatGrid>((*surface.getGrids())[0]);
  ASSERT_TRUE(level_set);
  EXPECT_EQ(level_set->getGridClass(), openvdb::GRID_LEVEL_SET);
  boost::property_tree::ptree vtp;
  boost::property_tree::read_xml((directory / "run/vtp/frame_0007.vtp").string(), vtp);
  EXPECT_EQ(vtp.get<int>("VTKFile.PolyData.Piece.<xmlattr>.NumberOfPoints"), summary.get<int>("particles"));
}

TEST_F(MeshDrop, ArmadilloIsSampledAndSteps) {
  const fs::path armadillo = mesh("armadillo.obj");
  if (!fs::exists(armadillo)) GTEST_SKIP() << armadillo << " is not there";
  const Outcome run =
      cleave("run '" + scene + "' --out run --set body.0.shape.file='\"" + armadillo.string() + "\"' --steps 20 --quiet");
  ASSERT_EQ(run.status, 0) << run.err;
  EXPECT_GT(json(directory / "run/summary.json").get<int>("particles"), 5000);
}

}  // namespace
}  // namespace cleave::test
