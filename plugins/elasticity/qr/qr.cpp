#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// Orthotropic solid, finite and restoring through inversion. The paper writes it in R, F [a1 a2 a3] = Q R, with r11, r22 >= 0:
///
///   psi_mu     = mu/2 (|R|^2 - 3) - mu (J - 1)            psi_lambda = lambda/2 (J - 1)^2
///   psi_fiber  = kx/2 (r11 - 1)^2 + ky/2 (sqrt(r12^2 + r22^2) - 1)^2
///   psi_plus   = psi_mu + [J >= 1] psi_lambda             psi_minus  = [J < 1] psi_lambda     [Wolper et al. 2020, section 5]
///
/// A rotation from the left changes no length: |R| = |F|, and with f_i = F a_i, r11 = |f_1| and sqrt(r12^2 + r22^2) = |f_2|.
/// R enters by these and J alone, so that the stress, Q A Q^T of the paper, is found without factorising F, at every F:
///
///   tau = g mu b + ((J >= 1 ? g : 1) lambda (J - 1) - g mu) J I + sum_i k_i (1 - 1/|f_i|) f_i f_i^T
///
/// Small strain. mu (|R|^2/2 - J) softens the change of volume: linearised at rest, kappa = lambda - mu/3, not the bulk modulus
/// lambda + 2 mu/3 of the solid that E and nu describe, and rest is stable only for nu > 1/8. With calibration "small-strain"
/// lambda + mu takes the place of lambda, and E and nu are those of the linearised solid.     [cf. Smith et al. 2018]
///
/// Collapse. F = 0 is a local minimum of the isotropic energy, with d2psi/dF2 = mu: F = s I is drawn to it where
/// s (1 + s + s^2) < mu/lambda, and so is the exact mirror image of rest. Fibres, whose force is k where |f_i| -> 0, open it.
struct Qr {
  static constexpr About about{.id = "elasticity/qr",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Orthotropic solid with up to two fibre families, safe under inversion",
                               .source = "Wolper et al. 2020, AnisoMPM, section 5"};
  static constexpr Accepts accepts = Accepts::deformation_gradient;
  static constexpr bool inversion_safe = true;
  static constexpr int fibers = 2;
  static constexpr bool optional_fibers = true;

  enum class Calibration { published, small_strain };

  IsotropicModuli moduli;
  double fiber_scale = 0, cross_fiber_scale = 0;
  Calibration calibration = Calibration::published;
  static constexpr auto parameters = describe(
      &Qr::moduli,
      number(&Qr::fiber_scale, {.key = "fiber_scale",
                                .default_value = 0,
                                .valid = non_negative,
                                .physical = between(0, 1000),
                                .needs = {CLEAVE_NEEDS_FIBER},
                                .description = "stiffness kx of the first fibre in multiples of mu"}),
      number(&Qr::cross_fiber_scale, {.key = "cross_fiber_scale",
                                      .default_value = 0,
                                      .valid = non_negative,
                                      .physical = between(0, 1000),
                                      .needs = {CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER},
                                      .description = "stiffness ky of the second fibre in multiples of mu"}),
      choice(&Qr::calibration, {.key = "calibration",
                                .choices = {"published", "small-strain"},
                                .default_value = "published",
                                .description = "published: lambda as the paper has it, softer in volume than the moduli "
                                               "say; small-strain: the moduli hold at small strain"}));

  double volume = 0;                                ///< lambda of the formulas [Pa]
  double fiber_stiffness = 0, cross_stiffness = 0;  ///< kx, ky [Pa]

  void complete() {
    volume = calibration == Calibration::small_strain ? moduli.lame + moduli.shear : moduli.lame;
    if (volume <= moduli.shear / 3)
      throw ParameterError{moduli.youngs_modulus ? "poissons_ratio" : "bulk_modulus",
                           std::string(moduli.youngs_modulus ? "must be above 1/8" : "must be above shear_modulus") +
                               " with calibration = \"published\", whose rest state is unstable otherwise; or give "
                               "calibration = \"small-strain\""};
    fiber_stiffness = fiber_scale * moduli.shear;
    cross_stiffness = cross_fiber_scale * moduli.shear;
  }

  template <class T>
  EnergySplit<T> energy(const Matrix3<T>& F, const Fibers<T>& a) const {
    const T J = determinant(F), expansion = J - 1;
    const T volumetric = 0.5 * volume * expansion * expansion;
    EnergySplit<T> psi{.tension = moduli.shear * (0.5 * (squared_norm(F) - 3) - expansion) + select(J >= 1, volumetric, T(0)),
                       .compression = select(J >= 1, T(0), volumetric)};
    if (fiber_stiffness > 0) psi.fiber = psi.fiber + 0.5 * fiber_stiffness * squared_extension(F * a.first);
    if (cross_stiffness > 0) psi.fiber = psi.fiber + 0.5 * cross_stiffness * squared_extension(F * a.second);
    return psi;
  }

  template <class T>
  Symmetric3<T> kirchhoff(const Matrix3<T>& F, const T& g, const Fibers<T>& a) const {
    const T J = determinant(F);
    Symmetric3<T> tau = moduli.shear * g * left_cauchy_green(F) + J * volume_slope(J, g) * identity<T>();
    if (fiber_stiffness > 0) {
      const Vector3<T> f = F * a.first;
      tau += tension_over_length(fiber_stiffness, f) * outer(f);
    }
    if (cross_stiffness > 0) {
      const Vector3<T> f = F * a.second;
      tau += tension_over_length(cross_stiffness, f) * outer(f);
    }
    return tau;
  }

  template <class T>
  Matrix3<T> piola(const Matrix3<T>& F, const T& g, const Fibers<T>& a) const {
    Matrix3<T> P = moduli.shear * g * F + volume_slope(determinant(F), g) * cofactor(F);
    if (fiber_stiffness > 0) {
      const Vector3<T> f = F * a.first;
      P += tension_over_length(fiber_stiffness, f) * outer(f, a.first);
    }
    if (cross_stiffness > 0) {
      const Vector3<T> f = F * a.second;
      P += tension_over_length(cross_stiffness, f) * outer(f, a.second);
    }
    return P;
  }

  template <class T>
  Matrix3<T> delta_piola(const Matrix3<T>& F, const Matrix3<T>& dF, const T& g, const Fibers<T>& a) const {
    const Matrix3<T> H = cofactor(F);
    const T J = F[0] * H[0] + F[1] * H[1] + F[2] * H[2], stiffness = select(J >= 1, g, T(1)) * volume;
    Matrix3<T> dP = moduli.shear * g * dF + stiffness * contract(H, dF) * H + volume_slope(J, g) * delta_cofactor(F, dF);
    if (fiber_stiffness > 0) dP += outer(delta_tension(fiber_stiffness, F * a.first, dF * a.first), a.first);
    if (cross_stiffness > 0) dP += outer(delta_tension(cross_stiffness, F * a.second, dF * a.second), a.second);
    return dP;
  }

  /// sigma = (mu b + (lambda (J - 1) - mu) J I)/J, kept finite where J vanishes.
  template <class T>
  Symmetric3<T> effective_cauchy(const Matrix3<T>& F, const Fibers<T>&) const {
    const T J = determinant(F);
    return (moduli.shear * left_cauchy_green(F) + J * volume_slope(J, T(1)) * identity<T>()) /
           copysign(max(abs(J), T(1e-3)), J);
  }

  /// Along F + eps m (F^T n)^T, J is linear and f_i grows by eps (n . f_i) m, so that with u_i = f_i/|f_i|
  ///
  ///   rho_0 c^2 = n . mu b n + lambda J^2 (m . n)^2 + sum_i k_i (n . f_i)^2 (1 - (1 - (m . u_i)^2)/|f_i|)
  ///            <= lambda_max(mu b + sum_i k_i f_i f_i^T) + lambda J^2,    with equality at rest.
  template <class T>
  T wave_modulus(const Matrix3<T>& F, const T& g, const Fibers<T>& a) const {
    const T J = determinant(F);
    Symmetric3<T> stiffness = g * left_cauchy_green(F);
    if (fiber_stiffness > 0) stiffness += T(fiber_scale) * outer(F * a.first);
    if (cross_stiffness > 0) stiffness += T(cross_fiber_scale) * outer(F * a.second);
    return moduli.shear * largest_eigenvalue_bound(stiffness) + volume * volume_degradation(J, g) * J * J;
  }

  /// The response used for yielding: it agrees with tau at small strain, where kappa = lambda - mu/3. Beyond, the deviatoric
  /// stress here is mu dev(b) without the factor J^(-2/3), and the pressure -lambda J (J - 1) - mu (tr b/3 - J).
  IsochoricResponse isochoric_response() const {
    return {.deviatoric_modulus = moduli.shear, .bulk_modulus = volume - moduli.shear / 3, .pressure_law = PressureLaw::linear};
  }

 private:
  /// d(g psi_plus + psi_minus)/dJ, that of mu/2 |F|^2 apart.
  template <class T>
  T volume_slope(const T& J, const T& g) const {
    const T expansion = volume * (J - 1);
    return select(J >= 1, g * expansion, expansion) - moduli.shear * g;
  }

  /// (|f| - 1)^2
  template <class T>
  static T squared_extension(const Vector3<T>& f) {
    const T extension = norm(f) - 1;
    return extension * extension;
  }

  /// k (|f| - 1)/|f|. A fibre shorter than 1e-6 of its length at rest has lost its direction, and its force k with it: the
  /// force falls to 0 in proportion to |f|.
  template <class T>
  static T tension_over_length(double k, const Vector3<T>& f) {
    return k * (1 - rsqrt(max(squared_norm(f), T(1e-12))));
  }

  /// Derivative of k (|f| - 1) f/|f| along df: k ((1 - 1/|f|) df + (f . df)/|f|^3 f), in proportion to df where |f| < 1e-6.
  template <class T>
  static Vector3<T> delta_tension(double k, const Vector3<T>& f, const Vector3<T>& df) {
    const T square = squared_norm(f), per_length = rsqrt(max(square, T(1e-12)));
    const T turning = select(square > T(1e-12), dot(f, df) * per_length * per_length * per_length, T(0));
    return k * (1 - per_length) * df + k * turning * f;
  }

  /// mean + 2 p x, where p^2 = |dev A|^2/6 and 4 x^3 - 3 x = det(dev A)/(2 p^3): at most 5 % of 2 p above the largest
  /// eigenvalue. From x = 1 Newton's method comes down to the root without passing it.
  template <class T>
  static T largest_eigenvalue_bound(const Symmetric3<T>& A) {
    const Symmetric3<T> shape = deviator(A);
    const T p = sqrt(squared_norm(shape) * T(1.0 / 6)), p3 = p * p * p;
    const mask_of<T> spherical = p3 == T(0);
    const T r = select(spherical, T(1), max(min(0.5 * determinant(shape) / select(spherical, T(1), p3), T(1)), T(-1)));
    T x(1);
    for (int i = 0; i < 3; ++i) x = (8 * x * x * x + r) / (12 * x * x - 3);
    return trace(A) * T(1.0 / 3) + 2 * p * x;
  }
};

}  // namespace

CLEAVE_PLUGIN(Qr)
