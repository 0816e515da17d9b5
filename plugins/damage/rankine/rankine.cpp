#include <cleave/damage.hpp>
#include <cleave/decompositions.hpp>

namespace {
using namespace cleave;

/// Local softening by the largest principal effective stress sigma_M. It has no length scale: cracks are one cell wide and
/// depend on the grid, which is what the non-local laws are compared with.
///
///   sigma_M > sigma_f:   c_new = min(c, 1 - H_s (1 - sigma_f/sigma_M)),   d = 1 - c            [Wolper et al. 2019, 3.4.1]
///
/// The paper prints sigma_M/sigma_f, with which c would grow with the stress. H_s >= 1 breaks the point altogether, at
/// sigma_M = sigma_f H_s/(H_s - 1); H_s < 1 leaves d <= H_s.
struct Rankine {
  static constexpr About about{.id = "damage/rankine",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Local softening by the largest principal stress, depends on the grid",
                               .source = "Wolper et al. 2019, CD-MPM, section 3.4.1",
                               .budget = 200};
  static constexpr DamageInputs inputs{.effective_stress = true};
  static constexpr bool isotropic = true;
  static constexpr bool local = true;

  double failure_stress, softening, residual;

  static constexpr auto parameters = describe(
      number(&Rankine::failure_stress, {.key = "failure_stress",
                                        .unit = "Pa",
                                        .valid = positive,
                                        .description = "sigma_f, largest principal stress at which damage begins"}),
      number(&Rankine::softening,
             {.key = "softening", .valid = positive, .description = "H_s, brittleness: slope of d at the failure stress"}),
      number(&Rankine::residual, {.key = "residual",
                                  .default_value = 0.001,
                                  .valid = {.minimum = 0, .maximum = 1, .maximum_open = true},
                                  .description = "part of the stiffness that broken material keeps"}));

  /// sigma_M <= tr s/3 + sqrt(2/3) |dev s| <= |s| spares most points the eigenvalues.
  template <class T, class Point>
  Damaged<T> damage(const Point& point, const std::array<T, 0>&) const {
    const Symmetric3<T>& stress = point.effective_stress;
    const T failure = failure_stress * point.toughness;
    const T bound = trace(stress) / 3 + 0.81649658092772603 * norm(deviator(stress));
    if (all(bound <= failure)) return {point.damage, {}};
    // The bound carries what is undefined on to the result, the largest of three numbers need not.
    const T largest = max(min(bound, symmetric_eigen(stress).values[0]), failure);
    const T softened = min(softening * (1 - failure / largest), T(1));
    return {max(softened, point.damage), {}};
  }

  DamageModel model() const { return {.residual = residual}; }
};

}  // namespace

CLEAVE_PLUGIN(Rankine)
