#include "fiber_rows.hpp"

#include <cleave/decompositions.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace {
using namespace cleave;

/// Inextensible fibres: no stretching along the fibres in the mean around each cell z,
///
///   B v = c,  B_(z, i alpha) = sum_p V_p Gamma_z(x_p) a_alpha (a . grad N_i(x_p))     [Wolper et al. 2020, eqs. 14, 22]
///
/// by the velocity that is M-nearest to what the forces make of it, which is a tension lambda in the fibres. If asked to, rows
/// are relaxed: B v + epsilon D lambda = c, D the diagonal of B M^-1 B^T.
///
/// c = 0 keeps the length but for the second order of the step: a fibre that turns by an angle of tangent dt q, q = |C a - (a .
/// C a) a|, gets longer. With
///
///   c_z = sum_p V_p Gamma_z(x_p) s_p,   (1 + dt s_p)^2 + (dt q_p)^2 = 1
///
/// its end is at the distance it was at, |(I + dt C) a| = 1, as SHAKE holds bonds [Ryckaert, Ciccotti & Berendsen 1977]; q is
/// that of the step before.
///
/// Strain that has come about all the same is taken back at the rate c_z = -s/dt sum_p V_p Gamma_z(x_p) ln|F a0| [Baumgarte
/// 1972], in so far as that makes no kinetic energy.
struct Inextensibility {
  static constexpr About about{.id = "constraint/inextensibility",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Fibres that keep their length, as tension solved for on the grid",
                               .source = "Wolper et al. 2020, AnisoMPM, section 6"};
  static constexpr int fibers = 1;

  enum Transport { convected, rotated };
  Transport fiber_transport;
  enum Kept { keep_length, keep_rate };
  Kept kept;
  inextensibility::Multipliers multipliers;
  double tolerance, relaxation, stabilization, breaking_damage;
  int maximum_iterations, factor_memory;

  static constexpr auto parameters = describe(
      choice(&Inextensibility::fiber_transport,
             {.key = "fiber_transport",
              .choices = {"convected", "rotated"},
              .default_value = "convected",
              .description = "where fibres a0 point to: along F a0, or R a0 with the rotation R of F = R S"}),
      choice(
          &Inextensibility::kept,
          {.key = "kept",
           .choices = {"length", "rate"},
           .default_value = "length",
           .description = "what steps keep: the length of a fibre to the end of the step, which turns it, or no more than the "
                          "rate of stretch zero at its beginning"}),
      choice(&Inextensibility::multipliers,
             {.key = "multipliers",
              .choices = {"staggered", "centred"},
              .default_value = "staggered",
              .description = "where tensions are: at the middle of cells along the fibres and at nodes across them, or at the "
                             "centres of cells"}),
      number(&Inextensibility::tolerance,
             {.key = "tolerance",
              .default_value = 1e-6,
              .valid = strictly_between(0, 1),
              .description = "rate of stretch that is left, relative to that without the constraint"}),
      number(&Inextensibility::relaxation, {.key = "relaxation",
                                            .default_value = 0,
                                            .valid = non_negative,
                                            .description = "epsilon, compliance of the rows relative to their diagonal"}),
      number(&Inextensibility::stabilization, {.key = "stabilization",
                                               .default_value = 0.1,
                                               .valid = between(0, 1),
                                               .description = "part of the elongation there is that a step takes back"}),
      number(&Inextensibility::breaking_damage,
             {.key = "breaking_damage",
              .default_value = 1,
              .valid = between(0, 1),
              .description = "damage above which fibres are broken; 1: they hold whatever breaks around them"}),
      integer(&Inextensibility::maximum_iterations, {.key = "maximum_iterations",
                                                     .default_value = 1000,
                                                     .valid = at_least(1),
                                                     .description = "of conjugate gradients in a step"}),
      integer(&Inextensibility::factor_memory,
              {.key = "factor_memory",
               .unit = "MiB",
               .default_value = 256,
               .valid = non_negative,
               .description = "what complete factors of the rows may take; beyond it they are incomplete"}));

  ConstraintReport project(const cleave_constraint_system& system) {
    return system.dimension == 3 ? project<3>(system) : project<2>(system);
  }

  std::vector<std::byte> save() const { return memory_.save(); }
  void restore(std::span<const std::byte> bytes) { memory_.restore(bytes); }

 private:
  template <unsigned D>
  ConstraintReport project(const cleave_constraint_system& system) {
    inextensibility::FiberRows<D> rows(system, multipliers);
    for (std::uint64_t p = 0; p < system.particle_count; ++p) {
      if (damage_of(system, p) > breaking_damage) continue;
      const double *F = system.deformation + p * 9, *a0 = system.fiber + p * 3;
      std::array<double, 3> stretched{};
      for (unsigned i = 0; i < 3; ++i)
        for (unsigned j = 0; j < 3; ++j) stretched[i] += F[3 * i + j] * a0[j];
      std::array<double, 3> a = stretched;
      if (fiber_transport == rotated) {
        Matrix3<double> deformation;
        for (unsigned i = 0; i < 9; ++i) deformation(i / 3, i % 3) = F[i];
        const Matrix3<double> R = polar(deformation).rotation;
        for (unsigned i = 0; i < 3; ++i) a[i] = R(i, 0) * a0[0] + R(i, 1) * a0[1] + R(i, 2) * a0[2];
      }
      const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
      if (!(length > 0)) continue;
      for (double& component : a) component /= length;
      const double rest = std::sqrt(a0[0] * a0[0] + a0[1] * a0[1] + a0[2] * a0[2]);
      const double along = (a[0] * stretched[0] + a[1] * stretched[1] + a[2] * stretched[2]) / rest;
      rows.add(p, a, kept == keep_length ? stretching<D>(system, p, a) : 0,
               along > 0 ? std::log(along) : 0);  // turned over, it has no length to go back to
    }
    Projection projection(system, memory_);
    rows.write(projection, stabilization / system.time_step);
    ConstraintReport report = projection.solve({.tolerance = tolerance,
                                                .maximum_iterations = std::uint32_t(maximum_iterations),
                                                .relaxation = relaxation,
                                                .factor_bytes = std::size_t(factor_memory) << 20});
    if (report.residual > tolerance)
      report.notice = "the fibres are held to a residual of " + std::to_string(report.residual) + " only, after " +
                      std::to_string(report.iterations) +
                      " iterations: rows contradict each other or what is prescribed, or relaxation is too small";
    return report;
  }

  /// Of the unit fibre a, the rate that keeps its length over a step in which it turns as in the one before.
  template <unsigned D>
  static double stretching(const cleave_constraint_system& system, std::uint64_t particle, const std::array<double, 3>& a) {
    const double* C = system.velocity_gradient + particle * D * D;
    double along = 0, squared = 0;
    for (unsigned i = 0; i < D; ++i) {
      double change = 0;
      for (unsigned j = 0; j < D; ++j) change += C[i * D + j] * a[j];
      along += a[i] * change;
      squared += change * change;
    }
    const double dt = system.time_step, turn = dt * dt * std::max(0.0, squared - along * along);
    return turn < 1 ? -turn / (dt * (1 + std::sqrt(1 - turn))) : -1 / dt;
  }

  ProjectionMemory memory_;
};

}  // namespace

CLEAVE_PLUGIN(Inextensibility)
