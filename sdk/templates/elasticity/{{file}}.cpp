#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// Neo-Hookean solid, given by its energy alone. Per volume at rest [J/m^3], with J = det F:
///
///   psi = mu/2 (|F|^2 - 3 - 2 ln J) + lambda/2 ((J^2 - 1)/2 - ln J)       [Ciarlet 1988, Mathematical Elasticity I, chapter 4]
///
/// Change the formula, and what is said about it; stress, tangent, wave speed, and both precisions for each instruction set
/// follow from it.
struct {{Type}} {
  static constexpr About about{.id = "{{kind}}/{{id}}",
                               .version = "1.0.0",
                               .author = "",
                               .summary = "Neo-Hookean solid",
                               .source = "Ciarlet 1988, Mathematical Elasticity I, chapter 4"};

  /// The formula takes F. One that takes b = F F^T (left_cauchy_green, `const Symmetric3<T>& b`) is isotropic by itself, and
  /// the host then stores six numbers per point in place of nine.
  static constexpr Accepts accepts = Accepts::deformation_gradient;
  static constexpr bool isotropic = true;

  /// Read from the scene: youngs_modulus and poissons_ratio, or shear_modulus and bulk_modulus. A number of your own is a
  /// member `double stiffness;` and, as a further argument of describe(),
  ///   number(&{{Type}}::stiffness, {.key = "stiffness", .unit = "Pa", .valid = positive, .description = "what it is"})
  IsotropicModuli moduli;
  static constexpr auto parameters = describe(&{{Type}}::moduli);

  /// T stands for many points at once, or for a number that carries its derivatives: there is no `if` on it, but select().
  /// Damage takes away `tension` and leaves `compression`: broken matter still resists being squeezed.
  template <class T>
  EnergySplit<T> energy(const Matrix3<T>& F) const {
    const T J = determinant(F), ln_J = log(J);
    const T shape = 0.5 * moduli.shear * (squared_norm(F) - 3 - 2 * ln_J);
    const T volume = 0.5 * moduli.lame * (0.5 * (J * J - 1) - ln_J);
    return {.tension = shape + select(J >= 1, volume, T(0)), .compression = select(J >= 1, T(0), volume)};
  }
};

}  // namespace

CLEAVE_PLUGIN({{Type}})
