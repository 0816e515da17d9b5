#include <cleave/decompositions.hpp>
#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// QR elasticity computed as the paper does: F D = Q R, tau = Q A Q^T, A the symmetric matrix with the upper triangle of
/// (dpsi/dR) R^T. [Wolper et al. 2020, section 5]
struct QrFactorized {
  static constexpr About about{.id = "elasticity/qr-factorized", .summary = "QR elasticity by explicit factorisation"};
  static constexpr Accepts accepts = Accepts::deformation_gradient;
  static constexpr bool inversion_safe = true;
  static constexpr int fibers = 2;

  IsotropicModuli moduli;
  double fiber_scale = 0;
  static constexpr auto parameters = describe(
      &QrFactorized::moduli,
      number(&QrFactorized::fiber_scale,
             {.key = "fiber_scale", .default_value = 0, .valid = non_negative, .description = "kx in multiples of mu"}));

  template <class T>
  Symmetric3<T> kirchhoff(const Matrix3<T>& F, const T& g, const Fibers<T>& a) const {
    const double mu = moduli.shear, lambda = moduli.lame;
    const auto [Q, R] = qr(F * Matrix3<T>::from_columns(a.first, a.second, cross(a.first, a.second)));
    const T J = R(0, 0) * R(1, 1) * R(2, 2), expansion = lambda * (J - 1);
    const T by_J = select(J >= 1, g * expansion, expansion) - mu * g;
    Matrix3<T> slope = mu * g * R;
    slope(0, 0) += by_J * R(1, 1) * R(2, 2) + fiber_scale * mu * (R(0, 0) - 1);
    slope(1, 1) += by_J * R(0, 0) * R(2, 2);
    slope(2, 2) += by_J * R(0, 0) * R(1, 1);
    const Symmetric3<T> A(slope(0, 0) * R(0, 0) + slope(0, 1) * R(0, 1) + slope(0, 2) * R(0, 2),
                          slope(1, 1) * R(1, 1) + slope(1, 2) * R(1, 2), slope(2, 2) * R(2, 2),
                          slope(0, 1) * R(1, 1) + slope(0, 2) * R(1, 2), slope(0, 2) * R(2, 2), slope(1, 2) * R(2, 2));
    return symmetric_product(Q, A);
  }
};

}  // namespace

CLEAVE_PLUGIN(QrFactorized)
