#include "mpm/bodies.hpp"
#include "common/error.hpp"
#include "fake_catalog.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace cleave::config {
namespace {

std::vector<mpm::SampledBody> bodies_of(const std::vector<std::string>& overrides) {
  const auto file = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/good/minimal.toml";
  std::vector<Override> given;
  for (const auto& text : overrides) given.push_back(parse_override(text));
  return mpm::sample_bodies(load_scene(file, given, testing::FakeCatalog()));
}

TEST(SampledBody, HasTheFibersOfTheBodyElseOfTheMaterial) {
  EXPECT_TRUE(bodies_of({})[0].fibers.first.empty());
  const auto material = bodies_of({"material.0.fibers={ direction = [0, 0, 1] }"})[0];
  ASSERT_EQ(material.fibers.first.size(), material.particles.positions.size());
  ASSERT_EQ(material.fibers.second.size(), material.particles.positions.size());
  for (const Vector3& a : material.fibers.first) ASSERT_EQ(a, Vector3::UnitZ());
  const auto body = bodies_of({"material.0.fibers={ direction = [0, 0, 1] }", "body.0.fibers={ layout = \"radial\" }"})[0];
  for (std::size_t i = 0; i < body.fibers.first.size(); ++i)
    ASSERT_TRUE(body.fibers.first[i].isApprox(body.particles.positions[i].normalized(), 1e-12));
}

TEST(SampledBody, HasAToughnessForEachParticleIfItVaries) {
  EXPECT_TRUE(bodies_of({})[0].toughness.empty());
  const auto body = bodies_of({"material.0.damage={ plugin = \"rankine\" }",
                               "body.0.toughness={ pattern = \"voronoi\", size = 0.2, minimum = 3, maximum = 4 }"})[0];
  ASSERT_EQ(body.toughness.size(), body.particles.positions.size());
  const auto [least, greatest] = std::minmax_element(body.toughness.begin(), body.toughness.end());
  EXPECT_GE(*least, 3);
  EXPECT_LE(*greatest, 4);
  EXPECT_GT(*greatest - *least, 0.5);
}

TEST(SampledBody, NamesTheBodyWhoseFibersCannotBeLaid) {
  try {
    bodies_of(
        {"body.0.fibers={ layout = \"flow\", inflow = { type = \"sphere\", radius = 0.2, center = [3, 0, 0] }, outflow = "
         "{ type = \"sphere\", radius = 0.2 } }"});
    FAIL() << "there is no flow";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("minimal.toml:10:1: error: body 'ball': the 'inflow' of the fibers holds"),
              std::string::npos)
        << error.what();
  }
}

TEST(SampledBody, OfTetrahedraHasTheirBarycentresForPoints) {
  const auto file = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/good/tetrahedra.toml";
  const Scene scene = load_scene(file, {parse_override("body.1.tetrahedra.method=lattice")}, testing::FakeCatalog());
  const auto bodies = mpm::sample_bodies(scene);
  struct Volume {
    double value, error;
  };
  const double ball = 4 * EIGEN_PI / 3 / 8;
  const Volume volumes[] = {{0.125, 1e-12}, {ball, 0.1 * ball}, {1.0 / 64 * 2, 1e-12}};  // the wedge's file has 1 m^3
  for (std::size_t b = 0; b < bodies.size(); b++) {
    const auto& body = bodies[b];
    ASSERT_TRUE(body.mesh);
    const auto& [vertices, tetrahedra] = *body.mesh;
    ASSERT_EQ(body.particles.positions.size(), tetrahedra.size());
    ASSERT_EQ(body.vertex_velocities.size(), vertices.size());
    double volume = 0;
    for (std::size_t t = 0; t < tetrahedra.size(); t++) {
      const auto& [i, j, k, l] = tetrahedra[t];
      const Vector3 centre = (vertices[i] + vertices[j] + vertices[k] + vertices[l]) / 4;
      ASSERT_TRUE(body.particles.positions[t].isApprox(centre, 1e-14));
      volume += body.particles.volumes[t];
    }
    EXPECT_NEAR(volume, volumes[b].value, volumes[b].error);
  }
  const auto& slab = bodies[0];
  for (std::size_t v = 0; v < slab.mesh->vertices.size(); v++) {
    const Vector3 arm = slab.mesh->vertices[v] - Vector3(0, 2, 0);
    const Vector3 expected = Vector3(1, 0, 0) + EIGEN_PI / 2 * Vector3(-arm.y(), arm.x(), 0);
    ASSERT_TRUE(slab.vertex_velocities[v].isApprox(expected, 1e-12));
  }
}

}  // namespace
}  // namespace cleave::config
