#include "pair.hpp"

#include "common/error.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string_view>

namespace naive {
namespace {
constexpr double youngs_modulus = 1e5, poissons_ratio = 0.3;
}  // namespace

cleave::config::Scene block_scene(double million) {
  cleave::config::Scene scene;
  auto& s = scene.simulation;
  s.cell_size = 1.0 / 128;
  s.end_time = 1e9;
  s.time_step = 3.5e-4;
  s.gravity = cleave::Vector3(0, 0, -1);
  cleave::config::Material m;
  m.name = "rubber";
  m.density = 1000;
  m.elasticity.id = "elasticity/split-neo-hookean";
  m.elasticity.parameters = {{"youngs_modulus", youngs_modulus}, {"poissons_ratio", poissons_ratio}};
  scene.materials.push_back(m);
  cleave::config::Body b;
  b.name = "block";
  b.material = m.name;
  b.shape = cleave::scene::ShapeSpec{};
  b.shape->size = cleave::Vector3::Constant(std::cbrt(million * 1e6 / b.sampling.particles_per_cell) * s.cell_size);
  b.velocity = cleave::Vector3(0.8, 0.4, -0.7);
  b.spin.angular_velocity = cleave::Vector3(0, 0, 2);
  scene.bodies.push_back(b);
  return scene;
}

Twin::Twin(const cleave::config::Scene& scene, const cleave::mpm::Simulation& simulation, int steps) {
  const auto& s = scene.simulation;
  const double dx = s.cell_size;
  auto states = simulation.state();
  const auto cell = [&](const cleave::mpm::ParticleState& p) -> cleave::Vector3 { return (p.position / dx).array().floor(); };
  std::sort(states.begin(), states.end(), [&](const auto& a, const auto& b) {
    const cleave::Vector3 x = cell(a), y = cell(b);
    return std::lexicographical_compare(x.data(), x.data() + 3, y.data(), y.data() + 3);
  });

  cleave::Vector3 low = cleave::Vector3::Constant(1e300), high = -low;
  double speed = 0;
  for (const auto& p : states) {
    low = low.cwiseMin(p.position);
    high = high.cwiseMax(p.position);
    speed = std::max(speed, p.velocity.cwiseAbs().maxCoeff());
  }
  const double room = 2 * dx + 1.2 * speed * *s.time_step * steps;
  body_.grid_size = 1;
  for (int a = 0; a < 3; a++) {
    const double first = std::floor((low[a] - room) / dx);
    body_.origin[a] = float(first * dx);
    body_.nodes[a] = int(std::ceil((high[a] + room) / dx) - first) + 1;
    body_.grid_size *= std::size_t(body_.nodes[a]);
    body_.gravity[a] = float(s.gravity[a]);
  }
  body_.cell_size = float(dx);
  body_.time_step = float(*s.time_step);
  body_.density = float(scene.materials[0].density);
  body_.shear_modulus = float(youngs_modulus / (2 * (1 + poissons_ratio)));
  body_.bulk_modulus = float(youngs_modulus / (3 * (1 - 2 * poissons_ratio)));

  index_.resize(states.size());
  for (const auto& p : states) {
    Particle q{};
    // Stress depends on b = F F^T alone, whose root is one such F.
    const cleave::Matrix3 F = Eigen::SelfAdjointEigenSolver<cleave::Matrix3>(p.strain).operatorSqrt();
    for (int i = 0; i < 3; i++) {
      q.position[i] = float(p.position[i]);
      q.velocity[i] = float(p.velocity[i]);
      for (int j = 0; j < 3; j++) {
        q.affine[i][j] = float(p.velocity_gradient(i, j));
        q.deformation[i][j] = float(F(i, j));
      }
    }
    q.volume = float(p.volume);
    index_[std::size_t(p.id)] = particles_.size();
    particles_.push_back(q);
  }
  grid_.resize(body_.grid_size);
  body_.particles = particles_.data();
  body_.particle_count = particles_.size();
  body_.grid = grid_.data();

  const char* forced = std::getenv("CLEAVE_ISA");
#if defined(__x86_64__)
  if (forced && std::string_view(forced) == "x86-64-v3") {
    step_ = x86_64_v3::step;
    isa_ = "x86-64-v3";
    return;
  }
#endif
  if (forced) throw cleave::InputError("CLEAVE_ISA: the plain loop is compiled for this processor and for x86-64-v3");
  step_ = native::step;
  isa_ = "native";
}

}  // namespace naive
