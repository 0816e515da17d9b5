#pragma once

#include "../plugins/law_driver.hpp"
#include "../plugins/strains.hpp"

#include <cleave/isochoric_response.hpp>

#include <cmath>

namespace cleave::plugins::test {

/// Moduli of E = 1000 Pa, nu = 0.3.
constexpr double mu = 1000 / 2.6, kappa = 1000 / 1.2;

inline constexpr PressureLaw pressure_laws[] = {PressureLaw::quadratic, PressureLaw::linear, PressureLaw::logarithmic};

/// A return mapping with the elastic response it was made for.
struct Mapping {
  Instance law;
  IsochoricResponse elastic;

  Mapping(const std::string& id, GivenParameters parameters, IsochoricResponse response = {mu, kappa, PressureLaw::quadratic})
      : elastic(response) {
    Context context;
    context.isochoric = {sizeof(cleave_isochoric_response), std::uint32_t(response.pressure_law), response.deviatoric_modulus,
                         response.bulk_modulus};
    law = Instance(built_plugins().load(id), parameters, context);
  }

  double pressure(const Tensor& b) const { return elastic.pressure(std::sqrt(b.determinant())); }
  Tensor deviatoric_stress(const Tensor& b) const {
    return elastic.deviatoric_modulus / std::cbrt(b.determinant()) * (b - b.trace() / 3 * Tensor::Identity());
  }
  double q(const Tensor& b) const { return std::sqrt(1.5) * deviatoric_stress(b).norm(); }

  struct Point {
    Tensor strain;  ///< b or F
    double state;
    bool yielded;
    std::uint8_t status;
  };
  /// All trials in one batch, each from `state`.
  template <class S = double>
  std::vector<Point> of_b(const std::vector<Tensor>& b, double state) const {
    Field field;
    for (const Tensor& trial : b) field.push_back(symmetric(trial));
    return run<S>(CLEAVE_FIELD_B, CLEAVE_FIELD_B_OUT, field, state);
  }
  template <class S = double>
  std::vector<Point> of_F(const std::vector<Tensor>& F, double state) const {
    Field field;
    for (const Tensor& trial : F) field.push_back(row_major(trial));
    return run<S>(CLEAVE_FIELD_F, CLEAVE_FIELD_F_OUT, field, state);
  }
  template <class S = double>
  Point of_b(const Tensor& b, double state) const {
    return of_b<S>(std::vector<Tensor>{b}, state)[0];
  }

 private:
  template <class S>
  std::vector<Point> run(cleave_field_id in, cleave_field_id out, const Field& field, double state) const {
    LawDriver<S> driver;
    driver.input(in, field).input(CLEAVE_FIELD_STATE, Field(field.size(), {state}));
    driver.output(out, unsigned(field[0].size())).output(CLEAVE_FIELD_STATE_OUT, 1).output(CLEAVE_FIELD_YIELDED, 1);
    EXPECT_EQ(driver.run(return_map<S>(law), law.handle(), std::uint32_t(field.size())), CLEAVE_OK);
    std::vector<Point> points;
    for (std::uint32_t i = 0; i < field.size(); ++i)
      points.push_back({tensor(driver.value(out, i)), driver.value(CLEAVE_FIELD_STATE_OUT, i)[0],
                        driver.value(CLEAVE_FIELD_YIELDED, i)[0] == 1, driver.status(i)});
    return points;
  }
};

inline Tensor stretched(double a, double b, double c) { return Eigen::Vector3d(a, b, c).asDiagonal(); }

inline std::vector<Tensor> strains(const std::vector<Tensor>& F) {
  std::vector<Tensor> b;
  for (const Tensor& f : F) b.push_back(f * f.transpose());
  return b;
}

}  // namespace cleave::plugins::test
