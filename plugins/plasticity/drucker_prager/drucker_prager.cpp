#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

#include <numbers>

namespace {
using namespace cleave;

/// Drucker-Prager plasticity of granular and cohesive-frictional matter, flow at constant volume:
///
///   |s| <= 3 c_f p + c_c          c_f = sqrt(2/3) 2 sin(phi)/(3 - sin(phi))
///
/// which in triaxial compression without cohesion is q = 6 sin(phi)/(3 - sin(phi)) p. The cone ends at p = -c_c/(3 c_f): states
/// of less pressure return to this apex.                                       [Wolper et al. 2019, CD-MPM, section 6.3]
///
/// The apex lets material expand without stress. That gain of volume v = sum of ln(J/J_apex) is kept, and what comes back has
/// to close it before it resists: the trial state is the one of volume J e^v.                       [Klar et al. 2016, 6.3]
struct DruckerPrager {
  static constexpr About about{.id = "plasticity/drucker-prager",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Drucker-Prager plasticity, flow at constant volume",
                               .source = "Wolper et al. 2019, CD-MPM, section 6.3; Klar et al. 2016"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  double friction_angle, cohesion;
  bool volume_correction;
  Closure closure;
  static constexpr auto parameters =
      describe(number(&DruckerPrager::friction_angle, {.key = "friction_angle",
                                                       .unit = "degrees",
                                                       .valid = between(0, 90),
                                                       .physical = between(0, 60),
                                                       .description = "phi; 0: strength independent of pressure"}),
               number(&DruckerPrager::cohesion, {.key = "cohesion",
                                                 .unit = "Pa",
                                                 .default_value = 0,
                                                 .valid = non_negative,
                                                 .physical = between(0, 1e9),
                                                 .description = "c_c: shear strength |s| without pressure"}),
               boolean(&DruckerPrager::volume_correction,
                       {.key = "volume_correction",
                        .default_value = true,
                        .description = "whether material that expanded closes again before it resists"}),
               closure_parameter(&DruckerPrager::closure));
  static constexpr auto states =
      describe(scalar_state({.name = "log_volume_gain", .description = "ln of the volume gained without stress"}));

  double friction;  ///< 3 c_f
  void complete() {
    const double sine = std::sin(friction_angle * std::numbers::pi / 180);
    friction = std::sqrt(6.0) * 2 * sine / (3 - sine);
  }

  bool consistent_return() const { return closure == Closure::exact; }

  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    const double mu = elastic.deviatoric_modulus, kappa = elastic.bulk_modulus;
    const double apex = friction > 0 ? -cohesion / friction : -infinity;

    // An isotropic factor changes the volume and leaves the shape alone.
    Symmetric3<T> closed = b;
    mask_of<T> closing = mask_of<T>(false);
    if (volume_correction) {
      closing = state[0] > 0;
      if (any(closing)) closed = exp(T(2.0 / 3.0) * max(state[0], T(0))) * b;
    }
    const IsochoricTrial<T> trial(closed);
    const T J = sqrt(trial.squared_jacobian);
    const T p = elastic.pressure(J);

    const double rounding = yield_tolerance<T> * kappa;
    const auto torn = p < apex - rounding;
    const T limit = max(friction * p + cohesion, T(0)) * (1 / mu);
    const T beyond_rounding = limit + yield_tolerance<T> * (limit + trial.mean) + friction * rounding / mu;
    const auto sheared = trial.squared_shape > beyond_rounding * beyond_rounding;
    const auto yielded = torn || sheared || closing;
    if (none(yielded)) return {.strain = b, .state = state, .yielded = yielded};

    Symmetric3<T> strain = closed;
    T gain = volume_correction ? T(0) : state[0];
    if (any(sheared)) strain = select(sheared, isochoric_return<T>(closure, trial, limit * rsqrt(trial.squared_shape)), strain);
    if (any(torn)) {
      const T J_apex = elastic.jacobian(T(apex));
      strain = select(torn, Symmetric3<T>(volumetric_strain(J_apex)), strain);
      if (volume_correction) gain = select(torn, max(T(log(J / J_apex)), T(0)), gain);
    }
    return {.strain = strain, .state = {gain}, .yielded = yielded};
  }
};

}  // namespace

CLEAVE_PLUGIN(DruckerPrager)
