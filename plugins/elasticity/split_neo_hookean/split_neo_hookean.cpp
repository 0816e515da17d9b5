#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// Neo-Hookean solid with independent shear and volume terms; tension is degraded by damage, compression is not.
///
///   psi_mu = mu/2 (J^(-2/3) tr b - 3)          psi_kappa = kappa/2 ((J^2 - 1)/2 - ln J)
///   psi_plus = psi_mu + [J >= 1] psi_kappa     psi_minus = [J < 1] psi_kappa
///   tau = g mu J^(-2/3) dev(b) + (J >= 1 ? g : 1) kappa/2 (J^2 - 1) I         [Wolper et al. 2019, eq. 8-10]
struct SplitNeoHookean {
  static constexpr About about{.id = "elasticity/split-neo-hookean",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Neo-Hookean solid, shear and volume split",
                               .source = "Wolper et al. 2019, CD-MPM, section 5"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;

  IsotropicModuli moduli;
  static constexpr auto parameters = describe(&SplitNeoHookean::moduli);

  template <class T>
  EnergySplit<T> energy(const Symmetric3<T>& b) const {
    const T J2 = determinant(b);
    const T shear = 0.5 * moduli.shear * (rcbrt(J2) * trace(b) - 3);
    const T volume = 0.25 * moduli.bulk * (J2 - 1 - log(J2));
    return {.tension = shear + select(J2 >= 1, volume, T(0)), .compression = select(J2 >= 1, T(0), volume)};
  }

  template <class T>
  Symmetric3<T> kirchhoff(const Symmetric3<T>& b, const T& g) const {
    const T J2 = determinant(b);
    const T tension = 0.5 * moduli.bulk * (J2 - 1);
    return g * (moduli.shear * rcbrt(J2)) * deviator(b) + select(J2 >= 1, g * tension, tension) * identity<T>();
  }

  /// P = tau F^-T = alpha F + beta cof F,  alpha = g mu J^(-2/3),  beta = ((J >= 1 ? g : 1) kappa/2 (J^2 - 1) - alpha
  /// |F|^2/3)/J
  template <class T>
  Matrix3<T> piola(const Matrix3<T>& F, const T& g) const {
    const Matrix3<T> H = cofactor(F);
    const T J = F[0] * H[0] + F[1] * H[1] + F[2] * H[2], J2 = J * J;
    const T alpha = g * (moduli.shear * rcbrt(J2)), tension = 0.5 * moduli.bulk * (J2 - 1);
    return alpha * F + ((select(J >= 1, g * tension, tension) - 1. / 3 * alpha * squared_norm(F)) / J) * H;
  }

  /// With dJ = cof F : dF, dalpha = -2/3 alpha dJ/J and dbeta from J beta.
  template <class T>
  Matrix3<T> delta_piola(const Matrix3<T>& F, const Matrix3<T>& dF, const T& g) const {
    const Matrix3<T> H = cofactor(F);
    const T J = F[0] * H[0] + F[1] * H[1] + F[2] * H[2], J2 = J * J, per_J = 1 / J, dJ = contract(H, dF);
    const T alpha = g * (moduli.shear * rcbrt(J2)), dalpha = -2. / 3 * alpha * per_J * dJ;
    const T bulk = select(J >= 1, g, T(1)) * moduli.bulk, squares = squared_norm(F);
    const T beta = per_J * (0.5 * bulk * (J2 - 1) - 1. / 3 * alpha * squares);
    const T dbeta = per_J * ((bulk * J - beta) * dJ - 1. / 3 * (dalpha * squares + 2 * alpha * contract(F, dF)));
    return alpha * dF + dalpha * F + dbeta * H + beta * delta_cofactor(F, dF);
  }

  /// With a wave along n, b n = beta n + gamma n', mu' = mu J^(-2/3) and c = 5/9 mu' tr b + kappa/2 (J^2 + 1), the fastest
  /// motion has
  ///
  ///   rho_0 c^2 = mu' beta + (C + sqrt(C^2 + (4/3 mu' gamma)^2))/2,     C = c - 4/3 mu' beta,
  ///
  /// growing with gamma^2 <= (b_max - beta)(beta - b_min), of directions between the axes of the largest and the least
  /// eigenvalue of b. There the root is sqrt(P + Q beta), and the whole, concave in beta, is largest where its derivative is 0
  /// or at an end: the exact maximum for the eigenvalues given. Those are the outer roots of y^3 - |dev b|^2 y/2 = det dev b
  /// with b = y + tr b/3; Newton's method comes to them from outside, so that the result is a bound however early it ends.
  template <class T>
  T wave_modulus(const Symmetric3<T>& b, const T& g) const {
    const T J2 = determinant(b), shear = g * moduli.shear * rcbrt(J2), mean = trace(b) / 3;
    const T c = 5. / 3 * shear * mean + 0.5 * moduli.bulk * volume_degradation<T>(sqrt(J2), g) * (J2 + 1);
    const Symmetric3<T> s = deviator(b);
    const T half = 0.5 * squared_norm(s), shape = sqrt(2 * half), last = determinant(s), tiny = 1e-30;
    const auto outer = [&](T y) {
      for (int i = 0; i < 3; i++) y = y - (y * (y * y - half) - last) / max(3 * y * y - half, tiny);
      return mean + y;
    };
    const T spread = 0.81649658092772603 * shape;
    const T most = outer(spread), least = max(outer(-spread), T(0));
    const T coupling = 16. / 9 * shear * shear;
    const T P = c * c - coupling * most * least, Q = coupling * (most + least) - 8. / 3 * c * shear;
    // derivative mu'/3 + Q/(4 sqrt(P + Q beta)) = 0
    const T q = 16. / 9 * shear * (most + least) - 8. / 3 * c;  // Q/mu'
    const T stationary = (0.5625 * q * q - P) / min(Q, -tiny);
    const T beta = select(Q < 0, min(max(stationary, least), most), most);
    return 1. / 3 * shear * beta + 0.5 * (c + sqrt(max(P + Q * beta, T(0))));
  }

  IsochoricResponse isochoric_response() const {
    return {.deviatoric_modulus = moduli.shear, .bulk_modulus = moduli.bulk, .pressure_law = PressureLaw::quadratic};
  }
};

}  // namespace

CLEAVE_PLUGIN(SplitNeoHookean)
