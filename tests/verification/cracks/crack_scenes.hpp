#pragma once

#include "../mpm/scenes.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

namespace cleave::test {

/// An isotropic split neo-Hookean solid, whose formulas are written out again here.
struct Solid {
  double E = 1e6, nu = 0.2, density = 1000;
  double mu() const { return E / (2 * (1 + nu)); }
  double kappa() const { return E / (3 * (1 - 2 * nu)); }
  double shear_speed() const { return std::sqrt(mu() / density); }
  /// Speed of Rayleigh waves, m/s, to about half a percent (Viktorov 1967).
  double rayleigh_speed() const { return shear_speed() * (0.87 + 1.12 * nu) / (1 + nu); }
  plugins::GivenParameters moduli() const { return {{"youngs_modulus", E}, {"poissons_ratio", nu}}; }

  double tensile_energy(const Matrix3& b) const {
    const double J = std::sqrt(b.determinant());
    const double shear = mu() / 2 * (std::pow(J, -2. / 3) * b.trace() - 3);
    return shear + (J >= 1 ? kappa() / 2 * ((J * J - 1) / 2 - std::log(J)) : 0);
  }
  Matrix3 kirchhoff(const Matrix3& b, double g) const {
    const double J = std::sqrt(b.determinant());
    const Matrix3 deviator = b - b.trace() / 3 * Matrix3::Identity();
    return g * mu() * std::pow(J, -2. / 3) * deviator + (J >= 1 ? g : 1) * kappa() / 2 * (J * J - 1) * Matrix3::Identity();
  }
};

constexpr double residual = 1e-3;  // of the stiffness of broken material
inline double degradation(double d) { return (1 - residual) * (1 - d) * (1 - d) + residual; }

inline config::PluginUse use(const std::string& id, const plugins::GivenParameters& parameters) {
  config::PluginUse law;
  law.id = id;
  law.parameters = parameters;
  return law;
}

/// A plane sheet of particles, some of them pulled. Material coordinates are those of `points`.
struct Sheet : PointScene {
  std::vector<Point> points;

  Sheet(double cell_size, std::vector<Point> given, const std::string& elasticity, const plugins::GivenParameters& moduli,
        double density, const config::PluginUse& damage)
      : PointScene(2, cell_size, given, elasticity, moduli, density), points(std::move(given)) {
    scene.materials[0].damage = damage;
    scene.simulation.precision = config::Precision::single_precision;
    scene.simulation.damage.tolerance = 1e-4;
  }

  /// Particles inside a box, turned by `angle` about the origin, move with `velocity`.
  void hold(const Vector3& center, const Vector3& size, const Vector3& velocity, double angle = 0) {
    config::Handle h;
    h.name = "handle-" + std::to_string(scene.handles.size());
    h.region.center = center;
    h.region.size = size;
    h.region.rotation = Eigen::AngleAxisd(angle, Vector3::UnitZ()).toRotationMatrix();
    h.motion.velocity = velocity;
    scene.handles.push_back(h);
  }
};

}  // namespace cleave::test
