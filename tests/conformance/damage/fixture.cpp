// Damage driven by the stress beyond a critical one, whole except for the defect the environment names (defects.def).
//
//   D = max over the past of <|s|^2/sigma_c^2 - 1>
#include <cleave/damage.hpp>

#include "kit/broken.hpp"

#include <cmath>

namespace {
using namespace cleave;

struct BrokenDamage {
  static constexpr About about{.id = "damage/fixture", .summary = "Stress-driven damage, to be broken", .budget = 20};
  static constexpr DamageInputs inputs{.effective_stress = true};

  double critical_stress, viscosity;

  static constexpr auto parameters = describe(
      number(&BrokenDamage::critical_stress,
             {.key = "critical_stress", .unit = "Pa", .valid = positive, .description = "sigma_c, where damage begins"}),
      number(&BrokenDamage::viscosity,
             {.key = "viscosity", .unit = "s", .default_value = 1e-3, .valid = positive, .description = "eta"}));
  static constexpr auto states = describe(
      scalar_state({.name = "history", .change = Change::never_decreases, .description = "largest driving force so far"}));

  template <class T, class Point>
  Driven<T, 1> drive(const Point& point, const std::array<T, 1>& state) const {
    if (broken("slow")) burn(4000);
    if (broken("over_budget")) burn(30);
    const Symmetric3<T>& s = point.effective_stress;
    const T critical = critical_stress * point.toughness;
    const T squared = squared_norm(s) + (broken("not_objective") ? s[0] * s[0] : T(0));
    const auto may_drive = !(squared <= critical * critical);
    const bool forgets = broken("forgets_history"), ignores = broken("ignores_history");
    if (none(may_drive)) {
      const T nothing = T(0) * state[0];
      if (ignores) return {nothing, {state[0]}};
      return driven(forgets ? nothing : state[0], point.time_step);
    }
    const T excess = select(may_drive, squared / (critical * critical) - 1, T(0));
    if (forgets) return driven(excess, point.time_step);
    if (ignores) return {excess, {max(excess, state[0])}};
    if (broken("accumulates")) return driven(state[0] + excess, point.time_step);
    const T kept = broken("early_out_differs") ? state[0] * T(1.000001) : state[0];
    return driven(select(may_drive, max(excess, state[0]), kept), point.time_step);
  }

  DamageModel model() const {
    DamageModel model{.viscosity = viscosity, .length = 0.01, .residual = 0.001};
    if (broken("residual_out_of_range")) model.residual = 1;
    if (broken("negative_viscosity")) model.viscosity = -viscosity;
    return model;
  }

 private:
  template <class T>
  static Driven<T, 1> driven(const T& history, double time_step) {
    T force = history;
    if (broken("negative_force")) force = history - 0.1;
    if (broken("drives_at_rest")) force = history + 0.01;
    if (broken("per_time_step")) force = history * T(1e4 * time_step);
    return {force, {history}};
  }

  /// A thousand turns take a few microseconds for each point.
  static void burn(int turns) {
    volatile double x = 0;
    for (int i = 0; i < turns; ++i) x = std::sqrt(x + 2);
  }
};

}  // namespace

CLEAVE_PLUGIN(BrokenDamage)
