#include "../critical_stretch.hpp"
#include "../length_scale.hpp"

#include <cleave/damage.hpp>
#include <cleave/decompositions.hpp>

namespace {
using namespace cleave;

/// Damage driven by the tensile part of the effective Cauchy stress s, weighted by up to two families of fibres a_k = R a_k0
/// that turn with the material, R the rotation of F = R S:
///
///   D = max over the past of zeta <(A s+ : s+ A)/sigma_c^2 - 1>,   s+ = sum <s_i> n_i n_i^T,   A = I + sum alpha_k a_k a_k^T
///                                                                                            [Wolper et al. 2020, eq. 7-9]
/// alpha = -1 takes the tension along a fibre out of the force: the fibres hold, and cracks run along them. alpha > 0 makes
/// them the weak direction. In the axes n_i of s, and therefore without negative terms that cancel,
///
///   A s+ : s+ A = sum_ij <s_i> <s_j> (n_i . A n_j)^2.
///
/// A bar of which the fibres lie across, or that has none, begins to fail at sigma_c; pulled slowly, with zeta = 1, it carries
/// sigma_c (sigma_c/s)^3 from there on, d = 1 - (sigma_c/s)^2.
struct AnisotropicDamage {
  static constexpr About about{.id = "damage/anisotropic",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Stress-driven damage that follows up to two families of fibres",
                               .source = "Wolper et al. 2020, AnisoMPM, section 3",
                               .budget = 300};
  static constexpr DamageInputs inputs{.effective_stress = true};
  static constexpr Accepts accepts = Accepts::deformation_gradient;
  static constexpr int fibers = 2;
  static constexpr bool optional_fibers = true;

  std::optional<double> given_stress, critical_stretch;
  double viscosity, zeta, residual;
  NumberList structural_alpha;
  LengthScale length_scale;
  Integration integration;

  double critical_stress = 0;        ///< sigma_c [Pa]
  double alpha_1 = 0, alpha_2 = 0;   ///< of the two families, 0 where there is none
  double largest_amplification = 1;  ///< (A s+ : s+ A)/|s+|^2 is at most this, the largest eigenvalue of A squared
  double length = 0;                 ///< l0 [m]

  static constexpr auto parameters = describe(
      number(&AnisotropicDamage::given_stress, {.key = "critical_stress",
                                                .unit = "Pa",
                                                .valid = positive,
                                                .description = "sigma_c, tension across the fibres at which damage begins"}),
      // An energy density taken for a stress, as in the demos of the paper.
      number(&AnisotropicDamage::critical_stretch, {.key = "critical_stretch",
                                                    .valid = resolvable_stretch,
                                                    .description = "x, for sigma_c = psi_plus((1+x) I), J/m^3 read as Pa"}),
      number(&AnisotropicDamage::viscosity, {.key = "viscosity",
                                             .unit = "s",
                                             .valid = positive,
                                             .description = "eta, time in which damage follows its driving force"}),
      list(&AnisotropicDamage::structural_alpha,
           {.key = "structural_alpha",
            .max_count = 2,
            .default_value = NumberList(-1),
            .valid = at_least(-1),
            .needs = {CLEAVE_NEEDS_FIBER | CLEAVE_ACCEPTS_F, CLEAVE_NEEDS_SECOND_FIBER | CLEAVE_ACCEPTS_F},
            .description = "alpha of each family of fibres: -1 they never tear, 0 or [] isotropic, above 0 they are weak"}),
      number(&AnisotropicDamage::zeta, {.key = "zeta",
                                        .default_value = 1,
                                        .valid = positive,
                                        .description = "slope of the driving force above the critical stress"}),
      &AnisotropicDamage::length_scale,
      number(&AnisotropicDamage::residual, {.key = "residual",
                                            .default_value = 0.01,
                                            .valid = {.minimum = 0, .maximum = 1, .maximum_open = true},
                                            .description = "part of the stiffness that broken material keeps"}),
      choice(&AnisotropicDamage::integration, {.key = "integration",
                                               .choices = {"implicit", "explicit"},
                                               .default_value = "explicit",
                                               .description = "how the damage field is integrated in time"}),
      one_of("critical_stress", "critical_stretch"));
  static constexpr auto states = describe(
      scalar_state({.name = "history", .change = Change::never_decreases, .description = "largest driving force so far"}));

  void complete(const Surroundings& surroundings) {
    critical_stress = given_stress ? *given_stress : energy_at_critical_stretch(*critical_stretch, surroundings);
    if (structural_alpha.size() > 0) alpha_1 = structural_alpha[0];
    if (structural_alpha.size() > 1) alpha_2 = structural_alpha[1];
    const double largest = 1 + std::max({0.0, alpha_1, alpha_2});
    largest_amplification = largest * largest;
    // The driving force of a point does not depend on the length: without a grid, and so without gradients, none is needed.
    if (length_scale.given() || surroundings.cell_size > 0) length = length_scale.in(surroundings);
  }

  /// Where |s|^2, which |s+|^2 cannot exceed, is too small to drive damage, the history stays, and no eigenvalue is computed.
  template <class T, class Point>
  Driven<T, 1> drive(const Point& point, const std::array<T, 1>& state) const {
    const T critical = critical_stress * point.toughness, squared = critical * critical;
    const auto may_drive = !(largest_amplification * squared_norm(point.effective_stress) <= squared);
    if (none(may_drive)) return {state[0], {state[0]}};
    const T excess = zeta * (weighted_tension<T>(point) / squared - 1);
    const T history = select(may_drive, max(excess, state[0]), state[0]);
    return {history, {history}};
  }

  DamageModel model() const {
    return {.viscosity = viscosity, .length = length, .residual = residual, .integration = integration};
  }

 private:
  /// A s+ : s+ A [Pa^2]
  template <class T, class Point>
  T weighted_tension(const Point& point) const {
    const SymmetricEigen<T> s = symmetric_eigen(point.effective_stress);
    const Vector3<T> tension(max(s.values[0], T(0)), max(s.values[1], T(0)), max(s.values[2], T(0)));
    if (alpha_1 == 0 && alpha_2 == 0) return squared_norm(tension);
    const Matrix3<T> to_axes = transpose(s.vectors) * polar(point.strain()).rotation;
    const Fibers<T> fibers = point.fibers();
    const Symmetric3<T> A =
        identity<T>() + (alpha_1 * outer(to_axes * fibers.first) + alpha_2 * outer(to_axes * fibers.second));
    return dot(tension, Vector3<T>(A[0] * A[0] * tension[0] + 2 * A[3] * A[3] * tension[1],
                                   A[1] * A[1] * tension[1] + 2 * A[5] * A[5] * tension[2],
                                   A[2] * A[2] * tension[2] + 2 * A[4] * A[4] * tension[0]));
  }
};

}  // namespace

CLEAVE_PLUGIN(AnisotropicDamage)
