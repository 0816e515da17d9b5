// Local damage by the stress beyond a critical one, whole except for the defect the environment names (defects.def).
//
//   d = max over the past of <1 - sigma_c/|s|>
#include <cleave/damage.hpp>

#include "kit/broken.hpp"

namespace {
using namespace cleave;

struct BrokenLocalDamage {
  static constexpr About about{.id = "damage/local-fixture", .summary = "Local damage, to be broken"};
  static constexpr DamageInputs inputs{.effective_stress = true};
  static constexpr bool isotropic = true;
  static constexpr bool local = true;

  double critical_stress;

  static constexpr auto parameters = describe(
      number(&BrokenLocalDamage::critical_stress,
             {.key = "critical_stress", .unit = "Pa", .valid = positive, .description = "sigma_c, where damage begins"}));

  template <class T, class Point>
  Damaged<T> damage(const Point& point, const std::array<T, 0>&) const {
    const T critical = critical_stress * point.toughness, stress = norm(point.effective_stress);
    T softened = 1 - critical / max(stress, critical);
    if (broken("damage_above_one")) softened = 2 * softened;
    if (broken("damage_heals")) return {softened, {}};
    if (broken("softens_by_steps")) return {point.damage + (1 - point.damage) * softened, {}};
    return {max(softened, point.damage), {}};
  }

  DamageModel model() const { return {.residual = 0.001}; }
};

}  // namespace

CLEAVE_PLUGIN(BrokenLocalDamage)
