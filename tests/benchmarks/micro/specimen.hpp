#pragma once

#include "mpm/grid.hpp"
#include "mpm/law_watch.hpp"
#include "mpm/material.hpp"
#include "mpm/particles.hpp"
#include "plugins/registry.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace cleave::benchmarks {

/// Kernels of one instruction set, whatever the best one of this processor is. Throws InputError.
const mpm::KernelSet& kernels_for(const std::string& isa);

/// The library of laws in the variant for an instruction set.
plugins::Registry& registry_for(const std::string& isa);

/// A material whose laws are those variants.
mpm::Material material_for(const std::string& isa, const config::Material&, int dimension, double cell_size);

/// A block of particles of one material on a linked grid, as a simulation holds them: 8 per cell (2D: 4) at random in equal
/// parts of the cells, strained by some per cent, moving smoothly. Lengths in m: cells of 1/128.
template <class T, int D>
class Specimen {
 public:
  static constexpr int lanes = mpm::tile_lanes<T>;
  static constexpr double cell_size = 1.0 / 128, density = 1000;

  Specimen(const std::string& isa, std::int64_t count, bool damage)
      : material(material_for(isa, description(damage), D, cell_size)),
        stress_(material.stress<T>(), sizeof(T) == 4, "", failed_),
        degraded_stress_(material.degraded_stress<T>(), sizeof(T) == 4, "", failed_),
        particles(material.layout()),
        constants_(64 * 2) {
    fill(count);
    T* ones = reinterpret_cast<T*>(constants_.data()) + lanes;
    std::fill_n(ones, lanes, T(1));
    link();
    view = particles.view();
    view.detect_inversion = material.detects_inversion();
    view.elasticity = stress_.watched();
    view.constants = constants_.data();
    if (damage) {
      view.degraded_elasticity = degraded_stress_.watched();
      view.residual = material.damage_model().residual;
    }
    step.time_step = 1e-9;  // nothing moves out of its place, however often the step is taken
    step.cell_size = cell_size;
    step.force_scale = 4 * step.time_step / (cell_size * density);
    step.grid = grid.data();
  }

  /// Active blocks and each particle block's neighbours.
  void link() {
    std::vector<mpm::BlockCoordinate> homes;
    for (const auto& b : particles.blocks()) homes.push_back(b.coordinate);
    grid.rebuild(homes);
    for (auto& b : particles.blocks()) grid.link(b, b.coordinate);
  }

  /// Calls f(block) for all blocks, colour after colour.
  template <class F>
  void for_blocks(F&& f) {
    for (const auto& colour : particles.colours())
      for (const auto i : colour) f(particles.blocks()[i]);
  }

  struct Momentum {
    double mass = 0, momentum[D] = {}, size = 0;  ///< size: sum of magnitudes
    /// Equal up to rounding.
    bool near(const Momentum& o) const {
      const double tolerance = sizeof(T) == 4 ? 1e-5 : 1e-12;
      for (int a = 0; a < D; a++)
        if (!(std::abs(momentum[a] - o.momentum[a]) <= tolerance * size)) return false;
      return size > 0 && std::abs(mass - o.mass) <= tolerance * mass;
    }
    void add(double m, int axis, double v) {
      momentum[axis] += m * v;
      size += std::abs(m * v);
    }
  };
  /// Of the particles, in units of density times cell volume.
  Momentum of_particles() const {
    Momentum sum;
    particles.for_each([&](const auto&, std::uint64_t slot) {
      const double m = double(particles.value(view.volume, slot));
      sum.mass += m;
      for (int a = 0; a < D; a++) sum.add(m, a, double(particles.value(view.velocity, a, slot)));
    });
    return sum;
  }
  /// Of the grid, that holds momentum or velocity.
  Momentum of_grid(bool velocity) const {
    Momentum sum;
    for (std::size_t n = 0; n < grid.nodes(); n++) {
      const double m = double(grid.node(n)[0]);
      sum.mass += m;
      for (int a = 0; a < D; a++) sum.add(velocity ? m : 1, a, double(grid.node(n)[1 + a]));
    }
    return sum;
  }
  double bytes_per_particle() const { return double(view.stride) / lanes; }

 private:
  mpm::FailedBatches failed_;

 public:
  mpm::Material material;

 private:
  mpm::LawWatch stress_, degraded_stress_;

 public:
  mpm::Particles<T, D> particles;
  mpm::Grid<T, D> grid;
  mpm::ParticleView view;
  mpm::StepView step;

 private:
  static config::Material description(bool damage) {
    config::Material m;
    m.name = "specimen";
    m.density = density;
    m.elasticity.id = "elasticity/split-neo-hookean";
    m.elasticity.parameters = {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}};
    if (damage) m.damage = config::PluginUse{"damage/phase-field", {{"strength", 2e3}, {"mobility", 15}}, {}};
    return m;
  }

  void fill(std::int64_t count) {
    const int parts = int(std::lround(std::pow(double(count), 1.0 / D) / 2)) * 2;  // along each axis, two to a cell
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(0, 1);
    std::vector<mpm::NewParticle> made;
    for (int i = 0; i < parts; i++)
      for (int j = 0; j < parts; j++)
        for (int k = 0; k < (D == 3 ? parts : 1); k++) {
          mpm::NewParticle p;
          p.id = std::uint32_t(made.size());
          const int part[3] = {i, j, k};
          for (int a = 0; a < D; a++) p.position[a] = 0.5 * (part[a] + uniform(random));
          p.volume = D == 3 ? 1.0 / 8 : 1.0 / 4;
          const Vector3 phase = p.position * (6.3 / parts);
          for (int a = 0; a < D; a++) p.velocity[a] = 0.5 + std::sin(phase[a] + a);
          for (int a = 0; a < D; a++) p.deformation(a, a) += 0.04 * (1 + std::sin(3 * phase[(a + 1) % D]));
          p.deformation(0, 1) = 0.05 * std::cos(phase[0]);
          made.push_back(p);
        }
    particles.assign(made, std::vector<double>(made.size() * material.initial_state().size()), {});
  }

  mpm::Buffer constants_;
};

}  // namespace cleave::benchmarks
