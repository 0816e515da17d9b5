#pragma once

#include "../mpm/scenes.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

namespace cleave::test {

/// A split neo-Hookean solid, for which the formulas of the plugins are written out again here.
struct Solid {
  double E = 1e4, nu = 0.3;
  double mu() const { return E / (2 * (1 + nu)); }
  double kappa() const { return E / (3 * (1 - 2 * nu)); }
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

inline double degradation(double d, double residual) { return (1 - residual) * (1 - d) * (1 - d) + residual; }

/// Phase-field damage (Wolper et al. 2019, eq. 6): D = 4 l0 (1 - r) psi_plus/G, eta = 1/M_c, l = 2 l0.
struct PhaseField {
  double G = 1, l0 = 0.1, eta = 0.01, residual = 1e-3;
  bool explicitly = false;
  double length() const { return 2 * l0; }
  double driving_force(double tensile_energy) const { return 4 * l0 * (1 - residual) * tensile_energy / G; }
  /// The energy density that drives damage with a force D.
  double energy(double D) const { return D * G / (4 * l0 * (1 - residual)); }
  plugins::GivenParameters parameters() const {
    return {{"energy_release_rate", G},
            {"length_scale", l0},
            {"mobility", 1 / eta},
            {"residual", residual},
            {"integration", std::string(explicitly ? "explicit" : "implicit")}};
  }
};

inline config::PluginUse use(const std::string& id, const plugins::GivenParameters& parameters) {
  config::PluginUse law;
  law.id = id;
  law.parameters = parameters;
  return law;
}

struct DamageScene : PointScene {
  DamageScene(int dimension, double cell_size, const std::vector<Point>& points, const Solid& solid, const PhaseField& law,
              double density = 1000)
      : PointScene(dimension, cell_size, points, "elasticity/split-neo-hookean", solid.moduli(), density) {
    scene.materials[0].damage = use("damage/phase-field", law.parameters());
    scene.simulation.damage.tolerance = 1e-10;
  }

  /// Particles with low <= x <= high move with this velocity.
  void hold(double low, double high, const Vector3& velocity = Vector3::Zero()) {
    config::Handle h;
    h.name = "handle-" + std::to_string(scene.handles.size());
    h.region.center = Vector3((low + high) / 2, 0, 0);
    h.region.size = Vector3(high - low, 1e3, 1e3);
    h.motion.velocity = velocity;
    scene.handles.push_back(h);
  }
};

/// The uniform strain F = diag(s, 1, 1) whose tensile energy is `energy`.
inline Matrix3 stretched_to(const Solid& solid, double energy) {
  double low = 1, high = 2;
  const auto at = [&](double s) { return solid.tensile_energy(Vector3(s * s, 1, 1).asDiagonal()); };
  while (at(high) < energy) high *= 2;
  for (int i = 0; i < 200; i++) (at((low + high) / 2) < energy ? low : high) = (low + high) / 2;
  return Vector3((low + high) / 2, 1, 1).asDiagonal();
}

inline void run(mpm::Simulation& simulation, double end) {
  while (simulation.time() < end) simulation.step(end);
}

inline std::string failure_of(const DamageScene& scene, int steps = 0) {
  try {
    const auto simulation = scene.start();
    for (int i = 0; i < steps; i++) simulation->step(1e9);
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

}  // namespace cleave::test
