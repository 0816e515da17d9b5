#include <cleave/projection.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace {
using namespace cleave;

/// Incompressible bodies: no change of volume in the mean of each grid cell z,
///
///   sum_(p in z) V_p div v(x_p) = c_z,      one row of B v = c for each cell
///
/// by the velocity that is M-nearest to what the forces make of it (Chorin's projection): a pressure, the multiplier of the
/// row, that is constant in each cell. One row for d velocities: nothing locks.
///
/// What an incompressible velocity gains of a volume, by det(I + dt grad v) - 1 being quadratic in dt, later steps take back:
/// c_z = -stabilization/dt sum_(p in z) (V_p - V_p^0), or the part of it for which they have the kinetic energy.
struct Incompressibility {
  static constexpr About about{.id = "constraint/incompressibility",
                               .version = "1.0.0",
                               .author = "Cleave",
                               .summary = "Bodies that keep their volume, as pressure solved for on the grid",
                               .source = "Chorin 1968, projection method; rows as in Wolper et al. 2020, AnisoMPM, section 6"};

  double tolerance, stabilization;
  int maximum_iterations;

  static constexpr auto parameters = describe(
      number(&Incompressibility::tolerance,
             {.key = "tolerance",
              .default_value = 1e-6,
              .valid = strictly_between(0, 1),
              .description = "rate of volume change that is left, relative to that without the constraint"}),
      number(&Incompressibility::stabilization, {.key = "stabilization",
                                                 .default_value = 0.3,
                                                 .valid = between(0, 1),
                                                 .description = "part of the volume gained or lost that a step takes back"}),
      integer(&Incompressibility::maximum_iterations, {.key = "maximum_iterations",
                                                       .default_value = 1000,
                                                       .valid = at_least(1),
                                                       .description = "of conjugate gradients in a step"}));

  ConstraintReport project(const cleave_constraint_system& system) {
    Projection projection(system, memory_);
    for (const auto& particles : particles_by_cell(system)) {
      double gain = 0;
      for (const std::uint64_t p : particles) gain += gained_volume(system, p);
      projection.begin_row(
          {.correction = -stabilization / system.time_step * gain, .cell = cell_of(system, particles.front())});
      for (const std::uint64_t p : particles) {
        const GradientWeights grad = gradient_weights(system, p);
        for (unsigned n = 0; n < grad.count; ++n) {
          std::array<double, 3> divergence = grad.value[n];
          for (double& component : divergence) component *= system.volume[p];
          projection.add(grad.node[n], divergence);
        }
      }
    }
    return projection.solve({.tolerance = tolerance, .maximum_iterations = std::uint32_t(maximum_iterations)});
  }

  std::vector<std::byte> save() const { return memory_.save(); }
  void restore(std::span<const std::byte> bytes) { memory_.restore(bytes); }

 private:
  /// V - V0 = V (1 - 1/|J|)
  static double gained_volume(const cleave_constraint_system& system, std::uint64_t particle) {
    const double* F = system.deformation + particle * 9;
    const double J =
        F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) + F[2] * (F[3] * F[7] - F[4] * F[6]);
    return J != 0 ? system.volume[particle] * (1 - 1 / std::abs(J)) : 0;
  }
  static std::array<std::int32_t, 3> cell_of(const cleave_constraint_system& system, std::uint64_t particle) {
    std::array<std::int32_t, 3> cell{};
    for (std::uint32_t a = 0; a < system.dimension; ++a)
      cell[a] = std::int32_t(std::floor(system.position[particle * system.dimension + a]));
    return cell;
  }

  ProjectionMemory memory_;
};

}  // namespace

CLEAVE_PLUGIN(Incompressibility)
