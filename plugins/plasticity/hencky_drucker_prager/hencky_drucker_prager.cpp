#include <cleave/decompositions.hpp>
#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

#include <numbers>

namespace {
using namespace cleave;

/// Drucker-Prager plasticity without dilation, returned in the principal logarithmic strains e = log(b)/2 with the stress of
/// Hencky's solid, s = 2 mu dev e and p = -kappa tr e. It is exact with elasticity/stvk-hencky; other elastic laws lend it
/// their mu and kappa.
///
///   |s| <= 3 c_f p + c_c,     c_f = sqrt(2/3) 2 sin(phi)/(3 - sin(phi))
///
/// The cone ends where it bears no shear, at tr e_a = c_c/(3 kappa c_f). Beyond it the point returns to the apex, and the
/// volume it gains, v, is remembered; before it only dev e is scaled back.                 [Klar et al. 2016, section 7]
///
/// Volume correction: material that opened has to close again before it bears pressure. The map acts on e + v/3 I, and
/// v_new = v + tr e_tr - tr e_new: v grows at the apex and is used up by compression. Volume is neither made nor lost on the
/// step where it closes.                                                  [Tampubolon et al. 2017, Multi-species simulation]
struct HenckyDruckerPrager {
  static constexpr About about{.id = "plasticity/hencky-drucker-prager",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Drucker-Prager plasticity in logarithmic strain, for sand",
                               .source = "Klar et al. 2016, Drucker-Prager elastoplasticity for sand animation"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  double friction_angle;
  double cohesion;
  bool volume_correction;
  double friction = 0;  ///< c_f

  static constexpr auto parameters =
      describe(number(&HenckyDruckerPrager::friction_angle, {.key = "friction_angle",
                                                             .unit = "degrees",
                                                             .valid = {.minimum = 0, .maximum = 90, .maximum_open = true},
                                                             .physical = between(0, 50),
                                                             .description = "angle of internal friction"}),
               number(&HenckyDruckerPrager::cohesion, {.key = "cohesion",
                                                       .unit = "Pa",
                                                       .default_value = 0,
                                                       .valid = non_negative,
                                                       .physical = between(0, 1e9),
                                                       .description = "deviatoric stress |s| borne without pressure"}),
               boolean(&HenckyDruckerPrager::volume_correction,
                       {.key = "volume_correction",
                        .default_value = true,
                        .description = "material that opened closes again before it bears pressure"}));
  static constexpr auto states = describe(
      scalar_state({.name = "log_volume_gain", .description = "log of the volume gained by opening, not yet closed again"}));

  void complete() {
    const double sine = std::sin(friction_angle * std::numbers::pi / 180);
    friction = 0.81649658092772603 * 2 * sine / (3 - sine);
  }

  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    const double mu = elastic.deviatoric_modulus, kappa = elastic.bulk_modulus;
    // Without friction there is no apex.
    const double apex = friction > 0 ? cohesion / (3 * kappa * friction) : infinity;
    const auto [values, vectors] = symmetric_eigen(b);
    const Vector3<T> e(0.5 * log(values[0]), 0.5 * log(values[1]), 0.5 * log(values[2]));
    const T gained = volume_correction ? state[0] : T(0);
    const T trial = e[0] + e[1] + e[2], corrected = trial + gained, mean = trial / 3;
    const Vector3<T> shape(e[0] - mean, e[1] - mean, e[2] - mean);
    const T size = norm(shape), limit = max((cohesion - 3 * friction * kappa * corrected) / (2 * mu), T(0));
    // Of e, known to the rounding of b; the limit feels that of tr e.
    const T rounding = yield_tolerance<T> * (1 + 1.5 * friction * kappa / mu) * (values[0] / values[2]);
    const mask_of<T> opens = corrected > apex + rounding, closes = gained != T(0);
    // A strain that has no logarithm counts as outside: its result is not finite, which is reported.
    const mask_of<T> moves = opens | closes | !(size <= limit + rounding);
    if (none(moves)) return {.strain = b, .state = state, .yielded = moves};

    const T kept = select(opens, T(0), select(size > limit, limit / size, T(1)));
    const T volume = select(opens, T(apex), corrected);
    Vector3<T> b_new;
    for (int i = 0; i < 3; ++i) b_new[i] = exp(2 * (volume / 3 + kept * shape[i]));
    return {.strain = symmetric_product(vectors, diagonal(b_new)),
            .state = {volume_correction ? select(opens, corrected - apex, T(0)) : state[0]},
            .yielded = moves};
  }
};

}  // namespace

CLEAVE_PLUGIN(HenckyDruckerPrager)
