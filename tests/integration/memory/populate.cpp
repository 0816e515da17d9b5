// What a simulation starts from is what its bodies give, particle by particle.

#include "config/scene.hpp"
#include "mpm/bodies.hpp"
#include "mpm/simulation.hpp"
#include "plugins/registry.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace cleave::mpm {
namespace {

namespace fs = std::filesystem;

/// Bodies of two materials in turn, one sampled and spinning, one from a file, one held by a handle.
TEST(Populate, KeepsEveryParticleOfEveryBody) {
  std::string name = (fs::temp_directory_path() / "cleave-populate-XXXXXX").string();
  const fs::path directory = mkdtemp(name.data());
  std::ofstream(directory / "points.csv") << "x,y,z,vx,vy,vz,volume,F00,F01,F02,F10,F11,F12,F20,F21,F22\n"
                                             "2,2,2,1,2,3,1e-3,1.1,0.1,0,0,0.9,0.2,0,0,1\n"
                                             "0.01,0.02,0.03,4,5,6,2e-3,1,0,0.3,0,1,0,0.1,0,1.2\n"
                                             "-3,0.5,0,7,8,9,3e-3,1,0,0,0,1,0,0,0,1\n";
  const std::string law = "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e4, poissons_ratio = 0.3 }\n";
  std::ofstream(directory / "scene.toml")
      << "[simulation]\ncell_size = 0.1\nend_time = 1\nframe_rate = 20\nprecision = \"double\"\n"
         "[[material]]\nname = \"a\"\ndensity = 1000\n" +
             law + "[[material]]\nname = \"b\"\ndensity = 500\n" + law +
             "[[body]]\nname = \"spinning\"\nmaterial = \"b\"\nvelocity = [1, 0, 0]\nspin = { angular_velocity = [0, 0, 90] }\n"
             "shape = { type = \"sphere\", radius = 0.6 }\n"
             "[[body]]\nname = \"given\"\nmaterial = \"a\"\nparticles = \"points.csv\"\n"
             "[[body]]\nname = \"held\"\nmaterial = \"b\"\nshape = { type = \"box\", size = [0.5, 0.5, 0.5], center = [0.3, 0, "
             "0] }\n"
             "[[handle]]\nname = \"grip\"\nbody = \"held\"\nregion = { type = \"half-space\", normal = [-1, 0, 0], "
             "point = [0.3, 0, 0] }\n";
  plugins::Registry registry(plugins::Registry::default_search_path());
  const config::Scene scene = config::load_scene(directory / "scene.toml", {}, registry, nullptr);
  const auto bodies = sample_bodies(scene);
  const auto simulation = Simulation::create(scene, registry);
  const auto state = simulation->state();
  std::size_t id = 0, held = 0;
  for (std::size_t b = 0; b < bodies.size(); b++) {
    const auto& source = bodies[b].particles;
    for (std::size_t i = 0; i < source.positions.size(); i++, id++) {
      const ParticleState& p = state.at(id);
      EXPECT_EQ(p.id, std::int64_t(id));
      EXPECT_EQ(p.body, std::int32_t(b));
      EXPECT_LT((p.position - source.positions[i]).norm(), 1e-14);
      EXPECT_EQ(p.velocity, source.velocities[i]);
      EXPECT_EQ(p.velocity_gradient, bodies[b].velocity_gradient);
      EXPECT_NEAR(p.volume, source.volumes[i], 1e-15 * source.volumes[i] + 1e-18);
      const Matrix3 F = source.deformation.empty() ? Matrix3(Matrix3::Identity()) : source.deformation[i];
      EXPECT_LT((p.strain - (p.stores_b ? Matrix3(F * F.transpose()) : F)).norm(), 1e-14);
      held += b == 2 && source.positions[i].x() >= 0.3;
    }
  }
  EXPECT_EQ(state.size(), id);
  EXPECT_EQ(simulation->held().at(0), held);
  EXPECT_GT(held, 100u);
  // a quarter turn per second
  EXPECT_NEAR(bodies[0].velocity_gradient(0, 1), -1.5707963267948966, 1e-14);
  fs::remove_all(directory);
}

}  // namespace
}  // namespace cleave::mpm
