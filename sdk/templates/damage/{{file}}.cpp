#include <cleave/damage.hpp>

namespace {
using namespace cleave;

/// Fracture from an energy threshold. The host integrates the damage field d, of which 0 is intact and 1 broken,
///
///   eta dd/dt = < (1 - d) D - (d - l^2 lap d) >,        stress = ((1 - r)(1 - d)^2 + r) times that of intact material,
///
/// and this law says what drives it: the tensile elastic energy per volume, as far as it has ever exceeded the threshold w_c,
///
///   D = < H/w_c - 1 >,   H = max psi_plus over the past     [Miehe, Schaenzel, Ulmer 2015, Phase field modeling, part I]
///
/// Below w_c nothing breaks. A uniform bar of Young's modulus E, pulled slowly, has d = D/(1 + D); for r = 0 it carries at most
/// sqrt(2 E w_c), just where damage begins. A crack at rest is d = exp(-|x|/l) across.
struct {{Type}} {
  static constexpr About about{.id = "{{kind}}/{{id}}",
                               .version = "1.0.0",
                               .author = "",
                               .summary = "Phase-field fracture above a threshold of tensile energy",
                               .source = "Miehe, Schaenzel, Ulmer 2015, part I"};

  /// What the elastic law brings to drive(): tensile_energy, effective_stress (undegraded), or both.
  static constexpr DamageInputs inputs{.tensile_energy = true};
  static constexpr bool isotropic = true;

  double critical_energy, length_scale, viscosity, residual;
  static constexpr auto parameters = describe(
      number(&{{Type}}::critical_energy,
             {.key = "critical_energy",
              .unit = "J/m^3",
              .valid = positive,
              .description = "w_c, tensile energy at which damage begins"}),
      number(&{{Type}}::length_scale,
             {.key = "length_scale",
              .unit = "m",
              .valid = positive,
              .description = "l, over which a crack is smeared; a cell of the grid or more"}),
      number(&{{Type}}::viscosity,
             {.key = "viscosity",
              .unit = "s",
              .default_value = 0.01,
              .valid = positive,
              .description = "eta, time in which damage follows its driving force"}),
      number(&{{Type}}::residual,
             {.key = "residual",
              .default_value = 0.001,
              .valid = {.minimum = 0, .maximum = 1, .maximum_open = true},
              .description = "r, part of the stiffness that broken material keeps"}));

  /// What each point remembers: state[0] of drive().
  static constexpr auto states = describe(scalar_state({.name = "history",
                                                        .unit = "J/m^3",
                                                        .change = Change::never_decreases,
                                                        .description = "H, largest tensile energy so far"}));

  /// T stands for many points at once; max() is taken point by point. The toughness of a point is a factor, 1 unless the scene
  /// varies it.
  template <class T, class Point>
  Driven<T, 1> drive(const Point& point, const std::array<T, 1>& state) const {
    const T history = max(point.tensile_energy, state[0]);
    return {.driving_force = max(history / (critical_energy * point.toughness) - 1, T(0)), .state = {history}};
  }

  DamageModel model() const { return {.viscosity = viscosity, .length = length_scale, .residual = residual}; }
};

}  // namespace

CLEAVE_PLUGIN({{Type}})
