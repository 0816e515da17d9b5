#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

namespace {
using namespace cleave;

/// Von Mises plasticity with linear isotropic hardening: q <= tau_y + H alpha, whatever the pressure.
///
/// alpha is the plastic strain conjugate to q: the plastic elongation in uniaxial flow. Flow b -> b - 2 dgamma n tr(b)/3 along
/// n = s/|s|, with d alpha = sqrt(2/3) dgamma, lowers q by 3 mu_eff d alpha, mu_eff = mu_d J^(-2/3) tr(b)/3 of the trial being
/// its current shear stiffness. With q_new = tau_y + H (alpha + d alpha),
///
///   d alpha = (q - tau_y - H alpha)/(3 mu_eff + H).             [Simo 1988; Wolper et al. 2019, CD-MPM, section 6.3]
struct VonMises {
  static constexpr About about{.id = "plasticity/von-mises",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Von Mises plasticity, linear isotropic hardening",
                               .source = "Wolper et al. 2019, CD-MPM, section 6.3; Simo 1988, part I"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  double yield_stress, hardening_modulus;
  Closure closure;
  static constexpr auto parameters =
      describe(number(&VonMises::yield_stress, {.key = "yield_stress",
                                                .unit = "Pa",
                                                .valid = positive,
                                                .physical = between(1e-2, 1e10),
                                                .description = "tau_y: in uniaxial tension, as Kirchhoff stress"}),
               number(&VonMises::hardening_modulus, {.key = "hardening_modulus",
                                                     .unit = "Pa",
                                                     .default_value = 0,
                                                     .valid = non_negative,
                                                     .physical = between(0, 1e11),
                                                     .description = "H: growth of the yield stress with plastic strain"}),
               closure_parameter(&VonMises::closure));
  static constexpr auto states = describe(scalar_state({.name = "equivalent_plastic_strain",
                                                        .change = Change::never_decreases,
                                                        .description = "alpha: plastic strain, summed over all flow"}));

  bool consistent_return() const { return closure == Closure::exact; }
  bool keeps_volume() const { return closure == Closure::exact; }

  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    // Stresses in units of mu_d.
    const double tau_y = yield_stress / elastic.deviatoric_modulus, H = hardening_modulus / elastic.deviatoric_modulus;
    const T limit = tau_y + H * state[0];
    const IsochoricTrial<T> trial(b);
    const T squared_q = 1.5 * trial.squared_shape;
    const T beyond_rounding = limit + yield_tolerance<T> * (limit + trial.mean);
    const auto outside = squared_q > beyond_rounding * beyond_rounding;
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};

    const T q = sqrt(squared_q);
    const T increment = (q - limit) / (3 * trial.mean + H);
    return {.strain = isochoric_return<T>(closure, trial, (limit + H * increment) / q),
            .state = {state[0] + increment},
            .yielded = outside};
  }
};

}  // namespace

CLEAVE_PLUGIN(VonMises)
