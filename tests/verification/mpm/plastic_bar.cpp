// A return mapping inside the simulation: a bar is stretched far beyond its yield stress and let go.

#include "scenes.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

namespace cleave::test {
namespace {

struct Case {
  int dimension;
  config::Precision precision;
};

class PlasticBar : public testing::TestWithParam<Case> {};

TEST_P(PlasticBar, StaysInsideTheYieldSurfaceAndKeepsItsNewLength) {
  const auto [dimension, precision] = GetParam();
  const double dx = 0.1, E = 1e5, nu = 0.3, mu = E / (2 * (1 + nu)), yield = 2000;
  auto points = lattice(dimension, dx, 2, Vector3(-0.6, -0.2, -0.2), Vector3(0.6, 0.2, 0.2));
  PointScene s(dimension, dx, points, "elasticity/split-neo-hookean", {{"youngs_modulus", E}, {"poissons_ratio", nu}}, 1000);
  s.scene.simulation.precision = precision;
  s.scene.materials[0].plasticity.emplace();
  s.scene.materials[0].plasticity->id = "plasticity/point-von-mises";
  s.scene.materials[0].plasticity->parameters = {{"yield_stress", yield}};
  for (double side : {-1.0, 1.0}) {
    config::Handle h;
    h.name = side < 0 ? "left" : "right";
    h.region.center = Vector3(side * 0.6, 0, 0);
    h.region.size = Vector3(0.4, 2, 2);
    h.motion.velocity = Vector3(side * 0.3, 0, 0);
    h.motion.end = 0.5;
    h.release = 0.6;
    s.scene.handles.push_back(h);
  }
  auto simulation = s.start();
  while (simulation->time() < 1) simulation->step(1);
  double worst = 0, history = 0, marker = 0, left = 1e9, right = -1e9;
  for (const auto& p : simulation->state()) {
    ASSERT_TRUE(p.stores_b);
    const double J = std::sqrt(p.strain.determinant());
    const Matrix3 deviator = p.strain - p.strain.trace() / 3 * Matrix3::Identity();
    worst = std::max(worst, std::sqrt(1.5) * mu * std::pow(J, -2.0 / 3) * deviator.norm());
    ASSERT_EQ(p.state.size(), 4u);
    history = std::max(history, p.state[0]);
    marker = std::max(marker, p.state[3] - 3);
    left = std::min(left, p.position.x());
    right = std::max(right, p.position.x());
  }
  EXPECT_LT(worst, yield * (precision == config::Precision::double_precision ? 1 + 1e-9 : 1 + 1e-4));
  EXPECT_GT(worst, 0.3 * yield) << "the bar is loaded";
  EXPECT_GT(history, yield) << "it did yield";
  EXPECT_GE(marker, 100) << "all components of the state come back";
  EXPECT_GT(right - left, 1.15 + 0.25) << "0.3 m were pulled, the elastic part of them is a few per cent";
}

std::string bar_name(const testing::TestParamInfo<Case>& info) {
  return std::string(info.param.precision == config::Precision::single_precision ? "Single" : "Double") +
         std::to_string(info.param.dimension) + "D";
}
INSTANTIATE_TEST_SUITE_P(All, PlasticBar,
                         testing::Values(Case{2, config::Precision::single_precision},
                                         Case{3, config::Precision::single_precision},
                                         Case{2, config::Precision::double_precision},
                                         Case{3, config::Precision::double_precision}),
                         bar_name);

}  // namespace
}  // namespace cleave::test
