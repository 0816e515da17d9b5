#pragma once

#include "../plugins/law_driver.hpp"
#include "../plugins/strains.hpp"

namespace cleave::plugins::test {

/// Young's modulus 1000 Pa, Poisson's ratio 0.3.
constexpr double mu = 1000 / 2.6, lambda = 300 / (1.3 * 0.4);

inline Instance qr(double fiber_scale = 0, double cross_fiber_scale = 0, const char* calibration = "published") {
  auto registry = built_plugins();
  GivenParameters given = stiff(1000, 0.3);
  given["fiber_scale"] = fiber_scale;
  given["cross_fiber_scale"] = cross_fiber_scale;
  given["calibration"] = std::string(calibration);
  return Instance(registry.load("elasticity/qr"), given, {});
}

/// Orthonormal; the first two columns are the fibre directions.
inline Tensor frame(unsigned seed) {
  std::srand(seed);
  return Eigen::Quaterniond::UnitRandom().toRotationMatrix();
}
inline std::vector<double> column(const Tensor& a, int j) { return {a(0, j), a(1, j), a(2, j)}; }

/// One output of many deformation gradients with one frame of fibres and one degradation.
template <class S = double>
Field evaluate_all(const Instance& law, cleave_field_id output, unsigned components, const std::vector<Tensor>& deformations,
                   double g = 1, const Tensor& fibers = Tensor::Identity()) {
  LawDriver<S> driver;
  Field strains;
  for (const Tensor& F : deformations) strains.push_back(row_major(F));
  driver.input(CLEAVE_FIELD_F, strains).constant(CLEAVE_FIELD_DEGRADATION, {g}).output(output, components);
  driver.constant(CLEAVE_FIELD_FIBER, column(fibers, 0)).constant(CLEAVE_FIELD_SECOND_FIBER, column(fibers, 1));
  EXPECT_EQ(driver.run(evaluate<S>(law), law.handle(), std::uint32_t(deformations.size())), CLEAVE_OK);
  Field results;
  for (std::uint32_t k = 0; k < deformations.size(); ++k) {
    EXPECT_EQ(driver.status(k), CLEAVE_STATUS_OK) << "F " << deformations[k];
    results.push_back(driver.value(output, k));
  }
  return results;
}
inline Tensor stress(const Instance& law, const Tensor& F, double g = 1, const Tensor& fibers = Tensor::Identity()) {
  return tensor(evaluate_all(law, CLEAVE_FIELD_TAU, 6, {F}, g, fibers)[0]);
}

/// dpsi/dF of each, by central differences; defined at every F.
inline std::vector<Tensor> energy_gradients(const Instance& law, const std::vector<Tensor>& deformations, double g = 1,
                                            const Tensor& fibers = Tensor::Identity(), double h = 1e-5) {
  std::vector<Tensor> moved;
  for (const Tensor& F : deformations)
    for (int i = 0; i < 9; ++i)
      for (double sign : {1., -1.}) {
        moved.push_back(F);
        moved.back().data()[i] += sign * h;
      }
  const Field psi = evaluate_all(law, CLEAVE_FIELD_ENERGY, 1, moved, g, fibers);
  std::vector<Tensor> gradients(deformations.size());
  for (std::size_t k = 0; k < gradients.size(); ++k)
    for (std::size_t i = 0; i < 9; ++i)
      gradients[k].data()[i] = (psi[18 * k + 2 * i][0] - psi[18 * k + 2 * i + 1][0]) / (2 * h);
  return gradients;
}

/// General, inverted, and singular: rank two with each column of F vanishing in turn, rank one, and 0.
inline std::vector<Tensor> every_kind_of_deformation() {
  std::vector<Tensor> all = deformations(12, 0.7);
  for (std::size_t k = 0; k < 12; ++k) {
    Tensor F = all[k];
    if (k < 6)
      F.row(int(k % 3)) *= -0.5;
    else if (k < 9)
      F.col(int(k % 3)).setZero();
    else
      F = F.col(0) * F.row(int(k % 3));
    all.push_back(F);
  }
  all.push_back(Tensor::Zero());
  return all;
}

}  // namespace cleave::plugins::test
