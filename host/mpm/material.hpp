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
  /// `toughness`: particles carry a factor on the toughness of the damage law.
  Material(const config::Material&, plugins::Registry&, int dimension, double cell_size, bool toughness);

  const std::string& name() const { return name_; }
  double density() const { return density_; }
  const TileLayout& layout() const { return layout_; }
  const plugins::Instance& elasticity() const { return elasticity_; }
  const plugins::Instance& plasticity() const { return plasticity_; }
  const plugins::Instance& damage() const { return damage_; }
  const plugins::Instance& constraint() const { return constraint_; }
  /// Of a material with a damage law.
  const cleave_damage_model& damage_model() const { return damage_model_; }
  /// Names and components of the stored state variables, in order: of the plasticity law, then of the damage law.
  const std::vector<plugins::State>& states() const { return states_; }
  std::vector<double> initial_state() const;
  bool detects_inversion() const { return detects_inversion_; }

  /// Laws as the kernels call them, in the given precision.
  template <class T>
  BoundLaw stress() const;
  template <class T>
  BoundLaw degraded_stress() const;  ///< with g from row degradation_row of the scratch
  template <class T>
  BoundLaw return_mapping() const;
  /// What the damage law wants of the elastic one, from row 0 of the scratch on; nothing if it wants nothing.
  template <class T>
  BoundLaw damage_inputs() const;
  /// The damage law: driving force into row driving_force_row of the scratch, or damage in place.
  template <class T>
  BoundLaw driving_force() const;
  /// Laws of implicit steps, with F at the end of the step as stream 3 (see ImplicitView): P or, where the law gives none, tau,
  /// and the energy if there is one; and dP.
  template <class T>
  BoundLaw implicit_response() const;
  template <class T>
  BoundLaw implicit_differential() const;
  bool gives_piola() const { return elasticity_.can(CLEAVE_HAS_PIOLA); }
  bool gives_energy() const { return elasticity_.can(CLEAVE_HAS_ENERGY); }
  /// The response is of b alone: the law gives no P and takes no F.
  bool response_takes_b() const { return !gives_piola() && !elasticity_.can(CLEAVE_ACCEPTS_F); }
  /// Evaluations outside the step; scratch is stream 1, two rows per tile: the result, and g of materials with damage.
  enum class Measure { energy, wave_modulus };
  template <class T>
  BoundLaw measure(Measure) const;

 private:
  void check_damage_model(const config::Material&) const;
  void add_inputs(LawLayout&, const plugins::Instance&) const;
  void add_fibers(LawLayout&, const plugins::Instance&) const;
  void lay_out_implicit_laws();
  template <class T>
  BoundLaw elastic(const LawLayout&) const;

  std::string name_;
  double density_;
  int dimension_;
  plugins::Instance elasticity_, plasticity_, damage_, constraint_;
  cleave_damage_model damage_model_{};
  std::vector<plugins::State> states_;
  bool detects_inversion_ = false, has_damage_inputs_ = false;
  TileLayout layout_;
  LawLayout stress_, degraded_stress_, return_mapping_, energy_, wave_modulus_, damage_inputs_, driving_force_,
      implicit_response_, implicit_differential_;
};

}  // namespace cleave::mpm
