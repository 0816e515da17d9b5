#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

#include <numbers>

namespace {
using namespace cleave;

/// Non-associated Cam-Clay: an ellipse in (p, q), between the tips -beta p0 and p0, from which flow leads straight down in q.
///
///   y = q^2 (1 + 2 beta) + M^2 (p + beta p0)(p - p0) <= 0        p0 = kappa (1e-5 + sinh(xi <-alpha>))
///
///   p > p0            p_new = p0          alpha += ln(J/J_new)
///   p < -beta p0      p_new = -beta p0    alpha += ln(J/J_new)
///   else if y > 0     p_new = p, q_new = M sqrt((p + beta p0)(p0 - p)/(1 + 2 beta)), alpha += ln(J/J_x)
///
/// where J_x = J(p_x) and p_x is where the ray from the ellipse's centre to the trial state leaves the ellipse: states on the
/// compressed side of the centre harden, those on the other side soften.        [Wolper et al. 2019, CD-MPM, section 6.2]
///
/// Elastic laws of bounded pressure cannot reach a p0 above that bound. p0 ends where its tip is at J = 0.1 (linear pressure
/// law, p <= kappa/4: at J = 0.55), so that material can always be crushed; returns that meet this end are reported unreliable.
struct NonAssociatedCamClay {
  static constexpr About about{.id = "plasticity/nacc",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Non-associated Cam-Clay, fractures by softening",
                               .source = "Wolper et al. 2019, CD-MPM, section 6.2"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  double cohesion, hardening_factor, alpha0;
  std::optional<double> given_slope, friction_angle;
  bool hardening;
  Closure closure;
  static constexpr auto parameters =
      describe(number(&NonAssociatedCamClay::cohesion, {.key = "cohesion",
                                                        .valid = non_negative,
                                                        .physical = between(0, 10),
                                                        .description = "beta: largest tension over largest pressure p0"}),
               number(&NonAssociatedCamClay::hardening_factor, {.key = "hardening_factor",
                                                                .valid = positive,
                                                                .physical = between(0.01, 100),
                                                                .description = "xi: growth of p0 with compaction"}),
               number(&NonAssociatedCamClay::given_slope, {.key = "friction_slope",
                                                           .valid = positive,
                                                           .physical = between(0.01, 3),
                                                           .description = "M: slope q/p of the critical state"}),
               number(&NonAssociatedCamClay::friction_angle, {.key = "friction_angle",
                                                              .unit = "degrees",
                                                              .valid = {0, 90, true, false},
                                                              .physical = between(0.1, 60),
                                                              .description = "phi: M = 6 sin(phi)/(3 - sin(phi))"}),
               one_of("friction_slope", "friction_angle"),
               number(&NonAssociatedCamClay::alpha0,
                      {.key = "alpha0", .physical = between(-1, 0), .description = "alpha at the start, negative if packed"}),
               boolean(&NonAssociatedCamClay::hardening,
                       {.key = "hardening", .default_value = true, .description = "whether flow changes alpha"}),
               closure_parameter(&NonAssociatedCamClay::closure));
  static constexpr auto states = describe(
      scalar_state({.name = "alpha", .description = "hardening: compaction lowers it, shear flow in tension raises it"}));

  double squared_slope;

  void complete() {
    const double sine = std::sin(friction_angle.value_or(0) * std::numbers::pi / 180);
    const double slope = given_slope ? *given_slope : 6 * sine / (3 - sine);
    squared_slope = slope * slope;
  }
  std::array<double, 1> initial_state() const { return {alpha0}; }

  bool consistent_return() const { return closure == Closure::exact; }

  /// y > 0 beyond rounding, stresses in units of kappa. Includes p outside of the tips.
  template <class T>
  mask_of<T> is_outside(const T& p, const T& squared_q, const T& p0) const {
    const T rounding = yield_tolerance<T> * (1 + cohesion) * p0;
    return (1 + 2 * cohesion) * squared_q > squared_slope * ((p + cohesion * p0) * (p0 - p) + rounding);
  }

  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    const double kappa = elastic.bulk_modulus, stiffness_ratio = elastic.deviatoric_modulus / kappa;
    const bool linear = elastic.pressure_law == PressureLaw::linear;
    const bool logarithmic = elastic.pressure_law == PressureLaw::logarithmic;
    const double largest_p0 = linear ? 0.2475 : logarithmic ? std::numbers::ln10 : 0.495;
    const T& alpha = state[0];

    // Pressures and q in units of kappa. Beyond its maximum at J = 1/2 the linear law's pressure counts as that maximum.
    const IsochoricTrial<T> trial(b);
    const T J = sqrt(trial.squared_jacobian);
    const T p = elastic.pressure(linear ? T(max(J, T(0.5))) : J) * (1 / kappa);
    const T squared_q = 1.5 * stiffness_ratio * stiffness_ratio * trial.squared_shape;

    // The ellipse of a smaller p0 lies inside, and sinh(x) >= x: most points are found elastic without the sinh.
    const T packing = hardening_factor * max(-alpha, T(0));
    mask_of<T> outside = is_outside<T>(p, squared_q, min(1e-5 + packing, T(largest_p0)));
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};
    const T hardened = 1e-5 + sinh(packing), p0 = min(hardened, T(largest_p0));
    outside = outside && is_outside<T>(p, squared_q, p0);
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};

    const T tension_tip = -cohesion * p0;
    const auto crushed = p > p0, torn = p < tension_tip, sheared = !(crushed || torn);
    const T kept_q = squared_slope / (1 + 2 * cohesion) * max((p - tension_tip) * (p0 - p), T(0));
    Symmetric3<T> strain = isochoric_return<T>(closure, trial, sqrt(kept_q) * rsqrt(squared_q));

    const T center = 0.5 * (1 - cohesion) * p0, half_width = 0.5 * (1 + cohesion) * p0;
    const T scale = 1 / half_width, along = (p - center) * scale;
    const T across = squared_q * ((1 + 2 * cohesion) / squared_slope) * (scale * scale);
    const T p_exit = center + (p - center) * rsqrt(along * along + across);
    const T J_reference = elastic.jacobian(T(kappa * select(sheared, p_exit, select(crushed, p0, tension_tip))));

    if (any(outside && !sheared)) strain = select(sheared, strain, volumetric_strain(J_reference));
    return {.strain = strain,
            .state = {hardening ? alpha + log(J / J_reference) : alpha},
            .yielded = outside,
            .unreliable = outside && hardened > T(largest_p0)};
  }
};

}  // namespace

CLEAVE_PLUGIN(NonAssociatedCamClay)
