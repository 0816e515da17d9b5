#pragma once

#include "../plugins/law_driver.hpp"
#include "../plugins/strains.hpp"

#include <cleave/isochoric_response.hpp>

#include <cmath>

namespace cleave::plugins::test {

/// Young's modulus 1000 Pa, Poisson's ratio 0.3.
constexpr double mu = 1000 / 2.6, kappa = 1000 / 1.2;

inline Instance stvk_hencky(double youngs_modulus = 1000, double poissons_ratio = 0.3) {
  return Instance(built_plugins().load("elasticity/stvk-hencky"), stiff(youngs_modulus, poissons_ratio), {});
}

/// A return mapping for an elastic law with the moduli above, times `scale`.
inline Instance mapping(const std::string& name, const GivenParameters& parameters, PressureLaw law = PressureLaw::logarithmic,
                        double scale = 1) {
  Context context;
  context.isochoric =
      cleave_isochoric_response{sizeof(cleave_isochoric_response), std::uint32_t(law), scale * mu, scale * kappa};
  return Instance(built_plugins().load("plasticity/" + name), parameters, context);
}

struct Mapped {
  Tensor strain;  ///< F or b, as given
  double state;
  bool yielded;
  int status;
};

/// Maps points given by F, or by b where the tensors are symmetric and `measure` says so.
template <class S = double>
std::vector<Mapped> map_all(const Instance& law, const std::vector<Tensor>& strains, double state,
                            cleave_field_id measure = CLEAVE_FIELD_F) {
  const bool is_b = measure == CLEAVE_FIELD_B;
  Field field;
  for (const Tensor& strain : strains) field.push_back(is_b ? symmetric(strain) : row_major(strain));
  const cleave_field_id out = is_b ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT;
  LawDriver<S> driver;
  driver.input(measure, field).input(CLEAVE_FIELD_STATE, Field(strains.size(), {state}));
  driver.output(out, is_b ? 6 : 9).output(CLEAVE_FIELD_STATE_OUT, 1).output(CLEAVE_FIELD_YIELDED, 1);
  EXPECT_EQ(driver.run(return_map<S>(law), law.handle(), std::uint32_t(strains.size())), CLEAVE_OK);
  std::vector<Mapped> all;
  for (std::uint32_t k = 0; k < strains.size(); ++k)
    all.push_back({tensor(driver.value(out, k)), driver.value(CLEAVE_FIELD_STATE_OUT, k)[0],
                   driver.value(CLEAVE_FIELD_YIELDED, k)[0] == 1, driver.status(k)});
  return all;
}
inline Mapped map_one(const Instance& law, const Tensor& F, double state) { return map_all(law, {F}, state)[0]; }

/// log(b)/2.
inline Tensor log_strain(const Tensor& b) {
  const Eigen::SelfAdjointEigenSolver<Tensor> eigen(b);
  return eigen.eigenvectors() * (0.5 * eigen.eigenvalues().array().log()).matrix().asDiagonal() *
         eigen.eigenvectors().transpose();
}
inline Tensor log_strain_of(const Tensor& F) { return log_strain(F * F.transpose()); }
inline Tensor deviator(const Tensor& a) { return a - a.trace() / 3 * Tensor::Identity(); }

/// Stress of Hencky's solid.
inline double pressure(const Tensor& F) { return -kappa * log_strain_of(F).trace(); }
inline double shear(const Tensor& F) { return std::sqrt(1.5) * 2 * mu * deviator(log_strain_of(F)).norm(); }

inline Tensor diagonal_tensor(double x, double y, double z) { return Eigen::Vector3d(x, y, z).asDiagonal(); }

}  // namespace cleave::plugins::test
