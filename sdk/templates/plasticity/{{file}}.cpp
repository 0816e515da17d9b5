#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

namespace {
using namespace cleave;

/// Metal plasticity with linear hardening. With the stress deviator s = mu_d J^(-2/3) dev(b) of the elastic law [Pa]:
///
///   q = sqrt(3/2) |s| <= tau_y + H alpha                                   what the material can bear
///   d alpha = (q - tau_y - H alpha)/(3 mu' + H)                            plastic strain of a step beyond it
///   s_new = (tau_y + H (alpha + d alpha))/q s,   det b_new = det b         radial return: shape changes, volume does not
///
/// where mu' = mu_d J^(-2/3) tr(b)/3 is the shear stiffness in the trial state.               [Simo 1988, part I]
struct {{Type}} {
  static constexpr About about{.id = "{{kind}}/{{id}}",
                               .version = "1.0.0",
                               .author = "",
                               .summary = "J2 plasticity, radial return, linear hardening",
                               .source = "Simo 1988, part I"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;
  static constexpr bool isochoric_flow = true;

  /// What the scene gives. Values out of `valid` are refused; out of `physical` there is a warning.
  double yield_stress, hardening_modulus;
  static constexpr auto parameters = describe(
      number(&{{Type}}::yield_stress,
             {.key = "yield_stress",
              .unit = "Pa",
              .valid = positive,
              .physical = between(1e-2, 1e10),
              .description = "tau_y, in uniaxial tension, as Kirchhoff stress"}),
      number(&{{Type}}::hardening_modulus,
             {.key = "hardening_modulus",
              .unit = "Pa",
              .default_value = 0,
              .valid = non_negative,
              .physical = between(0, 1e11),
              .description = "H, growth of the yield stress with plastic strain"}));

  /// What each point remembers: state[0] of return_map().
  static constexpr auto states = describe(scalar_state({.name = "plastic_strain",
                                                        .change = Change::never_decreases,
                                                        .description = "alpha, summed over all flow"}));

  /// Maps the trial strain, in which all of a step was elastic, to the strain that is. T stands for many points at once: a
  /// condition is a mask, and points outside of `yielded` keep their strain and state to the bit.
  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    const IsochoricTrial<T> trial(b);
    const double mu = elastic.deviatoric_modulus;
    const T q = mu * sqrt(1.5 * trial.squared_shape), limit = yield_stress + hardening_modulus * state[0];
    const auto yielded = q > limit + yield_tolerance<T> * (limit + mu * trial.mean);
    if (none(yielded)) return {.strain = b, .state = state, .yielded = yielded};

    const T increment = (q - limit) / (3 * mu * trial.mean + hardening_modulus);
    return {.strain = isochoric_return<T>(Closure::exact, trial, (limit + hardening_modulus * increment) / q),
            .state = {state[0] + increment},
            .yielded = yielded};
  }
};

}  // namespace

CLEAVE_PLUGIN({{Type}})
