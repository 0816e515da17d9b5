/// What a return mapping has to know of an elastic law: tau = mu_d J^(-2/3) dev(b) - p(J) I.
#ifndef CLEAVE_ISOCHORIC_RESPONSE_HPP
#define CLEAVE_ISOCHORIC_RESPONSE_HPP

#include <cleave/elasticity.h>
#include <cleave/math.hpp>
#include <cleave/tensor.hpp>

namespace cleave {

enum class PressureLaw {
  quadratic = CLEAVE_PRESSURE_QUADRATIC,      ///< p = -kappa/2 (J^2 - 1)
  linear = CLEAVE_PRESSURE_LINEAR,            ///< p = -kappa J (J - 1)
  logarithmic = CLEAVE_PRESSURE_LOGARITHMIC,  ///< p = -kappa ln J
};

/// p is positive in compression; all stresses are Kirchhoff stresses and undegraded.
struct IsochoricResponse {
  double deviatoric_modulus = 0;  ///< mu_d [Pa]
  double bulk_modulus = 0;        ///< kappa [Pa]
  PressureLaw pressure_law = PressureLaw::quadratic;

  /// p(J) [Pa].
  template <class T>
  T pressure(const T& J) const {
    switch (pressure_law) {
      case PressureLaw::linear:
        return -bulk_modulus * J * (J - 1);
      case PressureLaw::logarithmic:
        return -bulk_modulus * log(J);
      case PressureLaw::quadratic:
        break;
    }
    return -0.5 * bulk_modulus * (J * J - 1);
  }

  /// J(p), the inverse of pressure(). Zero where no state has so high a pressure (quadratic law, p > kappa/2). Of the two
  /// states the linear law has under compression, the one that is reached from rest.
  template <class T>
  T jacobian(const T& p) const {
    switch (pressure_law) {
      case PressureLaw::linear:
        return 0.5 + sqrt(max(T(0.25) - p / bulk_modulus, T(0)));
      case PressureLaw::logarithmic:
        return exp(-p / bulk_modulus);
      case PressureLaw::quadratic:
        break;
    }
    return sqrt(max(1 - 2 * p / bulk_modulus, T(0)));
  }

  /// Deviatoric stress s = mu_d J^(-2/3) dev(b) [Pa].
  template <class T>
  Symmetric3<T> deviatoric_stress(const Symmetric3<T>& b) const {
    return deviatoric_modulus * rcbrt(determinant(b)) * deviator(b);
  }
};

}  // namespace cleave

#endif
