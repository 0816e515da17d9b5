#include "return_mapping.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>

// The yield surface: what is returned lies on it, and what lies inside stays as it is.

namespace cleave::testkit {
namespace {

using namespace plasticity;

void admissible(Context& context) {
  for_each_mapping(context, Forms::widest, [&](const Instance& instance, const Mapping& map, Random& random) -> std::string {
    if (const auto why_not = excuse(instance, map); !why_not.empty()) return why_not;
    const Points trials = random_trials(map, random, 400);
    const Returned first = map(trials);

    const auto inside = interior(map, random);
    if (!inside) return "every trial yields, also at strains of 1e-6";

    // On the surface is what is elastic a tiny bit further in, and what yields a bit further back to the trial.
    const double out = map.is_single() ? 0.05 : 1e-3, smallest_return = map.is_single() ? 1e-2 : 1e-5;
    Points inner{first.points.strain, trials.state}, outer = inner;
    std::vector<bool> has_outer(trials.size(), false);
    bool any_yields = false;
    for (std::uint32_t k = 0; k < trials.size(); ++k) {
      if (!first.yielded[k] || !first.valid(k)) continue;
      any_yields = true;
      const std::vector<double>& strain = first.points.strain[k];
      const Symmetric3 e = logarithmic_strain(map.b(strain)), back = sum(logarithmic_strain(map.b(trials.strain[k])), e, -1);
      inner.strain[k] = inward(map, strain, *inside);
      has_outer[k] = norm(back) > smallest_return;
      if (has_outer[k]) outer.strain[k] = map.moved(strain, back, out);
    }
    if (!any_yields) return nothing_yields;
    // Hardening may count from the next step on: the surface is that of the state before or after.
    const Returned inner_old = map(inner), inner_new = map({inner.strain, first.points.state});
    const Returned outer_old = map(outer), outer_new = map({outer.strain, first.points.state});
    for (std::uint32_t k = 0; k < trials.size(); ++k) {
      if (!first.yielded[k] || !first.valid(k)) continue;
      const bool in_old = inner_old.elastic(k), in_new = inner_new.elastic(k);
      if (!in_old && !in_new)
        context.fail("a returned state is not admissible: moved a tiny bit towards elastic ones it still yields; trial " +
                     map.words(trials, k) + " returned to " + map.words(first.points, k));
      if (has_outer[k] && !(in_old && outer_old.yielded[k]) && !(in_new && outer_new.yielded[k]))
        context.fail("a returned state lies inside of the yield surface: " + short_text(100 * out) +
                     " % of the way back to its trial is elastic; trial " + map.words(trials, k) + " returned to " +
                     map.words(first.points, k));
    }

    // The elastic domain is convex: from rest on, along a ray of logarithmic strain, what has yielded goes on to yield.
    constexpr int rays = 64, steps = 48;
    Points along;
    for (int ray = 0; ray < rays; ++ray) {
      Vector3 direction;
      for (double& x : direction) x = random.uniform(-1, 1);
      const Matrix3 left = random.rotation(), right = random.rotation();
      for (int step = 0; step < steps; ++step) {
        const double t = (map.is_single() ? 1e-3 : 1e-5) * std::pow(map.is_single() ? 6e2 : 6e4, step / (steps - 1.0));
        map.add(along, {t * direction[0], t * direction[1], t * direction[2]}, left, right);
      }
    }
    Points rest;
    map.add(rest, {0, 0, 0}, identity(), identity());
    if (map(rest).yielded[0]) return {};
    const Returned scan = map(along);
    for (std::uint32_t k = 1; k < along.size(); ++k)
      if (k % steps && scan.valid(k) && scan.yielded[k - 1] && !scan.yielded[k])
        context.fail("a state is not returned although one of less strain is: " + map.words(along, k) + " after " +
                     map.words(along, k - 1));
    return {};
  });
}

void projection(Context& context) {
  for_each_mapping(context, Forms::all, [&](const Instance& instance, const Mapping& map, Random& random) -> std::string {
    if (const auto why_not = excuse(instance, map); !why_not.empty()) return why_not;
    const Points trials = further_trials(map, random, 400);
    const Returned first = map(trials);
    const SecondReturn second(map, trials, first);
    bool any_yields = false;
    for (std::uint32_t k = 0; k < trials.size(); ++k) {
      if (!first.yielded[k] || !first.valid(k)) continue;
      any_yields = true;
      const auto change = [&](const Returned& again, const Points& given) {
        if (!again.valid(k)) return std::numeric_limits<double>::infinity();
        return std::max(largest_change(first.points.strain[k], again.points.strain[k]),
                        largest_change(given.state[k], again.points.state[k]));
      };
      const double changed = std::min(change(second.with_old, trials), change(second.with_new, first.points));
      if (!(changed <= (map.is_single() ? 2e-4 : 1e-10)))
        context.fail("a second return goes on: it changes strain or state by " + short_text(changed) + "; trial " +
                     map.words(trials, k));
    }
    return any_yields ? std::string() : nothing_yields;
  });
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

void elastic_untouched(Context& context) {
  for_each_mapping(context, Forms::all, [&](const Instance&, const Mapping& map, Random& random) -> std::string {
    bool any_elastic = false;
    for (double spread : {1.0, 0.1, 0.01, 1e-4}) {
      const Points trials = further_trials(map, random, 200, spread);
      const Returned returned = map(trials);
      for (std::uint32_t k = 0; k < trials.size(); ++k) {
        if (returned.yielded[k] || !returned.valid(k)) continue;
        any_elastic = true;
        if (!same_bits(returned.points.strain[k], trials.strain[k]))
          context.fail("changes the strain of a state that it says does not yield: " + map.words(trials, k) + " becomes " +
                       digits(returned.points.strain[k]));
        if (!same_bits(returned.points.state[k], trials.state[k]))
          context.fail("changes the state variables of a point that it says does not yield: " + map.words(trials, k) +
                       " becomes " + digits(returned.points.state[k]));
      }
    }
    return any_elastic ? std::string() : "every trial yields, also at strains of 1e-5";
  });
}

/// |tau| by which a second return moves a returned state.
double stress_moved(const Mapping& map, const Points& from, const Returned& to, std::uint32_t k) {
  if (!to.valid(k)) return std::numeric_limits<double>::infinity();
  return norm(sum(stress(map.b(from.strain[k])), stress(map.b(to.points.strain[k])), -1));
}

/// Trials at the tips, apexes and corners of yield surfaces, and far away from everything.
Points hard_trials(const Mapping& map, Random& random, std::uint32_t count) {
  Points trials;
  for (std::uint32_t k = 0; k < count; ++k) {
    const double size = std::exp(random.uniform(-16, random.below(4) ? 0 : 2));
    Vector3 e;
    switch (random.below(6)) {
      case 0:  // volume alone
        e.fill(random.uniform(-size, size));
        break;
      case 1: {  // nearly so
        e.fill(random.uniform(-size, size));
        e[std::size_t(random.below(3))] += size * std::exp(random.uniform(-30, -5));
        break;
      }
      case 2: {  // two equal stretches
        e.fill(random.uniform(-size, size));
        e[std::size_t(random.below(3))] = random.uniform(-size, size);
        break;
      }
      case 3:  // shear alone
        e = {size, random.below(2) ? 0 : size, 0};
        e[2] = -(e[0] + e[1]);
        break;
      default:
        for (double& x : e) x = random.uniform(-size, size);
    }
    const Matrix3 left = random.rotation(), right = random.rotation();
    const bool aligned = random.below(3) == 0;
    map.add(trials, e, aligned ? identity() : left, aligned ? identity() : right);
  }
  return trials;
}

void corners(Context& context) {
  const std::vector<Settings> base = all_settings(context);
  constexpr std::uint32_t count = 512;
  context.random_cases(200, [&](Random& random) {
    Settings settings = base[std::size_t(random.below(int(base.size())))];
    for (auto& [key, value] : settings)
      if (random.below(2) && std::holds_alternative<double>(value))
        value = typical_value(*find(context.plugin().schema(), key), random.uniform(), 0.01 * Material::youngs_modulus);
    std::unique_ptr<Instance> instance;
    try {
      instance = std::make_unique<Instance>(context.plugin(), settings);
    } catch (const Failed&) {
      return;  // values that do not go together
    }
    const auto all_precisions = precisions(context.plugin());
    const auto all_measures = measures(*instance);
    const Precision precision = all_precisions[std::size_t(random.below(int(all_precisions.size())))];
    const Mapping map(*instance, precision, all_measures[std::size_t(random.below(int(all_measures.size())))]);
    const std::string where = "; " + map.form() + ", with " + text(settings);
    context.doing("returning 512 trials in " + where.substr(2));

    const Returned before = map(hard_trials(map, random, count));
    Points trials = hard_trials(map, random, count);
    for (std::uint32_t k = 0; k < count; k += 2)
      if (before.status[k] == CLEAVE_STATUS_OK) trials.state[k] = before.points.state[k];
    const Returned first = map(trials);
    for (std::uint32_t k = 0; k < count; ++k) {
      if (!first.valid(k)) continue;
      for (const auto& values : {first.points.strain[k], first.points.state[k]})
        for (double value : values)
          if (!std::isfinite(value))
            context.fail("a returned strain or state is not finite, and no status says so; trial " + map.words(trials, k) +
                         where);
    }
    if (!excuse(*instance, map).empty()) return;
    const SecondReturn second(map, trials, first);
    // Where the surface is steep, rounding in p moves q by far more than it puts the state beyond the surface.
    const auto inside = interior(map, random);
    Points inner = first.points;
    for (std::uint32_t k = 0; inside && k < count; ++k)
      if (first.yielded[k] && first.valid(k)) inner.strain[k] = inward(map, inner.strain[k], *inside);
    const Returned inner_old = map({inner.strain, trials.state}), inner_new = map(inner);
    for (std::uint32_t k = 0; k < count; ++k) {
      if (!first.yielded[k] || first.status[k] != CLEAVE_STATUS_OK) continue;
      if (inside && (inner_old.elastic(k) || inner_new.elastic(k))) continue;
      // Where b is known too coarsely its stress means nothing.
      const Symmetric3 trial = map.b(trials.strain[k]), b = map.b(first.points.strain[k]);
      if (!(condition(trial) <= (map.is_single() ? 30 : 1e6))) continue;
      const double moved =
          std::min(stress_moved(map, first.points, second.with_old, k), stress_moved(map, first.points, second.with_new, k));
      if (!(moved <= stress_tolerance(map, trial, b)))
        context.fail("a returned state is not admissible: returned again, its stress moves by " + short_text(moved) +
                     " Pa of " + short_text(norm(stress(b))) + " Pa; trial " + map.words(trials, k) + where);
    }
  });
}

}  // namespace

std::vector<Check> plasticity_checks() {
  return {
      {"plasticity.admissible", 34,
       "Returned states lie on the yield surface, to 1e-8 of their stress; all beyond it is returned.", plasticity_kind,
       admissible},
      {"plasticity.projection", 35, "A second return changes neither strain nor state.", plasticity_kind, projection},
      {"plasticity.elastic-untouched", 36, "A trial that does not yield keeps strain and state to the bit.", plasticity_kind,
       elastic_untouched},
      {"plasticity.corners", 40,
       "100000 trials at tips, apexes, corners and far away give finite, admissible states or a status that says otherwise.",
       plasticity_kind, corners},
  };
}

}  // namespace cleave::testkit
