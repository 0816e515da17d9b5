#include <cleave/decompositions.hpp>
#include <cleave/elasticity.hpp>

namespace {
using namespace cleave;

/// Fixed corotated solid with R = U V^T of a singular value decomposition: tau = 2 mu (F - R) F^T + lambda J (J - 1) I.
struct CorotatedSvd {
  static constexpr About about{.id = "elasticity/corotated-svd", .summary = "Fixed corotated by singular values"};
  static constexpr Accepts accepts = Accepts::deformation_gradient;
  static constexpr bool inversion_safe = true;

  IsotropicModuli moduli;
  static constexpr auto parameters = describe(&CorotatedSvd::moduli);

  template <class T>
  Symmetric3<T> kirchhoff(const Matrix3<T>& F, const T& g) const {
    const T J = determinant(F), expansion = moduli.lame * J * (J - 1);
    return symmetric_part(2 * moduli.shear * g * (F - rotation(F)) * transpose(F)) +
           select(J >= 1, g * expansion, expansion) * identity<T>();
  }
  template <class T>
  T wave_modulus(const Matrix3<T>& F, const T& g) const {
    const T J = determinant(F);
    return 2 * moduli.shear * g * squared_norm(F) + max(moduli.lame, 0.0) * J * J;
  }

 private:
  /// Duals, of which the stress differential is made, have no singular value decomposition.
  template <class T>
  static Matrix3<T> rotation(const Matrix3<T>& F) {
    if constexpr (std::is_same_v<T, Lanes<scalar_of<T>>>) {
      const auto [U, values, V] = svd(F);
      return U * transpose(V);
    } else {
      return polar(F).rotation;
    }
  }
};

}  // namespace

CLEAVE_PLUGIN(CorotatedSvd)
