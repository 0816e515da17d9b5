#include <cleave/decompositions.hpp>
#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// St. Venant-Kirchhoff solid in the logarithmic strain e = log(b)/2 (Hencky's strain), whose principal values are the
/// logarithms of the principal stretches s_i.
///
///   psi = mu sum (ln s_i)^2 + lambda/2 (sum ln s_i)^2 = mu |dev e|^2 + kappa/2 (ln J)^2
///   tau = 2 mu dev e + kappa ln J I                                                          [Klar et al. 2016, section 6.1]
///
/// For damage it is split as the neo-Hookean solid is: change of shape and expansion are degraded, compression is not.
///
///   psi_plus = mu |dev e|^2 + [J >= 1] kappa/2 (ln J)^2        psi_minus = [J < 1] kappa/2 (ln J)^2
struct StvkHencky {
  static constexpr About about{.id = "elasticity/stvk-hencky",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "St. Venant-Kirchhoff solid in logarithmic strain",
                               .source = "Klar et al. 2016, Drucker-Prager elastoplasticity for sand animation"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  IsotropicModuli moduli;
  static constexpr auto parameters = describe(&StvkHencky::moduli);

  template <class T>
  EnergySplit<T> energy(const Symmetric3<T>& b) const {
    const Symmetric3<T> strain = 0.5 * log(b);
    const T log_J = trace(strain);
    const T shear = moduli.shear * squared_norm(deviator(strain)), volume = 0.5 * moduli.bulk * log_J * log_J;
    return {.tension = shear + select(log_J >= 0, volume, T(0)), .compression = select(log_J >= 0, T(0), volume)};
  }

  template <class T>
  Symmetric3<T> kirchhoff(const Symmetric3<T>& b, const T& g) const {
    const Symmetric3<T> strain = 0.5 * log(b);
    const T log_J = trace(strain), tension = moduli.bulk * log_J;
    return 2 * moduli.shear * g * deviator(strain) + select(log_J >= 0, g * tension, tension) * identity<T>();
  }

  /// In the principal axes, with phi_ij = b_j ln(b_i/b_j)/(b_i - b_j), phi_ii = 1, a wave along n with the motion m has
  ///
  ///   rho_0 c^2 = (lambda - kappa ln J)(m.n)^2 - 2 mu (m.n) m.dev(e) n + mu sum_ij phi_ij (m_i^2 n_j^2 + m_i m_j n_i n_j).
  ///
  /// phi_ij and (phi_ij + phi_ji)/2 are largest for the largest b_j and the smallest b_i: their sum there bounds the last sum.
  /// The middle term is at most 2 mu times the largest |dev e|. Exact for waves of compression at rest.
  template <class T>
  T wave_modulus(const Symmetric3<T>& b, const T& g) const {
    const Vector3<T> values = symmetric_eigen(b).values;
    const T e0 = 0.5 * log(values[0]), e1 = 0.5 * log(values[1]), e2 = 0.5 * log(values[2]);
    const T log_J = e0 + e1 + e2, shape = max(e0 - log_J / 3, log_J / 3 - e2);
    const T x = (values[0] - values[2]) / values[2], sum = (2 + 1.5 * x) * select(x == T(0), T(1), log1p(x) / x);
    const T volume = moduli.bulk * volume_degradation<T>(exp(log_J), g) * (1 - log_J);
    return g * moduli.shear * (sum + 2 * shape) + max(volume - 2. / 3 * moduli.shear * g, T(0));
  }

  /// The deviator 2 mu dev e of this law and mu J^(-2/3) dev b, which mappings on b take for it, are equal to first order.
  IsochoricResponse isochoric_response() const {
    return {.deviatoric_modulus = moduli.shear, .bulk_modulus = moduli.bulk, .pressure_law = PressureLaw::logarithmic};
  }
};

}  // namespace

CLEAVE_PLUGIN(StvkHencky)
