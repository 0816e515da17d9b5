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

}  // namespace
}  // namespace cleave::config
