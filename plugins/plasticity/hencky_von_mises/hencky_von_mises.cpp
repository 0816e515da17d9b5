#include <cleave/decompositions.hpp>
#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

namespace {
using namespace cleave;

/// Von Mises plasticity returned in the principal logarithmic strains e = log(b)/2, with the stress of Hencky's solid,
/// s = 2 mu dev e. It is exact with elasticity/stvk-hencky; other elastic laws lend it their mu, and their own stress on the
/// returned state differs by terms of second order in dev e.
///
///   q = sqrt(3/2) |s| <= tau_y + H a          a = int sqrt(2/3) |dev de_p|, the equivalent plastic strain
///
/// The flow is along s and H is constant, so that the backward Euler return is closed: with q_tr of the trial state
///
///   da = (q_tr - tau_y - H a)/(3 mu + H),     dev e_new = (1 - 3 mu da/q_tr) dev e_tr,     tr e_new = tr e_tr
///                                                          [Simo and Hughes 1998, section 3.3; Klar et al. 2016]
struct HenckyVonMises {
  static constexpr About about{.id = "plasticity/hencky-von-mises",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Von Mises plasticity in logarithmic strain",
                               .source = "Klar et al. 2016; Simo and Hughes 1998, Computational Inelasticity"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;
  static constexpr bool isochoric_flow = true;

  double yield_stress;
  double hardening_modulus;
  static constexpr auto parameters =
      describe(number(&HenckyVonMises::yield_stress, {.key = "yield_stress",
                                                      .unit = "Pa",
                                                      .valid = positive,
                                                      .physical = between(1, 1e10),
                                                      .description = "in uniaxial tension"}),
               number(&HenckyVonMises::hardening_modulus, {.key = "hardening_modulus",
                                                           .unit = "Pa",
                                                           .default_value = 0,
                                                           .valid = non_negative,
                                                           .physical = between(0, 1e12),
                                                           .description = "growth of the yield stress per plastic strain"}));
  static constexpr auto states =
      describe(scalar_state({.name = "equivalent_plastic_strain",
                             .change = Change::never_decreases,
                             .description = "plastic strain of a uniaxial test with the same dissipation"}));

  template <class T>
  Returned<Symmetric3<T>, 1> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 1>& state) const {
    const double mu = elastic.deviatoric_modulus;
    const auto [values, vectors] = symmetric_eigen(b);
    const Vector3<T> e(0.5 * log(values[0]), 0.5 * log(values[1]), 0.5 * log(values[2]));
    const T mean = (e[0] + e[1] + e[2]) / 3;
    const Vector3<T> shape(e[0] - mean, e[1] - mean, e[2] - mean);
    const T q = 2.4494897427831781 * mu * norm(shape);
    const T limit = yield_stress + hardening_modulus * state[0];
    // A strain that has no logarithm counts as outside: its result is not finite, which is reported.
    const T rounding = yield_tolerance<T> * (values[0] / values[2]);  // of e, known to that of b
    const mask_of<T> outside = !(q <= limit + 2.4494897427831781 * mu * rounding);
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};

    const T flow = (q - limit) / (3 * mu + hardening_modulus);
    const T kept = 1 - 3 * mu * flow / q;
    Vector3<T> b_new;
    for (int i = 0; i < 3; ++i) b_new[i] = exp(2 * (mean + kept * shape[i]));
    return {.strain = symmetric_product(vectors, diagonal(b_new)), .state = {state[0] + flow}, .yielded = outside};
  }
};

}  // namespace

CLEAVE_PLUGIN(HenckyVonMises)
