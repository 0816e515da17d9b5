// The incremental potential: its gradient is the derivative of its value, its Hessian that of its gradient.

#include "mpm/colliders.hpp"
#include "mpm/grid.hpp"
#include "mpm/incremental_potential.hpp"
#include "scenes.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <random>

namespace cleave::test {
namespace {

/// Particles with random strains, positions and velocities on a grid with masses and velocities of its own.
template <int D>
struct System {
  using T = double;
  static constexpr double dx = 0.1, time_step = 2e-3, density = 800;

  mpm::Material material;
  mpm::Particles<T, D> particles;
  mpm::Grid<T, D> grid;
  mpm::Buffer constants{64};
  mpm::IncrementalPotential<T, D> potential;
  std::vector<T> velocity, direction;
  std::mt19937 random{3};

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }

  static config::Material specification(const std::string& law, const plugins::GivenParameters& parameters, bool damage) {
    config::Material m;
    m.name = "material";
    m.density = density;
    m.elasticity = {law, parameters, {}};
    if (damage)
      m.damage = config::PluginUse{"damage/phase-field", {{"energy_release_rate", 10.}, {"length_scale_cells", 0.5}}, {}};
    return m;
  }

  System(const std::string& law, const plugins::GivenParameters& parameters, bool damage)
      : material(specification(law, parameters, damage), registry(), D, dx, false), particles(material.layout()) {
    std::fill_n(reinterpret_cast<T*>(constants.data()) + mpm::tile_lanes<T>, mpm::tile_lanes<T>, 1.0);
    const int n = 150;
    std::vector<mpm::NewParticle> all(n);
    std::vector<double> state, fibers;
    for (int i = 0; i < n; i++) {
      auto& p = all[std::size_t(i)];
      p.id = std::uint32_t(i);
      for (int a = 0; a < D; a++) p.position[a] = uniform(-3, 6);
      p.volume = uniform(0.05, 0.2);
      for (int a = 0; a < D; a++)
        for (int b = 0; b < D; b++) p.deformation(a, b) += uniform(-0.2, 0.2);
      if (D == 2) p.deformation(2, 2) = uniform(0.9, 1.1);
      if (damage) p.damage = uniform(0, 1);
      Vector3 a(uniform(-1, 1), uniform(-1, 1), D == 3 ? uniform(-1, 1) : 0);
      a.normalize();
      Vector3 b = Vector3(uniform(-1, 1), uniform(-1, 1), D == 3 ? uniform(-1, 1) : 0);
      b = D == 3 ? a.cross(b).normalized() : Vector3(-a[1], a[0], 0);
      for (const auto& initial : material.initial_state()) state.push_back(initial);
      if (material.layout().fiber) fibers.insert(fibers.end(), a.data(), a.data() + 3);
      if (material.layout().second_fiber) fibers.insert(fibers.end(), b.data(), b.data() + 3);
    }
    particles.assign(all, state, fibers);
    particles.sort();
    for (auto& b : particles.blocks()) b.damaged = damage;
    std::vector<mpm::BlockCoordinate> homes;
    for (const auto& b : particles.blocks()) homes.push_back(b.coordinate);
    grid.rebuild(homes);
    for (auto& b : particles.blocks()) grid.link(b, b.coordinate);
    mpm::ParticleView view = particles.view();
    view.constants = constants.data();
    view.residual = damage ? material.damage_model().residual : 0;
    // masses as the transfer gives them
    const auto& kernels = mpm::kernels_of<T, D>(mpm::load_kernels().transfer);
    grid.clear(grid.data());
    mpm::StepView step;
    step.cell_size = dx;
    step.stress = false;
    step.grid = grid.data();
    mpm::Buffer scratch(kernels.scratch_bytes);
    mpm::BlockReport report;
    for (const auto& b : particles.blocks()) kernels.particle_to_grid(view, b, step, scratch.data(), report);
    velocity.resize(grid.nodes() * 4);
    direction.resize(grid.nodes() * 4);
    for (std::size_t i = 0; i < grid.nodes(); i++)
      for (int a = 1; a <= D; a++) {
        grid.node(i)[a] = uniform(-1, 1);
        velocity[4 * i + std::size_t(a)] = uniform(-3, 3);
        direction[4 * i + std::size_t(a)] = uniform(-1, 1);
      }
    potential.begin(grid, {{&particles, view, &material, material.implicit_response<T>(), material.implicit_differential<T>()}},
                    time_step, dx, density);
  }

  std::vector<T> moved(double distance) const {
    std::vector<T> v = velocity;
    for (std::size_t i = 0; i < v.size(); i++) v[i] += distance * direction[i];
    return v;
  }
  std::vector<T> gradient_at(const std::vector<T>& v) {
    std::vector<T> g(v.size());
    EXPECT_TRUE(potential.evaluate(v.data(), g.data()).valid);
    return g;
  }
  /// Over nodes with mass.
  double dot(const std::vector<T>& a, const std::vector<T>& b) const {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); i += 4)
      if (potential.target()[i] > 0)
        for (std::size_t c = 1; c <= D; c++) sum += a[i + c] * b[i + c];
    return sum;
  }
};

struct Law {
  const char* name;
  plugins::GivenParameters parameters;
};
const Law laws[] = {
    {"elasticity/split-neo-hookean", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}},
    {"elasticity/fixed-corotated", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}},
    {"elasticity/stvk-hencky", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}},
    {"elasticity/qr", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}},
    {"elasticity/qr", {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}, {"fiber_scale", 5.}, {"cross_fiber_scale", 2.}}},
};

template <int D>
void check_derivatives(const Law& law, bool damage) {
  SCOPED_TRACE(std::string(law.name) + (damage ? " with damage" : "") + " in " + std::to_string(D) + "D");
  System<D> s(law.name, law.parameters, damage);
  const double h = 1e-4;
  std::vector<double> unread(s.velocity.size());
  const double above = s.potential.evaluate(s.moved(h).data(), unread.data()).energy,
               below = s.potential.evaluate(s.moved(-h).data(), unread.data()).energy;
  const auto high = s.gradient_at(s.moved(h)), low = s.gradient_at(s.moved(-h)), g = s.gradient_at(s.velocity);
  const double slope = s.dot(g, s.direction);
  EXPECT_NEAR((above - below) / (2 * h), slope, 1e-6 * std::abs(slope));

  std::vector<double> product(s.velocity.size());
  s.potential.multiply(s.direction.data(), product.data());
  double error = 0, size = 0;
  for (std::size_t i = 0; i < product.size(); i += 4)
    if (s.potential.target()[i] > 0)
      for (std::size_t c = 1; c <= D; c++) {
        error = std::max(error, std::abs((high[i + c] - low[i + c]) / (2 * h) - product[i + c]));
        size = std::max(size, std::abs(product[i + c]));
      }
  EXPECT_LT(error, 1e-5 * size);
  // The Hessian is symmetric.
  std::vector<double> other(s.velocity.size());
  s.potential.multiply(s.velocity.data(), other.data());
  EXPECT_NEAR(s.dot(product, s.velocity), s.dot(other, s.direction),
              1e-10 * std::sqrt(s.dot(product, product) * s.dot(s.velocity, s.velocity)));

  // Diagonal blocks are what the Hessian gives for one component of one node.
  s.potential.find_tangents(true);
  std::uniform_int_distribution<std::size_t> node(0, s.grid.nodes() - 1);
  for (int i = 0; i < 20;) {
    const std::size_t n = node(s.random);
    if (!(s.potential.target()[4 * n] > 1e-6)) continue;
    i++;
    for (int c = 0; c < D; c++) {
      std::vector<double> unit(s.velocity.size(), 0.0), column(s.velocity.size());
      unit[4 * n + 1 + std::size_t(c)] = 1;
      s.potential.multiply(unit.data(), column.data());
      for (int r = 0; r <= c; r++) {
        const int at = r * D - r * (r - 1) / 2 + c - r;
        const double mass = r == c ? s.potential.target()[4 * n] : 0;
        EXPECT_NEAR(s.potential.diagonal()[n * mpm::diagonal_numbers + std::size_t(at)] + mass,
                    column[4 * n + 1 + std::size_t(r)], 1e-9 * (std::abs(column[4 * n + 1 + std::size_t(c)]) + 1e-6));
      }
    }
  }
}

TEST(IncrementalPotential, HasItsDerivatives) {
  for (const Law& law : laws)
    for (const bool damage : {false, true}) {
      check_derivatives<2>(law, damage);
      check_derivatives<3>(law, damage);
    }
}

}  // namespace
}  // namespace cleave::test
