#include <cleave/decompositions.hpp>
#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

#include <numbers>

namespace {
using namespace cleave;

/// ln J and the pressure p = p(J) in units of kappa, one from the other. Written for small strains: a p0 of 1e-5 kappa keeps
/// its relative precision.
struct VolumetricResponse {
  PressureLaw law;

  /// The linear law's pressure counts as its maximum where it would fall again, below J = 1/2.
  template <class T>
  T pressure(const T& log_J) const {
    switch (law) {
      case PressureLaw::logarithmic:
        return -log_J;
      case PressureLaw::linear: {
        const T strain = expm1(max(log_J, T(-std::numbers::ln2)));
        return -(1 + strain) * strain;
      }
      case PressureLaw::quadratic:
        break;
    }
    return -0.5 * expm1(2 * log_J);
  }
  /// ln J(p) and its derivative, for p up to largest_p0().
  template <class T>
  struct Volume {
    T log_J, slope;
  };
  template <class T>
  Volume<T> volume(const T& p) const {
    switch (law) {
      case PressureLaw::logarithmic:
        return {-p, T(-1)};
      case PressureLaw::linear: {
        const T root = sqrt(0.25 - p);
        return {log1p(-p / (0.5 + root)), -0.5 / (root * (0.5 + root))};
      }
      case PressureLaw::quadratic:
        break;
    }
    return {0.5 * log1p(-2 * p), -1 / (1 - 2 * p)};
  }
  /// Laws of bounded pressure cannot reach a p0 above the bound: it ends where its tip is at J = 0.1 (linear: at J = 0.55).
  double largest_p0() const {
    return law == PressureLaw::linear ? 0.2475 : law == PressureLaw::logarithmic ? std::numbers::ln10 : 0.495;
  }
};

/// Cohesive Cam-Clay with associated flow, returned by a local Newton iteration: the yield surface of plasticity/nacc, for the
/// flow G = dy/dtau normal to it, which changes the volume.
///
///   y = q^2 (1 + 2 beta) + M^2 (p + beta p0)(p - p0) <= 0        p0 = kappa (1e-5 + sinh(xi <-alpha>))
///   G = 3 (1 + 2 beta) s - M^2/3 (2 p - (1 - beta) p0) I
///
/// Backward Euler in the logarithmic strain e = log(b)/2, e_new = e_tr - dgamma G(tau_new), splits into
///
///   ln J_new = ln J_tr + m (p_new - p_c)/kappa                   m = 2 M^2 kappa dgamma,  p_c = (1 - beta) p0/2
///   q_new = q_tr/(1 + c m)                                       c = 3 (1 + 2 beta) mu'/(M^2 kappa)
///   y(p_new, q_new) = 0                                                               [Gaume et al. 2018, Klar et al. 2016]
///   alpha_new = alpha + ln(J_tr/J_new)
///
/// p0 being that of alpha before the step. With a and b_q the half-axes of the ellipse, p_new = p_c + a cos t and
/// q_new = b_q sin t are on the surface, and eliminating m leaves
///
///   f(t) = a cos t (q_tr/b_q - sin t) - c sin t kappa (ln J_new - ln J_tr) = 0,
///
/// in the quadrant of the trial. Between the tip and its one root f has the sign of cos t, beyond the root the other one:
/// Newton's method on the angle t, kept between points of different signs.
///
/// Elastic laws of logarithmic pressure are Hencky solids: s = 2 mu dev e, and mu' = mu makes the return exact. For others
/// s = mu J^(-2/3) dev b, mu' = mu tr(b_tr) J^(-2/3)/3 [Simo and Hughes 1998, section 9.3], and b_new follows from s_new and
/// J_new as in <cleave/isochoric_return.hpp>.
struct CohesiveCamClay {
  static constexpr About about{.id = "plasticity/cohesive-cam-clay",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Cohesive Cam-Clay, associated flow, iterative return",
                               .source = "Gaume et al. 2018, Dynamic anticrack propagation in snow"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  double cohesion, hardening_factor, alpha0;
  std::optional<double> given_slope, friction_angle;
  bool hardening;
  static constexpr auto parameters =
      describe(number(&CohesiveCamClay::cohesion, {.key = "cohesion",
                                                   .valid = non_negative,
                                                   .physical = between(0, 10),
                                                   .description = "beta: largest tension over largest pressure p0"}),
               number(&CohesiveCamClay::hardening_factor, {.key = "hardening_factor",
                                                           .valid = positive,
                                                           .physical = between(0.01, 100),
                                                           .description = "xi: growth of p0 with compaction"}),
               number(&CohesiveCamClay::given_slope, {.key = "friction_slope",
                                                      .valid = positive,
                                                      .physical = between(0.01, 3),
                                                      .description = "M: slope q/p of the critical state"}),
               number(&CohesiveCamClay::friction_angle, {.key = "friction_angle",
                                                         .unit = "degrees",
                                                         .valid = {0, 90, true, false},
                                                         .physical = between(0.1, 60),
                                                         .description = "phi: M = 6 sin(phi)/(3 - sin(phi))"}),
               one_of("friction_slope", "friction_angle"),
               number(&CohesiveCamClay::alpha0,
                      {.key = "alpha0", .physical = between(-1, 0), .description = "alpha at the start, negative if packed"}),
               boolean(&CohesiveCamClay::hardening,
                       {.key = "hardening", .default_value = true, .description = "whether flow changes alpha"}));
  static constexpr auto states =
      describe(scalar_state({.name = "alpha", .description = "log of the plastic volume ratio, at the start alpha0"}));

  double slope;

  void complete() {
    const double sine = std::sin(friction_angle.value_or(0) * std::numbers::pi / 180);
    slope = given_slope ? *given_slope : 6 * sine / (3 - sine);
  }
  std::array<double, 1> initial_state() const { return {alpha0}; }

  /// Stresses in units of kappa.
  template <class T>
  struct Ellipse {
    T center, pressure_axis, shear_axis;
  };
  template <class T>
  Ellipse<T> ellipse(const VolumetricResponse& volume, const T& alpha) const {
    const T p0 = min(1e-5 + sinh(hardening_factor * max(-alpha, T(0))), T(volume.largest_p0()));
    const T pressure_axis = 0.5 * (1 + cohesion) * p0;
    return {0.5 * (1 - cohesion) * p0, pressure_axis, slope / std::sqrt(1 + 2 * cohesion) * pressure_axis};
  }

  template <class T>
  struct Return {
    T log_J, kept;           ///< ln J_new and q_new/q_tr
    mask_of<T> no_solution;  ///< not converged
  };
  /// `mu` is mu', in units of kappa as all stresses are.
  template <class T>
  Return<T> solve(const VolumetricResponse& response, const Ellipse<T>& y, const T& log_J, const T& q, const T& mu,
                  const mask_of<T>& outside) const {
    constexpr int most_steps = 40;
    // The error after a step is of the order of its square.
    const T negligible(0.25 * std::sqrt(std::numeric_limits<scalar_of<T>>::epsilon()));
    const T c = 3 * (1 + 2 * cohesion) / (slope * slope) * mu;
    const T distance = response.volume(y.center).log_J - log_J, Q = q / y.shear_axis;
    const T side = copysign(T(1), distance);

    // Starts in the direction that one step from m = 0 finds if the pressure is linear in ln J.
    const T P = distance / y.pressure_axis, N = sqrt(P * P + Q * Q), p_part = P / N, q_part = Q / N;
    const T m = max((N - 1) / (p_part * p_part + c * q_part * q_part), T(0));
    T cosine(0), sine(0);
    const auto point = [&](const T& along, const T& across, const mask_of<T>& where) {
      const T scale = rsqrt(along * along + across * across);
      cosine = select(where, along * scale, cosine);
      sine = select(where, across * scale, sine);
    };
    const T first_along = p_part * (1 + c * m), first_across = q_part * (1 + m), size = max(abs(first_along), first_across);
    point(first_along / size, first_across / size, mask_of<T>(true));

    mask_of<T> active = outside;
    T tip_cosine = side, tip_sine(0), top_cosine(0), top_sine(1);  // on both sides of the root
    for (int step = 0; step < most_steps && any(active); ++step) {
      const auto volume = response.volume(T(y.center + y.pressure_axis * cosine));
      const T gap = volume.log_J - log_J, excess = Q - sine;
      const T f = y.pressure_axis * cosine * excess - c * sine * gap;
      const mask_of<T> before_root = f * side > T(0);
      tip_cosine = select(before_root, cosine, tip_cosine);
      tip_sine = select(before_root, sine, tip_sine);
      top_cosine = select(before_root, top_cosine, cosine);
      top_sine = select(before_root, top_sine, sine);
      // excess < 0 lies beyond the solution; without it the slope stays negative there.
      const T slope =
          y.pressure_axis * (c * sine * sine * volume.slope - cosine * cosine - max(excess, T(0)) * sine) - c * cosine * gap;
      const T dt = -f / slope;
      const T along = cosine - dt * sine, across = sine + dt * cosine;
      // Where f rises, and where a step would pass the point on the other side, to the middle.
      const mask_of<T> rises = slope >= T(0), below = (across * tip_cosine - along * tip_sine) * side < T(0),
                       above = (along * top_sine - across * top_cosine) * side < T(0);
      const mask_of<T> halve = rises | (before_root & above) | ((!before_root) & below);
      point(select(halve, tip_cosine + top_cosine, along), select(halve, tip_sine + top_sine, across), active);
      // An undefined trial ends here too; its result is undefined, which is reported.
      active = active & ((abs(dt) > negligible) | rises);
    }
    const T p = y.center + y.pressure_axis * cosine;
    return {response.volume(p).log_J, select(Q > sine, sine / Q, T(1)), active};
  }

  template <class T>
  mask_of<T> is_outside(const Ellipse<T>& y, const T& p, const T& q) const {
    const T P = (p - y.center) / y.pressure_axis, Q = q / y.shear_axis;
    // A strain that has no logarithm counts as outside: its result is not finite, which is reported.
    return !(P * P + Q * Q <= 1 + yield_tolerance<T>);
  }

  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    const VolumetricResponse volume{elastic.pressure_law};
    const double mu = elastic.deviatoric_modulus / elastic.bulk_modulus;
    const Ellipse<T> y = ellipse(volume, state[0]);
    if (elastic.pressure_law == PressureLaw::logarithmic) return hencky_return(volume, y, mu, b, state);

    const IsochoricTrial<T> trial(b);
    const T log_J = 0.5 * log(trial.squared_jacobian), q = 1.2247448713915890 * mu * sqrt(trial.squared_shape);
    const mask_of<T> outside = is_outside(y, volume.pressure(log_J), q);
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};
    const Return<T> r = solve(volume, y, log_J, q, T(mu * trial.mean), outside);
    return {.strain = exp(2. / 3 * (r.log_J - log_J)) * isochoric_return(Closure::exact, trial, r.kept),
            .state = {hardening ? state[0] + log_J - r.log_J : state[0]},
            .yielded = outside & !r.no_solution,
            .retry = r.no_solution};
  }

  template <class T>
  Returned<Symmetric3<T>, 1> hencky_return(const VolumetricResponse& volume, const Ellipse<T>& y, double mu,
                                           const Symmetric3<T>& b, const std::array<T, 1>& state) const {
    const auto [values, vectors] = symmetric_eigen(b);
    const Vector3<T> e(0.5 * log(values[0]), 0.5 * log(values[1]), 0.5 * log(values[2]));
    const T log_J = e[0] + e[1] + e[2], mean = log_J / 3;
    const Vector3<T> shape(e[0] - mean, e[1] - mean, e[2] - mean);
    const T q = 2.4494897427831781 * mu * norm(shape);
    const mask_of<T> outside = is_outside(y, T(-log_J), q);
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};
    const Return<T> r = solve(volume, y, log_J, q, T(mu), outside);
    Vector3<T> b_new;
    for (int i = 0; i < 3; ++i) b_new[i] = exp(2 * (r.log_J / 3 + r.kept * shape[i]));
    return {.strain = symmetric_product(vectors, diagonal(b_new)),
            .state = {hardening ? state[0] + log_J - r.log_J : state[0]},
            .yielded = outside & !r.no_solution,
            .retry = r.no_solution};
  }
};

}  // namespace

CLEAVE_PLUGIN(CohesiveCamClay)
