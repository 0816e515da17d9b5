// The attribute `stress` of frames against closed forms, and what attributes are called.

#include "scenes.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <map>

namespace cleave::test {
namespace {

const output::Attribute& attribute(const output::ParticleFrame& frame, const std::string& name) {
  for (const auto& a : frame.attributes)
    if (a.name == name) return a;
  throw std::runtime_error("there is no " + name);
}

constexpr double youngs_modulus = 1e5, poissons_ratio = 0.3, shear_modulus = youngs_modulus / (2 * (1 + poissons_ratio));

struct Box : PointScene {
  Box(int dimension, const Matrix3& F, config::Precision precision = config::Precision::double_precision)
      : PointScene(dimension, 0.1, points(dimension, F), "elasticity/split-neo-hookean",
                   {{"youngs_modulus", youngs_modulus}, {"poissons_ratio", poissons_ratio}}, 1000) {
    scene.simulation.precision = precision;
    scene.output.attributes = {"stress", "b"};
  }

  static std::vector<Point> points(int dimension, const Matrix3& F) {
    auto points = lattice(dimension, 0.1, 2, Vector3(0, 0, 0), Vector3(0.3, 0.3, 0.3));
    for (auto& p : points) p.F = F;
    return points;
  }
};

// Uniaxial strain F = diag(l, 1, 1): sigma_xx - sigma_yy = mu l^(-2/3) (l^2 - 1)/l, of either sign.
// Simple shear with xy, xz and yz: sigma_ij = mu b_ij.
TEST(StressOfFrames, IsVonMisesOfTheCauchyStress) {
  for (const auto precision : {config::Precision::single_precision, config::Precision::double_precision})
    for (const int dimension : {2, 3})
      for (const double l : {0.8, 1.0, 1.3}) {
        const Box s(dimension, Vector3(l, 1, 1).asDiagonal(), precision);
        const double expected = shear_modulus * std::pow(l, -5. / 3) * std::abs(l * l - 1);
        const auto frame = s.start()->frame(0);
        const auto& stresses = attribute(frame, "stress");
        ASSERT_EQ(stresses.values.size(), frame.particles());
        EXPECT_EQ(stresses.unit, "Pa");
        for (const float stress : stresses.values)
          ASSERT_NEAR(stress, expected, 2e-6 * youngs_modulus) << dimension << "D, l = " << l;
      }

  const Matrix3 F = (Matrix3() << 1, 0.2, -0.1, 0, 1, 0.3, 0, 0, 1).finished();
  const Box s(3, F);
  const Matrix3 b = F * F.transpose(), deviator = b - b.trace() / 3 * Matrix3::Identity();
  EXPECT_NEAR(attribute(s.start()->frame(0), "stress").values[0], shear_modulus * std::sqrt(1.5) * deviator.norm(), 1e-2);
}

// g = (1 - d)^2 (1 - r) + r on the shear stress, r = 0 here; the default frame has no stress.
TEST(StressOfFrames, IsLessByDamage) {
  Box s(3, Vector3(1.3, 1, 1).asDiagonal());
  s.scene.output.attributes = {};
  s.scene.materials[0].damage =
      config::PluginUse{"damage/rankine", {{"failure_stress", 1e4}, {"softening", 1.0}, {"residual", 0.0}}, {}};
  auto simulation = s.start();
  simulation->step(1);
  for (const auto& a : simulation->frame(0).attributes) EXPECT_NE(a.name, "stress");

  s.scene.output.attributes = {"stress", "damage", "b"};
  simulation = s.start();
  simulation->step(1);
  const auto frame = simulation->frame(1);
  const auto &stress = attribute(frame, "stress").values, &damage = attribute(frame, "damage").values,
             &strain = attribute(frame, "b").values;
  float most = 0;
  for (std::size_t i = 0; i < frame.particles(); i++) {
    Matrix3 b;
    for (int c = 0; c < 9; c++) b(c / 3, c % 3) = double(strain[9 * i + std::size_t(c)]);
    const Matrix3 deviator = b - b.trace() / 3 * Matrix3::Identity();
    const double g = std::pow(1 - double(damage[i]), 2), J2 = b.determinant();
    EXPECT_NEAR(stress[i], g * shear_modulus * std::pow(J2, -5. / 6) * std::sqrt(1.5) * deviator.norm(), 1e-2);
    most = std::max(most, damage[i]);
  }
  EXPECT_GT(most, 0.1f);
  EXPECT_LT(most, 1.f);
}

// A state variable of a name that is taken, or of another shape than that of another law, gets a name of its own.
TEST(AttributesOfFrames, HaveOneNameEach) {
  Box s(3, Matrix3::Identity());
  auto other = s.scene.materials[0];
  s.scene.materials[0].plasticity = config::PluginUse{"plasticity/point-von-mises", {{"yield_stress", 1e3}}, {}};
  other.name = "other";
  other.plasticity = config::PluginUse{"plasticity/point-state-names", {}, {}};
  s.scene.materials.push_back(other);
  auto body = s.scene.bodies[0];
  body.name = "beside";
  body.material = "other";
  s.scene.bodies.push_back(body);
  s.scene.output.attributes = {"stress", "b", "marker"};
  const auto frame = s.start()->frame(0);
  const std::size_t last = frame.particles() - 1;
  const std::map<std::string, std::vector<float>> of_last = {
      {"stress", {0}},  {"b", {1, 0, 0, 0, 1, 0, 0, 0, 1}}, {"marker", {0, 0, 0}},
      {"stress_", {7}}, {"b_", {1, 2, 3, 4, 5, 6}},         {"marker_", {8}}};
  ASSERT_EQ(frame.attributes.size(), of_last.size());
  for (const auto& [name, values] : of_last) {
    const auto& a = attribute(frame, name);
    ASSERT_EQ(std::size_t(a.components), values.size()) << name;
    EXPECT_EQ(std::vector<float>(a.values.end() - a.components, a.values.end()), values) << name;
    EXPECT_EQ(a.values.size(), (last + 1) * values.size()) << name;
  }
  EXPECT_EQ(attribute(frame, "marker").values[2], 3);
}

}  // namespace
}  // namespace cleave::test
