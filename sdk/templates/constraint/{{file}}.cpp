#include <cleave/projection.hpp>

namespace {
using namespace cleave;

/// Inextensible fibres. With a the unit vector along F a0, where a fibre a0 that moves with the material is at present,
///
///   sum over a cell's particles of V_p a . (grad v) a = 0      one row of B v = 0 for each cell  [Wolper et al. 2020, eqs. 14, 22]
///
/// Everything else is left to move: this projection takes away as little kinetic energy as it can, M-orthogonally.
/// The mean over a cell, and not each particle alone: otherwise there are more rows than velocities, and nothing can bend.
struct {{Type}} {
  static constexpr About about{.id = "{{kind}}/{{id}}",
                               .summary = "Fibres that keep their length",
                               .source = "Wolper et al. 2020, AnisoMPM, section 6"};
  static constexpr int fibers = 1;  // the scene gives a direction a0

  double tolerance;
  static constexpr auto parameters =
      describe(number(&{{Type}}::tolerance, {.key = "tolerance",
                                             .default_value = 1e-8,
                                             .valid = strictly_between(0, 1),
                                             .description = "rate of stretch that is left, relative to that without constraint"}));

  ConstraintReport project(const cleave_constraint_system& system) const {
    Projection projection(system);
    for (const auto& cell : particles_by_cell(system)) {
      projection.begin_row();
      for (const std::uint64_t p : cell) {
        const auto a = current_fiber(system, p);  // zero where there is no fibre: nothing is added
        const GradientWeights grad = gradient_weights(system, p);
        for (unsigned n = 0; n < grad.count; ++n) {
          const double along = a[0] * grad.value[n][0] + a[1] * grad.value[n][1] + a[2] * grad.value[n][2];
          const double weight = system.volume[p] * along;
          if (weight != 0) projection.add(grad.node[n], {weight * a[0], weight * a[1], weight * a[2]});
        }
      }
    }
    return projection.solve({.tolerance = tolerance});
  }
};

}  // namespace

CLEAVE_PLUGIN({{Type}})
