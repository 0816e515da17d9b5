#pragma once

#include "mls_mpm.hpp"

#include "config/scene.hpp"
#include "mpm/simulation.hpp"

#include <vector>

namespace naive {

/// A spinning, falling block of split neo-Hookean rubber: `million` particles, 8 per cell, about 0.05 cells of motion per step
/// of fixed size.
cleave::config::Scene block_scene(double million);

/// The plain loop on the present state of a simulation of block_scene, particles in the order of their cells. The grid has room
/// for `steps` steps.
class Twin {
 public:
  Twin(const cleave::config::Scene&, const cleave::mpm::Simulation&, int steps);

  /// With the instruction set of CLEAVE_ISA, if that is x86-64-v3, else that of this processor.
  void step() { step_(body_); }
  const char* isa() const { return isa_; }
  const std::vector<Particle>& particles() const { return particles_; }
  /// Index into particles() by particle id.
  const std::vector<std::size_t>& index() const { return index_; }

 private:
  std::vector<Particle> particles_;
  std::vector<std::size_t> index_;
  std::vector<Node> grid_;
  Body body_{};
  void (*step_)(const Body&) = nullptr;
  const char* isa_ = nullptr;
};

}  // namespace naive
