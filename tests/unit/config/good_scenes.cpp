#include "fake_catalog.hpp"

#include "plugins/registry.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

namespace cleave::config {
namespace {

using scene::ShapeSpec;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

const std::filesystem::path folder = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/good";

Scene load(const std::string& name, std::vector<std::string>* warnings = nullptr) {
  return load_scene(folder / name, {}, testing::FakeCatalog(), warnings);
}

TEST(MinimalScene, TakesTheDocumentedDefaults) {
  std::vector<std::string> warnings;
  const Scene scene = load("minimal.toml", &warnings);
  EXPECT_THAT(warnings, IsEmpty());
  EXPECT_EQ(scene.simulation.dimension, 3);
  EXPECT_EQ(scene.simulation.cell_size, 0.1);
  EXPECT_EQ(scene.simulation.frame_rate, 24);
  EXPECT_FALSE(scene.simulation.time_step);
  EXPECT_EQ(scene.simulation.precision, Precision::single_precision);
  EXPECT_EQ(scene.simulation.transfer, Transfer::apic);
  EXPECT_EQ(scene.simulation.gravity, Vector3::Zero());
  EXPECT_EQ(scene.simulation.integrator, Integrator::symplectic);
  ASSERT_EQ(scene.materials.size(), 1u);
  EXPECT_EQ(scene.materials[0].elasticity.id, "elasticity/neo-hookean");
  EXPECT_EQ(std::get<double>(scene.materials[0].elasticity.parameters.at("youngs_modulus")), 1e5);
  EXPECT_EQ(to_string(scene.materials[0].where), (folder / "minimal.toml").string() + ":5:1");
  ASSERT_EQ(scene.bodies.size(), 1u);
  EXPECT_EQ(scene.bodies[0].shape->type, ShapeSpec::Type::sphere);
  EXPECT_EQ(scene.bodies[0].shape->radius, 0.5);
  EXPECT_EQ(scene.bodies[0].sampling.particles_per_cell, 8);
  EXPECT_EQ(scene.bodies[0].sampling.pattern, scene::SamplingPattern::jittered);
  EXPECT_THAT(scene.output.formats, ElementsAre("vdb"));
}

TEST(FullScene, HoldsWhatTheFileSays) {
  const Scene scene = load("everything_3d.toml");
  EXPECT_EQ(*scene.simulation.time_step, 1e-4);
  EXPECT_EQ(scene.simulation.precision, Precision::double_precision);
  EXPECT_EQ(scene.simulation.transfer, Transfer::flip);
  EXPECT_EQ(scene.simulation.gravity, Vector3(0.1, -9.81, 0.2));
  EXPECT_EQ(scene.simulation.integrator, Integrator::implicit);
  EXPECT_EQ(scene.simulation.implicit,
            (ImplicitSolver{.tolerance = 1e-4, .maximum_iterations = 7, .maximum_linear_iterations = 60}));

  ASSERT_EQ(scene.materials.size(), 2u);
  const plugins::GivenParameters& yield = scene.materials[1].plasticity->parameters;
  EXPECT_EQ(std::get<std::int64_t>(yield.at("steps")), 7);
  EXPECT_EQ(std::get<std::string>(yield.at("closure")), "paper");
  EXPECT_EQ(std::get<bool>(yield.at("track_volume")), false);
  EXPECT_THAT(std::get<std::vector<double>>(yield.at("backstress")), ElementsAre(1, 2, 3, 4, 5, 6));
  EXPECT_EQ(yield.count("hardening"), 0u) << "what the scene leaves out stays the plugin's business";

  ASSERT_EQ(scene.bodies.size(), 3u);
  const ShapeSpec& difference = *scene.bodies[0].shape;
  EXPECT_EQ(difference.type, ShapeSpec::Type::difference);
  ASSERT_EQ(difference.children.size(), 2u);
  EXPECT_EQ(difference.children[0].type, ShapeSpec::Type::set_union);
  EXPECT_EQ(difference.children[0].children[2].scale, Vector3(2, 2, 2));
  EXPECT_EQ(difference.children[1].children[2].file, (folder / "../files/tetrahedron.obj").lexically_normal());
  EXPECT_TRUE(difference.children[1].children[2].centered);
  EXPECT_EQ(difference.children[1].children[3].grid, "surface");
  EXPECT_EQ(difference.scale, Vector3(1, 2, 0.5));
  const Vector3 axis = Vector3(1, 2, 3).normalized();
  EXPECT_TRUE((difference.rotation * axis).isApprox(axis, 1e-14));
  EXPECT_EQ(*scene.bodies[1].particle_file, (folder / "../files/two_points.csv").lexically_normal());
  EXPECT_EQ(scene.bodies[2].sampling.pattern, scene::SamplingPattern::blue_noise);

  EXPECT_EQ(scene.colliders[0].contact, Contact::sticky);
  EXPECT_EQ(scene.colliders[1].friction, 0.35);
  EXPECT_EQ(scene.colliders[1].motion.end, 1.5);
  EXPECT_EQ(scene.handles[0].body, "block");
  EXPECT_EQ(scene.handles[0].release, 1.75);
  ASSERT_EQ(scene.handles[0].motion.keyframes.size(), 2u);
  EXPECT_THAT(scene.output.attributes, ElementsAre("J", "alpha", "damage"));
  EXPECT_THAT(load("fields_3d.toml").output.attributes, ElementsAre("stress", "toughness"));
}

TEST(Angles, AreDegreesInTheFileAndRadiansInside) {
  const Scene scene = load("everything_3d.toml");
  EXPECT_NEAR(scene.colliders[1].motion.angular_velocity.y(), std::numbers::pi / 2, 1e-15);
  EXPECT_NEAR(scene.handles[0].motion.keyframes[1].rotation.x(), 77.7 * std::numbers::pi / 180, 1e-15);
  EXPECT_NEAR(scene.bodies[0].spin.angular_velocity.z(), 33.3 * std::numbers::pi / 180, 1e-15);
}

TEST(Fibers, AreUnitAndOrthogonal) {
  const Fibers fibers = *load("everything_3d.toml").materials[0].fibers;
  EXPECT_NEAR(fibers.direction.norm(), 1, 1e-15);
  EXPECT_NEAR(fibers.second->norm(), 1, 1e-15);
  EXPECT_NEAR(fibers.direction.dot(*fibers.second), 0, 1e-15);
}

TEST(Fibers, AreThoseOfTheBodyOrElseOfItsMaterial) {
  const Scene scene = load("fields_3d.toml");
  EXPECT_EQ(scene.materials[0].fibers->layout, Fibers::Layout::flow);
  EXPECT_FALSE(scene.materials[1].fibers) << "all its bodies have their own";
  EXPECT_EQ(scene.materials[0].fibers->outflow->scale, Vector3(2, 2, 2));
  EXPECT_FALSE(scene.bodies[0].fibers);
  const Fibers& helix = *scene.bodies[1].fibers;
  EXPECT_EQ(helix.layout, Fibers::Layout::helical);
  EXPECT_EQ(*helix.center, Vector3(1, 2, 3));
  EXPECT_TRUE(helix.axis->isApprox(Vector3(1, 2, 2) / 3, 1e-15));
  EXPECT_NEAR(helix.angle, -33.3 * std::numbers::pi / 180, 1e-15);
  EXPECT_EQ(scene.bodies[2].fibers->second_grid, "other");
  EXPECT_EQ(scene.bodies[7].fibers->direction, Vector3(0.6, 0, 0.8));
}

TEST(Fibers, NeedNoSecondDirectionInThePlane) {
  const Scene scene = load("fields_2d.toml");
  EXPECT_EQ(*scene.materials[0].fibers->axis, Vector3::UnitZ());
  EXPECT_TRUE(scene.bodies[3].fibers->second->isApprox(Vector3(-0.8, 0.6, 0), 1e-15));
}

TEST(Toughness, HoldsWhatTheFileSays) {
  const Scene scene = load("fields_3d.toml");
  const scene::VariationSpec& voronoi = *scene.bodies[0].toughness;
  EXPECT_EQ(voronoi.pattern, scene::VariationSpec::Pattern::voronoi);
  EXPECT_EQ(voronoi.size, 0.2);
  EXPECT_EQ(voronoi.minimum, 0.5);
  EXPECT_EQ(voronoi.maximum, 2);
  EXPECT_EQ(voronoi.seed, 9u);
  EXPECT_EQ(scene.bodies[1].toughness->pattern, scene::VariationSpec::Pattern::noise);
  EXPECT_FALSE(scene.bodies[2].toughness);
}

TEST(Tetrahedra, HoldWhatTheFileSays) {
  const Scene scene = load("tetrahedra.toml");
  ASSERT_EQ(scene.bodies.size(), 3u);
  using Method = scene::TetrahedraSpec::Method;
  EXPECT_EQ(scene.bodies[0].tetrahedra->edge_length, 0.125);
  EXPECT_EQ(scene.bodies[0].tetrahedra->method, Method::lattice);
  EXPECT_FALSE(scene.bodies[0].tetrahedra->file);
  EXPECT_EQ(scene.bodies[1].tetrahedra->method, Method::tetgen);
  EXPECT_FALSE(scene.bodies[2].shape);
  const ShapeSpec& file = *scene.bodies[2].tetrahedra->file;
  EXPECT_EQ(file.file, folder.parent_path() / "files/wedge.mesh");
  EXPECT_EQ(file.file_size, 0.5);
  EXPECT_TRUE(file.centered);
  EXPECT_EQ(file.center, Vector3(1, 2, 3));
  EXPECT_EQ(file.scale, Vector3(1, 2, 1));
  EXPECT_EQ(file.translation, Vector3(0, 0, -1));
  EXPECT_EQ(scene.materials[0].elasticity.id, "elasticity/neo-hookean");
}

TEST(FlatScene, TakesVectorsOfTwoAndAnglesAboutZ) {
  const Scene scene = load("everything_2d.toml");
  EXPECT_EQ(scene.simulation.gravity, Vector3(0, -9.81, 0));
  EXPECT_EQ(scene.simulation.integrator, Integrator::automatic);
  EXPECT_EQ(scene.simulation.implicit, ImplicitSolver());
  EXPECT_EQ(scene.bodies[0].sampling.particles_per_cell, 9);
  EXPECT_EQ(scene.bodies[1].sampling.particles_per_cell, 4);
  EXPECT_NEAR(scene.bodies[0].spin.angular_velocity.z(), 123.4 * std::numbers::pi / 180, 1e-15);
  EXPECT_TRUE((scene.bodies[0].shape->rotation * Vector3::UnitX()).isApprox(Vector3(std::sqrt(3) / 2, 0.5, 0), 1e-14));
  EXPECT_EQ(scene.bodies[0].shape->scale, Vector3(2, 1, 1));
  EXPECT_EQ(scene.colliders[0].name, "collider-1");
  EXPECT_NEAR(scene.colliders[0].motion.keyframes[0].rotation.z(), 12.3 * std::numbers::pi / 180, 1e-15);
}

TEST(FlatScene, SeesOnlyTheOutlineOfShapesWithDepth) {
  const Scene scene = load("everything_2d.toml");
  for (const Body& body : scene.bodies) {
    const auto inside = scene::build_shape(*body.shape, scene.simulation.cell_size);
    const Box box = inside->bounds();
    // Deepest point of the plate: half its lesser width, 0.25 m; of the ring: half of 0.3 m.
    double deepest = 0;
    for (double x = box.min().x(); x < box.max().x(); x += 0.01)
      for (double y = box.min().y(); y < box.max().y(); y += 0.01)
        deepest = std::min(deepest, inside->distance(Vector3(x, y, 0)));
    EXPECT_NEAR(deepest, body.name == "plate" ? -0.25 : -0.15, 0.02);
  }
}

TEST(Warnings, TellOfUnphysicalParametersAndUnreadFibers) {
  std::vector<std::string> warnings;
  load("odd_but_valid.toml", &warnings);
  const std::string file = (folder / "odd_but_valid.toml").string();
  EXPECT_THAT(warnings,
              ElementsAre(file + ":5:1: warning: no law of material 'jelly' reads its fibers",
                          file + ":8:57: warning: 'youngs_modulus' is 5e+12, outside what materials are known to have: "
                                 "in [1, 2e+12] Pa"));
}

TEST(Warnings, TellOfFibersOfABodyThatNoLawReads) {
  std::vector<std::string> warnings;
  const testing::FakeCatalog catalog;
  load_scene(folder / "minimal.toml", {parse_override("body.0.fibers={ direction = [1, 0, 0] }")}, catalog, &warnings);
  EXPECT_THAT(warnings,
              ElementsAre((folder / "minimal.toml").string() + ":10:1: warning: no law of material 'jelly' reads its fibers"));
}

TEST(Registry, ServesAsTheCatalogOfAScene) {
  const plugins::Registry nothing({folder});
  EXPECT_THROW(load_scene(folder / "minimal.toml", {}, nothing), std::runtime_error);
}

}  // namespace
}  // namespace cleave::config
