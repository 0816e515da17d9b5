#include "app/validate_command.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace cleave::app {
namespace {

using ::testing::HasSubstr;
using ::testing::internal::CaptureStderr;
using ::testing::internal::CaptureStdout;
using ::testing::internal::GetCapturedStderr;
using ::testing::internal::GetCapturedStdout;

struct Result {
  int status;
  std::string out, err;
};

class Validate : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("cleave-validate-" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
    write("scene.toml", R"([simulation]
cell_size = 0.1
end_time = 1

[[material]]
name = "jelly"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }

[[body]]
name = "block"
material = "jelly"
shape = { type = "box", size = [1, 2, 3] }
)");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }

  Result validate(const std::vector<std::string>& sets) const {
    plugins::Registry registry({std::filesystem::path(CLEAVE_BINARY_DIR) / "lib/cleave/plugins"});
    CaptureStdout();
    CaptureStderr();
    const int status = validate_command(folder_ / "scene.toml", sets, std::move(registry));
    std::fflush(stdout);
    return {status, GetCapturedStdout(), GetCapturedStderr()};
  }

  std::string place_of_body() const { return (folder_ / "scene.toml").string() + ":10:1: error: "; }

  std::filesystem::path folder_;
};

TEST_F(Validate, SumsAGoodSceneUp) {
  const Result result = validate({});
  EXPECT_EQ(result.status, 0);
  EXPECT_EQ(result.err, "");
  EXPECT_EQ(result.out,
            "ok: 3D, single precision, cells of 0.1 m, 1 s at 24 frames/s, about 48000 particles in 6000 cells\n"
            "  material jelly: 1000 kg/m^3, elasticity/split-neo-hookean\n"
            "  body block: jelly, about 48000 particles\n");
}

TEST_F(Validate, EstimatesParticlesOfCurvedShapesFromTheirVolume) {
  const Result result = validate({"body.0.shape={ type = \"sphere\", radius = 1 }", "simulation.cell_size=0.05"});
  EXPECT_EQ(result.status, 0);
  // 4/3 pi m^3 in cells of 0.05 m with 8 particles each: 268083.
  EXPECT_THAT(result.out, HasSubstr("about 270000 particles in 34000 cells"));
}

TEST_F(Validate, CountsParticlesOfAFile) {
  write("grains.csv", "x,y,z\n0,0,0\n1,0,0\n0,1,0\n");
  const Result result = validate({"body.0={ name = \"grains\", material = \"jelly\", particles = \"grains.csv\" }"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("body grains: jelly, about 3 particles"));
}

const std::string peridynamic =
    "material.0={ name = \"jelly\", density = 1000, discretization = { plugin = \"peridynamics\", youngs_modulus = 1e5, "
    "poissons_ratio = 0.3 } }";

// Half tetrahedra at the surface, of a quarter cube's height: 45 degrees at their edge there, 90 beside it.
TEST_F(Validate, MeasuresTetrahedra) {
  const Result result = validate({peridynamic, "body.0.tetrahedra={ edge_length = 0.5 }"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.out,
              HasSubstr("  body block: jelly, 752 tetrahedra, 241 vertices, 6 m^3, edges of 0.25 to 0.5 m, dihedral "
                        "angles of 45 to 90 degrees\n"));
}

TEST_F(Validate, CountsThePiecesOfTetrahedra) {
  const Result result = validate({peridynamic, "body.0.tetrahedra={ edge_length = 0.5 }",
                                  "body.0.shape={ type = \"union\", shapes = [{ type = \"sphere\", radius = 1 }, "
                                  "{ type = \"sphere\", radius = 1, center = [5, 0, 0] }] }"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr(" degrees, in 2 pieces\n"));
}

TEST_F(Validate, ReadsFilesOfTetrahedra) {
  write("block.mesh", "MeshVersionFormatted 1\nDimension 3\nVertices 3\n0 0 0 0\n1 0 0 0\n0 1 0 0\nTetrahedra 1\n1 2 3 4 0\n");
  const Result result =
      validate({peridynamic, "body.0={ name = \"block\", material = \"jelly\", tetrahedra = { file = \"block.mesh\" } }"});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("block.mesh:8: a vertex of a tetrahedron must be from 1 to 3, is '4'\n"));
}

TEST_F(Validate, PrintsTheErrorsOfTheScene) {
  const Result result = validate({"simulation.cell_size=-1", "body.0.shape.radius=1"});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_THAT(result.err, HasSubstr("--set simulation.cell_size: error: 'cell_size' must be greater than 0 m, is -1\n"));
  EXPECT_THAT(result.err, HasSubstr("--set body.0.shape.radius: error: unknown key 'radius' in box"));
}

TEST_F(Validate, WarnsAndStillSucceeds) {
  const Result result = validate({"material.jelly.fibers.direction=[1, 0, 0]"});
  EXPECT_EQ(result.status, 0);
  EXPECT_THAT(result.err, HasSubstr("warning: no law of material 'jelly' reads its fibers\n"));
}

TEST_F(Validate, RefusesAnEndlessBody) {
  const Result result = validate({"body.0.shape={ type = \"half-space\", normal = [0, 1, 0] }"});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.err, place_of_body() + "the shape of body 'block' has no end; intersect it with a bounded one\n");
}

TEST_F(Validate, RefusesAnEmptyBody) {
  const Result result =
      validate({"body.0.shape={ type = \"intersection\", shapes = [{ type = \"sphere\", radius = 1 }, "
                "{ type = \"sphere\", radius = 1, center = [5, 0, 0] }] }"});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.err, place_of_body() + "the shape of body 'block' holds no particle\n");
}

TEST_F(Validate, OpensTheFilesOfShapes) {
  write("empty.obj", "# nothing\n");
  const Result result = validate({"body.0.shape={ type = \"mesh\", file = \"empty.obj\" }"});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, ::testing::StartsWith(place_of_body() + (folder_ / "empty.obj").string()));
}

}  // namespace
}  // namespace cleave::app
