#pragma once

#include "config/scene.hpp"
#include "mpm/kernels/kernels.hpp"
#include "mpm/law_layout.hpp"
#include "mpm/particles.hpp"
#include "plugins/registry.hpp"

#include <string>
#include <vector>

namespace cleave::mpm {

/// What the material point method cannot do with the laws of a scene, as complete messages; empty if it can do all. Looks at
/// descriptions only.
std::vector<std::string> unsupported(const config::Scene&, const plugins::Registry&);

/// A material of the scene with its laws composed: what is stored follows from what they declare.
class Material {
 public:
  Material(const config::Material&, plugins::Registry&, int dimension, double cell_size);

  const std::string& name() const { return name_; }
  double density() const { return density_; }
  const TileLayout& layout() const { return layout_; }
  const plugins::Instance& elasticity() const { return elasticity_; }
  const plugins::Instance& plasticity() const { return plasticity_; }
  /// Names and components of the stored state variables, in order.
  const std::vector<plugins::State>& states() const { return states_; }
  std::vector<double> initial_state() const;
  const std::optional<config::Fibers>& fibers() const { return fibers_; }
  bool detects_inversion() const { return detects_inversion_; }

  /// Laws as the kernels call them, in the given precision.
  template <class T>
  BoundLaw stress() const;
  template <class T>
  BoundLaw return_mapping() const;
  /// Evaluations outside the step; scratch is stream 1, one row per tile.
  enum class Measure { energy, wave_modulus };
  template <class T>
  BoundLaw measure(Measure) const;

 private:
  std::vector<cleave_component> strain_input() const;
  void add_inputs(LawLayout&, const plugins::Description&) const;

  std::string name_;
  double density_;
  int dimension_;
  plugins::Instance elasticity_, plasticity_;
  std::optional<config::Fibers> fibers_;
  std::vector<plugins::State> states_;
  bool detects_inversion_ = false;
  TileLayout layout_;
  LawLayout stress_, return_mapping_, energy_, wave_modulus_;
};

}  // namespace cleave::mpm
