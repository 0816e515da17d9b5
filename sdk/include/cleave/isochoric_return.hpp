/// Returning a stress deviator at constant volume, on b alone: what the mappings of isotropic, deviatoric flow share.
///
/// With shape = J^(-2/3) dev(b) = s/mu_d and J^2 = det b, every strain of the same volume and the shape `k shape` is
///
///   b_new = J^(2/3) (k shape + x I).
///
/// Closure::exact takes the x for which det b_new = J^2, so that the pressure is kept and the state lands where the mapping
/// put it. Closure::trace takes the x of the trial, tr(b) J^(-2/3)/3 [Wolper et al. 2019, CD-MPM, section 6.1]: this keeps
/// tr b, while det b grows with the shape that is lost. b = diag(4, 1/2, 1/2) returned to k = 0 goes from J = 1 to 2.15. Both
/// agree to second order in the elastic shear strain.
///
///   IsochoricTrial<T> trial(b);                              // what a yield condition needs
///   b_new = isochoric_return(Closure::exact, trial, k);      // shear return: s_new = k s, 0 <= k <= 1
///   b_new = volumetric_strain(elastic.jacobian(p_tip));      // tip return: s_new = 0, p_new = p_tip
///
/// A law offers the choice as `closure_parameter(&Law::closure)` among its parameters.
#ifndef CLEAVE_ISOCHORIC_RETURN_HPP
#define CLEAVE_ISOCHORIC_RETURN_HPP

#include <cleave/math.hpp>
#include <cleave/parameters.hpp>
#include <cleave/tensor.hpp>

#include <limits>

namespace cleave {

enum class Closure {
  exact,  ///< keeps det b
  trace,  ///< keeps tr b
};

/// The parameter `closure`, a member Closure of the law.
template <class Law>
constexpr auto closure_parameter(Closure Law::*member) {
  return choice(member, {.key = "closure",
                         .choices = {"exact", "trace"},
                         .default_value = "exact",
                         .description = "what a shear return keeps: the volume, or the trace of b (CD-MPM)"});
}

/// How far beyond a yield surface, relative to the terms that are compared, rounding alone may put a returned state.
template <class T>
inline constexpr scalar_of<T> yield_tolerance = 4 * std::numeric_limits<scalar_of<T>>::epsilon();

/// A trial state taken apart into volume and shape. Defined for det b > 0.
template <class T>
struct IsochoricTrial {
  T squared_jacobian;   ///< J^2 = det b
  T contraction;        ///< J^(-2/3)
  T mean;               ///< tr(b) J^(-2/3)/3, at least 1
  Symmetric3<T> shape;  ///< J^(-2/3) dev(b) = s/mu_d
  T squared_shape;      ///< |shape|^2; q^2 = 3/2 mu_d^2 |shape|^2

  explicit CLEAVE_INLINE IsochoricTrial(const Symmetric3<T>& b)
      : squared_jacobian(determinant(b)),
        contraction(rcbrt(squared_jacobian)),
        mean(T(1.0 / 3.0) * contraction * trace(b)),
        shape(contraction * deviator(b)),
        squared_shape(squared_norm(shape)) {}
};

/// The x >= 1 with det(a + x I) = 1, a + x I positive definite, for a deviator a given by |a|^2 and det a: the largest root of
///
///   x^3 - |a|^2/2 x + det a - 1 = 0.
///
/// With m = |a|/sqrt 6, |det a| <= 2 m^3, and x = m + y it is y^2 (y + 3 m) = K with K = 1 + 2 m^3 - det a >= 1: one simple
/// root y > 0, however large the shear. y = sqrt(K/(3 m + 1)) is within 15 % of it everywhere, from where Halley's steps
/// (errors 1e-3, 4e-10, below rounding) lead.
template <class T>
CLEAVE_INLINE T isochoric_mean(const T& squared_norm, const T& determinant) {
  constexpr int steps = std::is_same_v<scalar_of<T>, float> ? 2 : 3;
  const T m = sqrt(T(1.0 / 6.0) * squared_norm), c = 3 * m;
  const T K = 1 + (2 * m * m * m - determinant);
  T y = K * rsqrt(K * (c + 1));
  for (int i = 0; i < steps; ++i) {
    const T f = y * y * (y + c) - K, df = y * (3 * y + 2 * c), half_ddf = 3 * y + c;
    y = y - f * df / (df * df - f * half_ddf);
  }
  return m + y;
}

/// b_new for s_new = k s, 0 <= k <= 1, at the volume of the trial.
template <class T>
CLEAVE_INLINE Symmetric3<T> isochoric_return(Closure closure, const IsochoricTrial<T>& trial, const T& k) {
  const T stretch = trial.squared_jacobian * (trial.contraction * trial.contraction);  // J^(2/3)
  T x = trial.mean;
  if (closure == Closure::exact) x = isochoric_mean<T>(k * k * trial.squared_shape, k * k * k * determinant(trial.shape));
  return stretch * (k * trial.shape + x * identity<T>());
}

/// J^(2/3) I: the strain without shear of volume ratio J.
template <class T>
CLEAVE_INLINE Symmetric3<T> volumetric_strain(const T& J) {
  return T(cbrt(J * J)) * identity<T>();
}

}  // namespace cleave

#endif
