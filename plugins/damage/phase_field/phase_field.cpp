#include "../critical_stretch.hpp"
#include "../length_scale.hpp"

#include <cleave/damage.hpp>

namespace {
using namespace cleave;

/// Phase-field fracture: a crack costs the energy G per area, smeared as d = exp(-|x|/(2 l0)).
///
///   D = 4 l0 (1 - r) H/G,   H = max psi_plus over the past,   eta = 1/M_c,   l = 2 l0         [Wolper et al. 2019, eq. 6]
///
/// In a uniform bar pulled slowly d = D/(1 + D), so that for r -> 0 it carries at most
///
///   strength = 9/16 sqrt(E G/(6 l0))   at the strain sqrt(G/(6 l0 E)), where d = 1/4,
///
/// which gives the third of G, strength and l0 from two. Where l0 is given in cells, either G or the strength stays as it is
/// when the grid changes; where it is fixed in metres, both do.
struct PhaseField {
  static constexpr About about{.id = "damage/phase-field",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Phase-field fracture driven by the tensile energy",
                               .source = "Wolper et al. 2019, CD-MPM, section 3.4",
                               .budget = 5};
  static constexpr DamageInputs inputs{.tensile_energy = true};
  static constexpr bool isotropic = true;

  std::optional<double> energy_release_rate, strength, critical_stretch;
  LengthScale length_scale;
  double mobility, residual;
  Integration integration;

  double length = 0;            ///< l0 [m]
  double force_per_energy = 0;  ///< 4 l0 (1 - r)/G [m^3/J]

  static constexpr auto parameters = describe(
      number(
          &PhaseField::energy_release_rate,
          {.key = "energy_release_rate", .unit = "J/m^2", .valid = positive, .description = "G, energy of a crack per area"}),
      number(&PhaseField::strength,
             {.key = "strength", .unit = "Pa", .valid = positive, .description = "largest stress of a bar pulled slowly"}),
      // An energy per volume taken for one per area, as in the demos of the paper, whose G of 3.79e-2 and 3.79e-1 for E = 50
      // and 500, nu = 0.4 are psi_plus at a stretch of 1.01: the outcome depends on the metre, and scales with the size of the
      // model.
      number(&PhaseField::critical_stretch, {.key = "critical_stretch",
                                             .valid = resolvable_stretch,
                                             .description = "x, for G = psi_plus((1+x) I) times one metre"}),
      &PhaseField::length_scale,
      number(&PhaseField::mobility,
             {.key = "mobility",
              .unit = "1/s",
              .default_value = 15,  // the largest of the paper's table, 1 to 15: least viscous, so closest to `strength`
              .valid = positive,
              .description = "M_c, rate at which damage follows its driving force"}),
      number(&PhaseField::residual, {.key = "residual",
                                     .default_value = 0.001,
                                     .valid = {.minimum = 0, .maximum = 1, .maximum_open = true},
                                     .description = "part of the stiffness that broken material keeps"}),
      choice(&PhaseField::integration, {.key = "integration",
                                        .choices = {"implicit", "explicit"},
                                        .default_value = "implicit",
                                        .description = "how the damage field is integrated in time"}),
      one_of("energy_release_rate", "strength", "energy_release_rate strength", "critical_stretch"));
  static constexpr auto states = describe(scalar_state({.name = "history",
                                                        .unit = "J/m^3",
                                                        .change = Change::never_decreases,
                                                        .description = "H, largest tensile energy density so far"}));

  void complete(const Surroundings& surroundings) {
    double G;
    if (energy_release_rate && strength) {
      if (length_scale.given())
        throw ParameterError{length_scale.key(), "follows from energy_release_rate and strength: give two of the three"};
      G = *energy_release_rate;
      length = 27. / 512 * youngs_modulus(surroundings) * G / (*strength * *strength);
    } else {
      length = length_scale.in(surroundings);
      if (strength)
        G = 512. / 27 * length * *strength * *strength / youngs_modulus(surroundings);
      else
        G = energy_release_rate ? *energy_release_rate : energy_at_critical_stretch(*critical_stretch, surroundings);
    }
    force_per_energy = 4 * length * (1 - residual) / G;
    if (!(length > 0 && force_per_energy > 0 && std::isfinite(length) && std::isfinite(force_per_energy)))
      throw ParameterError{given_key(), "gives no usable length or driving force with the elastic moduli of this material"};
  }

  template <class T, class Point>
  Driven<T, 1> drive(const Point& point, const std::array<T, 1>& state) const {
    const T history = max(point.tensile_energy, state[0]);
    return {force_per_energy * history / point.toughness, {history}};
  }

  DamageModel model() const {
    return {.viscosity = 1 / mobility, .length = 2 * length, .residual = residual, .integration = integration};
  }

 private:
  const char* given_key() const {
    return strength ? "strength" : energy_release_rate ? "energy_release_rate" : "critical_stretch";
  }

  static double youngs_modulus(const Surroundings& surroundings) {
    if (!surroundings.elastic) throw ParameterError{"strength", "needs the elastic law of the material for its stiffness"};
    return surroundings.elastic.youngs_modulus();
  }
};

}  // namespace

CLEAVE_PLUGIN(PhaseField)
