#include "config/angles.hpp"
#include "fake_catalog.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <random>

namespace cleave::config {
namespace {

const std::filesystem::path folder = std::filesystem::path(CLEAVE_SOURCE_DIR) / "tests/fixtures/configs/good";

Scene read_back(const std::string& text) {
  const auto file = std::filesystem::temp_directory_path() / ("cleave-round-trip-" + std::to_string(getpid()) + ".toml");
  std::ofstream(file) << text;
  std::vector<std::string> warnings;
  Scene scene = load_scene(file, {}, testing::FakeCatalog(), &warnings);
  std::filesystem::remove(file);
  return scene;
}

void expect_equal(const scene::ShapeSpec& a, const scene::ShapeSpec& b) {
  EXPECT_EQ(a.type, b.type);
  EXPECT_EQ(a.center, b.center);
  EXPECT_EQ(a.size, b.size);
  EXPECT_EQ(a.axis, b.axis);
  EXPECT_EQ(a.radius, b.radius);
  EXPECT_EQ(a.inner_radius, b.inner_radius);
  EXPECT_EQ(a.tube_radius, b.tube_radius);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.file, b.file);
  EXPECT_EQ(a.grid, b.grid);
  EXPECT_EQ(a.file_size, b.file_size);
  EXPECT_EQ(a.centered, b.centered);
  EXPECT_EQ(a.scale, b.scale);
  EXPECT_EQ(a.rotation, b.rotation);
  EXPECT_EQ(a.translation, b.translation);
  ASSERT_EQ(a.children.size(), b.children.size());
  for (std::size_t i = 0; i < a.children.size(); ++i) expect_equal(a.children[i], b.children[i]);
}

void expect_equal(const scene::RigidMotion& a, const scene::RigidMotion& b) {
  EXPECT_EQ(a.velocity, b.velocity);
  EXPECT_EQ(a.angular_velocity, b.angular_velocity);
  EXPECT_EQ(a.center, b.center);
  EXPECT_EQ(a.start, b.start);
  EXPECT_EQ(a.end, b.end);
  ASSERT_EQ(a.keyframes.size(), b.keyframes.size());
  for (std::size_t i = 0; i < a.keyframes.size(); ++i) {
    EXPECT_EQ(a.keyframes[i].time, b.keyframes[i].time);
    EXPECT_EQ(a.keyframes[i].translation, b.keyframes[i].translation);
    EXPECT_EQ(a.keyframes[i].rotation, b.keyframes[i].rotation);
  }
}

/// The second use may also name parameters at their defaults.
void expect_equal(const PluginUse& a, const PluginUse& b) {
  EXPECT_EQ(a.id, b.id);
  const testing::FakeCatalog catalog;
  const plugins::Description& law = *catalog.find(a.id);
  for (const plugins::Parameter& parameter : law.parameters) {
    const auto in_a = a.parameters.find(parameter.key), in_b = b.parameters.find(parameter.key);
    if (in_a != a.parameters.end()) {
      ASSERT_NE(in_b, b.parameters.end()) << parameter.key;
      EXPECT_EQ(in_a->second, in_b->second) << parameter.key;
    } else if (parameter.in_set || parameter.required) {
      EXPECT_EQ(in_b, b.parameters.end()) << parameter.key;
    } else {
      ASSERT_NE(in_b, b.parameters.end()) << "the default of " << parameter.key << " is not written out";
      EXPECT_EQ(in_b->second, parameter.default_value) << parameter.key;
    }
  }
}

void expect_equal(const std::optional<PluginUse>& a, const std::optional<PluginUse>& b) {
  ASSERT_EQ(a.has_value(), b.has_value());
  if (a) expect_equal(*a, *b);
}

void expect_equal(const std::optional<scene::ShapeSpec>& a, const std::optional<scene::ShapeSpec>& b) {
  ASSERT_EQ(a.has_value(), b.has_value());
  if (a) expect_equal(*a, *b);
}

void expect_equal(const std::optional<Fibers>& a, const std::optional<Fibers>& b) {
  ASSERT_EQ(a.has_value(), b.has_value());
  if (!a) return;
  EXPECT_EQ(a->direction, b->direction);
  EXPECT_EQ(a->second, b->second);
  EXPECT_EQ(a->layout, b->layout);
  EXPECT_EQ(a->center, b->center);
  EXPECT_EQ(a->axis, b->axis);
  EXPECT_EQ(a->angle, b->angle);
  EXPECT_EQ(a->file, b->file);
  EXPECT_EQ(a->grid, b->grid);
  EXPECT_EQ(a->second_grid, b->second_grid);
  expect_equal(a->inflow, b->inflow);
  expect_equal(a->outflow, b->outflow);
}

void expect_equal(const Scene& a, const Scene& b) {
  EXPECT_EQ(a.simulation.dimension, b.simulation.dimension);
  EXPECT_EQ(a.simulation.cell_size, b.simulation.cell_size);
  EXPECT_EQ(a.simulation.end_time, b.simulation.end_time);
  EXPECT_EQ(a.simulation.frame_rate, b.simulation.frame_rate);
  EXPECT_EQ(a.simulation.time_step, b.simulation.time_step);
  EXPECT_EQ(a.simulation.maximum_time_step, b.simulation.maximum_time_step);
  EXPECT_EQ(a.simulation.cfl, b.simulation.cfl);
  EXPECT_EQ(a.simulation.precision, b.simulation.precision);
  EXPECT_EQ(a.simulation.gravity, b.simulation.gravity);
  EXPECT_EQ(a.simulation.transfer, b.simulation.transfer);
  EXPECT_EQ(a.simulation.flip_ratio, b.simulation.flip_ratio);
  EXPECT_EQ(a.simulation.integrator, b.simulation.integrator);
  EXPECT_EQ(a.simulation.implicit, b.simulation.implicit);
  EXPECT_EQ(a.simulation.damage, b.simulation.damage);

  ASSERT_EQ(a.materials.size(), b.materials.size());
  for (std::size_t i = 0; i < a.materials.size(); ++i) {
    const Material &m = a.materials[i], &n = b.materials[i];
    EXPECT_EQ(m.name, n.name);
    EXPECT_EQ(m.density, n.density);
    expect_equal(m.elasticity, n.elasticity);
    expect_equal(m.plasticity, n.plasticity);
    expect_equal(m.damage, n.damage);
    expect_equal(m.constraint, n.constraint);
    expect_equal(m.discretization, n.discretization);
    expect_equal(m.fibers, n.fibers);
  }
  ASSERT_EQ(a.bodies.size(), b.bodies.size());
  for (std::size_t i = 0; i < a.bodies.size(); ++i) {
    const Body &m = a.bodies[i], &n = b.bodies[i];
    EXPECT_EQ(m.name, n.name);
    EXPECT_EQ(m.material, n.material);
    expect_equal(m.shape, n.shape);
    EXPECT_EQ(m.particle_file, n.particle_file);
    ASSERT_EQ(m.tetrahedra.has_value(), n.tetrahedra.has_value());
    if (m.tetrahedra) {
      expect_equal(m.tetrahedra->file, n.tetrahedra->file);
      EXPECT_EQ(m.tetrahedra->method, n.tetrahedra->method);
      EXPECT_EQ(m.tetrahedra->edge_length, n.tetrahedra->edge_length);
    }
    EXPECT_EQ(m.sampling.pattern, n.sampling.pattern);
    EXPECT_EQ(m.sampling.particles_per_cell, n.sampling.particles_per_cell);
    EXPECT_EQ(m.sampling.jitter, n.sampling.jitter);
    EXPECT_EQ(m.sampling.seed, n.sampling.seed);
    EXPECT_EQ(m.velocity, n.velocity);
    EXPECT_EQ(m.spin.angular_velocity, n.spin.angular_velocity);
    EXPECT_EQ(m.spin.center, n.spin.center);
    expect_equal(m.fibers, n.fibers);
    ASSERT_EQ(m.toughness.has_value(), n.toughness.has_value());
    if (!m.toughness) continue;
    EXPECT_EQ(m.toughness->pattern, n.toughness->pattern);
    EXPECT_EQ(m.toughness->size, n.toughness->size);
    EXPECT_EQ(m.toughness->minimum, n.toughness->minimum);
    EXPECT_EQ(m.toughness->maximum, n.toughness->maximum);
    EXPECT_EQ(m.toughness->seed, n.toughness->seed);
  }
  ASSERT_EQ(a.colliders.size(), b.colliders.size());
  for (std::size_t i = 0; i < a.colliders.size(); ++i) {
    EXPECT_EQ(a.colliders[i].name, b.colliders[i].name);
    expect_equal(a.colliders[i].shape, b.colliders[i].shape);
    EXPECT_EQ(a.colliders[i].contact, b.colliders[i].contact);
    EXPECT_EQ(a.colliders[i].friction, b.colliders[i].friction);
    expect_equal(a.colliders[i].motion, b.colliders[i].motion);
  }
  ASSERT_EQ(a.handles.size(), b.handles.size());
  for (std::size_t i = 0; i < a.handles.size(); ++i) {
    EXPECT_EQ(a.handles[i].name, b.handles[i].name);
    EXPECT_EQ(a.handles[i].body, b.handles[i].body);
    expect_equal(a.handles[i].region, b.handles[i].region);
    expect_equal(a.handles[i].motion, b.handles[i].motion);
    EXPECT_EQ(a.handles[i].release, b.handles[i].release);
  }
  EXPECT_EQ(a.output.formats, b.output.formats);
  EXPECT_EQ(a.output.surface, b.output.surface);
  EXPECT_EQ(a.output.attributes, b.output.attributes);
}

class RoundTrip : public ::testing::TestWithParam<const char*> {};

TEST_P(RoundTrip, WrittenSceneReadsBackToTheBit) {
  const testing::FakeCatalog catalog;
  const Scene scene = load_scene(folder / GetParam(), {}, catalog);
  const std::string text = to_toml(scene, catalog);
  const Scene again = read_back(text);
  expect_equal(scene, again);
  EXPECT_EQ(to_toml(again, catalog), text);
}

INSTANTIATE_TEST_SUITE_P(Scenes, RoundTrip,
                         ::testing::Values("minimal.toml", "everything_3d.toml", "everything_2d.toml", "odd_but_valid.toml",
                                           "fields_3d.toml", "fields_2d.toml", "tetrahedra.toml"));

TEST(RoundTrip, KeepsAwkwardNumbersAndPaths) {
  const testing::FakeCatalog catalog;
  Scene scene = load_scene(folder / "minimal.toml", {}, catalog);
  scene.simulation.end_time = 123456789012345680000.0;
  scene.simulation.cell_size = 5e-324;
  scene.simulation.gravity = Vector3(0.1 + 0.2, -1e300, -0.0);
  scene.bodies[0].sampling.seed = 9223372036854775807u;
  expect_equal(scene, read_back(to_toml(scene, catalog)));
}

TEST(Angles, GoToDegreesAndBackToTheBit) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> exponent(-8, 8);
  for (int i = 0; i < 100000; ++i) {
    const double angle = radians((i % 2 ? 1 : -1) * std::pow(10, exponent(random)));
    ASSERT_EQ(radians(degrees(angle)), angle);
  }
}

}  // namespace
}  // namespace cleave::config
