#include <cleave/decompositions.hpp>
#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// Fixed corotated solid, F = R S with R the rotation nearest to F. Finite and restoring through inversion.
///
///   psi = mu |F - R|^2 + lambda/2 (J - 1)^2        P = 2 mu (F - R) + lambda (J - 1) cof F       [Stomakhin et al. 2012]
///
/// For damage it is split as the neo-Hookean solid is: change of shape and expansion are degraded, compression is not.
///
///   psi_plus = mu |F - R|^2 + [J >= 1] lambda/2 (J - 1)^2        psi_minus = [J < 1] lambda/2 (J - 1)^2
///
/// With lambda < 0 the energy has no lower bound: of F = s I it is 3 mu (s - 1)^2 + lambda/2 (s^3 - 1)^2.
struct FixedCorotated {
  static constexpr About about{.id = "elasticity/fixed-corotated",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Fixed corotated solid, safe under inversion",
                               .source = "Stomakhin et al. 2012, Energetically consistent invertible elasticity"};
  static constexpr Accepts accepts = Accepts::deformation_gradient;
  static constexpr bool inversion_safe = true;
  static constexpr bool isotropic = true;

  IsotropicModuli moduli;
  static constexpr auto parameters = describe(&FixedCorotated::moduli);

  void complete() const {
    if (moduli.lame < -1e-12 * moduli.shear)
      throw ParameterError{moduli.youngs_modulus ? "poissons_ratio" : "bulk_modulus",
                           std::string(moduli.youngs_modulus ? "must not be negative" : "must be at least 2/3 shear_modulus") +
                               ": the energy lambda/2 (J - 1)^2 of this law would fall without bound under expansion; "
                               "elasticity/split-neo-hookean takes such moduli"};
  }

  template <class T>
  EnergySplit<T> energy(const Matrix3<T>& F) const {
    const T J = determinant(F);
    const T shear = moduli.shear * squared_norm(F - polar(F).rotation);
    const T volume = 0.5 * moduli.lame * (J - 1) * (J - 1);
    return {.tension = shear + select(J >= 1, volume, T(0)), .compression = select(J >= 1, T(0), volume)};
  }

  template <class T>
  Matrix3<T> piola(const Matrix3<T>& F, const T& g) const {
    const T J = determinant(F);
    const T expansion = moduli.lame * (J - 1);
    return 2 * moduli.shear * g * (F - polar(F).rotation) + select(J >= 1, g * expansion, expansion) * cofactor(F);
  }

  template <class T>
  Symmetric3<T> kirchhoff(const Matrix3<T>& F, const T& g) const {
    const T J = determinant(F);
    const T expansion = moduli.lame * J * (J - 1);
    return symmetric_part(2 * moduli.shear * g * (F - polar(F).rotation) * transpose(F)) +
           select(J >= 1, g * expansion, expansion) * identity<T>();
  }

  /// Along F + eps m (F^T n)^T, |F|^2 grows with n . b n, det F is linear, and tr S, as the largest of linear functions of F,
  /// is convex: rho_0 c^2 <= 2 mu lambda_max(b) + lambda J^2, with equality at rest.
  template <class T>
  T wave_modulus(const Matrix3<T>& F, const T& g) const {
    const Symmetric3<T> b = left_cauchy_green(F);
    const T J = determinant(F), largest = trace(b) / 3 + 0.81649658092772603 * norm(deviator(b));
    return 2 * moduli.shear * g * largest + moduli.lame * volume_degradation(J, g) * J * J;
  }
};

}  // namespace

CLEAVE_PLUGIN(FixedCorotated)
