// `cleave bench halo`: what parts of a scene share and what leaves them, of boxes in free flight whose cells are counted by
// hand.

#include "program.hpp"

#include <cmath>
#include <sstream>

namespace cleave::test {
namespace {

/// One block of the grid across, two along the flight (4 cells of 3D, 8 of 2D each), a cell of 0.1 m before where it is
/// divided.
constexpr const char* three = R"toml(
[simulation]
cell_size = 0.1
end_time = 0.02
time_step = 1e-3
gravity = [0, 0, 0]
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e4, poissons_ratio = 0.3 }
[[body]]
name = "box"
material = "rubber"
sampling = "regular"
velocity = [0, 0, 10]
shape = { type = "box", center = [0.25, 0.25, 0.35], size = [0.4, 0.4, 0.8] }
)toml";

constexpr const char* two = R"toml(
[simulation]
dimension = 2
cell_size = 0.1
end_time = 0.02
time_step = 1e-3
gravity = [0, 0]
precision = "double"
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e4, poissons_ratio = 0.3 }
[[body]]
name = "box"
material = "rubber"
sampling = "regular"
velocity = [0, 10]
shape = { type = "box", center = [0.45, 0.75], size = [0.8, 1.6] }
)toml";

struct BenchHalo : Program {
  /// The row of a number of parts.
  std::vector<double> row(const std::string& options) const {
    const Outcome run = cleave("bench halo scene.toml --samples 1 --steps 5 " + options);
    EXPECT_EQ(run.status, 0) << run.err;
    std::istringstream text(run.out.substr(run.out.rfind('\n', run.out.size() - 2)));
    std::vector<double> values;
    for (double value; text >> value;) values.push_back(value);
    return values;
  }
};

TEST_F(BenchHalo, PartsShareTheNodesThatParticlesOfBothReach) {
  write("scene.toml", three);
  // 6x6x6 nodes of each half, two layers of 6x6 of both; mass and momentum impulses are four numbers of single precision
  // five steps of a tenth of a cell bring one layer of 8x8 of the 8x8x16 particles across
  const auto halves = row("--parts 2");
  const std::vector<double> expected{2, 512, 216, 72, 72, 1, 1.15, 64. / 1024 / 5};
  ASSERT_GT(halves.size(), 9u);
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(halves[i], expected[i], 0.05 * expected[i]) << "column " << i;
  EXPECT_NEAR(halves[9], (512 + 64) / 512., 1e-3);
  const std::string said = cleave("bench halo scene.toml --samples 1 --steps 5 --parts 2").out;
  const double size = std::stod(said.substr(said.find("particles of ") + 13));
  EXPECT_NEAR(halves[8], 1e-3 * 64 / 2. / 5 * size, 0.05 * halves[8]) << "kB that leave a part in a step";
}

TEST_F(BenchHalo, PartsOfAPlaneSceneToo) {
  write("scene.toml", two);
  const auto halves = row("--parts 2");
  const std::vector<double> expected{2, 256, 100, 20, 20, 1, 20 * 3 * 8e-3, 16. / 512 / 5};
  ASSERT_GT(halves.size(), 9u);
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(halves[i], expected[i], 0.05 * expected[i]) << "column " << i;
}

TEST_F(BenchHalo, RefusesWhatCannotBeDivided) {
  write("scene.toml", two);
  const Outcome many = cleave("bench halo scene.toml --parts 600");
  EXPECT_EQ(many.status, 2);
  EXPECT_NE(many.err.find("--parts 600: error: there are 512 particles"), std::string::npos) << many.err;
  EXPECT_EQ(cleave("bench halo scene.toml --parts 1").status, 2);
  std::string elements = three;
  elements.insert(elements.find("elasticity = "), "discretization = { plugin = \"fem\" }\n");
  elements.erase(elements.find("sampling"), std::string("sampling = \"regular\"\n").size());
  elements.insert(elements.find("shape = "), "tetrahedra = { edge_length = 0.2 }\n");
  write("scene.toml", elements);
  const Outcome mesh = cleave("bench halo scene.toml");
  EXPECT_EQ(mesh.status, 2);
  EXPECT_NE(mesh.err.find("material rubber is stepped by a discretization, which has no grid to divide"), std::string::npos)
      << mesh.err;
}

}  // namespace
}  // namespace cleave::test
