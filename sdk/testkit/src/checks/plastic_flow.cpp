#include "return_mapping.hpp"

#include <algorithm>
#include <cmath>

// Plastic flow: what a return may do to volume, energy, axes and state variables.

namespace cleave::testkit {
namespace {

using namespace plasticity;

void isochoric_flow(Context& context) {
  for_each_mapping(context, Forms::all, [&](const Instance& instance, const Mapping& map, Random& random) -> std::string {
    if (!(guarantees(instance) & CLEAVE_RETURN_KEEPS_VOLUME)) return "flow may change the volume";
    bool any_yields = false;
    for (double spread : {1.0, 4.0}) {
      const Points trials = further_trials(map, random, 300, spread);
      const Returned returned = map(trials);
      for (std::uint32_t k = 0; k < trials.size(); ++k) {
        if (!returned.yielded[k] || !returned.valid(k)) continue;
        any_yields = true;
        const Symmetric3 trial = map.b(trials.strain[k]);
        const double ratio = determinant(full(map.b(returned.points.strain[k]))) / determinant(full(trial)) - 1;
        if (!(std::abs(ratio) <= (map.is_single() ? 1e-5 : 1e-12) * condition(trial)))
          context.fail("the return keeps the volume, as is declared, but det b changes by " + short_text(ratio) +
                       " of its value; trial " + map.words(trials, k));
      }
    }
    return any_yields ? std::string() : nothing_yields;
  });
}

/// tau : d(eps_plastic), d(eps_plastic) = (ln b_trial - ln b_returned)/2 [J/m^3]
struct Dissipation {
  double work, rounding;
};
Dissipation dissipation(const Mapping& map, const Symmetric3& trial, const Symmetric3& returned) {
  const Symmetric3 tau = stress(returned), flow = sum(logarithmic_strain(trial), logarithmic_strain(returned), -1);
  const double tolerance = stress_tolerance(map, trial, returned);
  return {dot(full(tau), full(flow)), tolerance * norm(flow) + 64 * map.rounding() * norm(tau)};
}

void dissipates(Context& context) {
  for_each_mapping(context, Forms::widest, [&](const Instance& instance, const Mapping& map, Random& random) -> std::string {
    if (!(guarantees(instance) & CLEAVE_RETURN_IS_CONSISTENT)) return "its return is not declared consistent";
    bool any_yields = false;
    for (double spread : {1.0, 4.0}) {
      const Points trials = random_trials(map, random, 300, spread);
      const Returned returned = map(trials);
      for (std::uint32_t k = 0; k < trials.size(); ++k) {
        if (!returned.yielded[k] || !returned.valid(k)) continue;
        any_yields = true;
        const auto [work, rounding] = dissipation(map, map.b(trials.strain[k]), map.b(returned.points.strain[k]));
        if (!(work >= -rounding))
          context.fail("the plastic flow of a virgin point does the work of " + short_text(work) +
                       " J/m^3, which must not be negative; trial " + map.words(trials, k));
      }
    }
    if (!any_yields) return nothing_yields;

    // What hardening stores may come back, but no more than was put in.
    constexpr int steps = 60;
    Points points = random_trials(map, random, 64, 0.1);
    std::vector<double> work(points.size(), 0), rounding(points.size(), 0);
    for (int step = 0; step < steps; ++step) {
      for (std::uint32_t k = 0; k < points.size(); ++k) {
        Matrix3 f = identity();
        for (double& x : f) x += random.uniform(-0.03, 0.03);
        points.strain[k] = map.seen(map.of_b() ? numbers(turned(f, read<6>(points.strain[k])))
                                               : numbers(product(f, read<9>(points.strain[k]))));
      }
      const Returned returned = map(points);
      for (std::uint32_t k = 0; k < points.size(); ++k) {
        if (!returned.valid(k)) {
          points.strain[k] = map.strain(identity());
          continue;
        }
        if (returned.yielded[k]) {
          const auto more = dissipation(map, map.b(points.strain[k]), map.b(returned.points.strain[k]));
          work[k] += more.work;
          rounding[k] += more.rounding;
          if (!(work[k] >= -rounding[k]))
            context.fail("along a path of " + std::to_string(step + 1) +
                         " steps plastic flow gives back more than it took: its " + "work is " + short_text(work[k]) +
                         " J/m^3; last trial " + map.words(points, k));
        }
        points.strain[k] = returned.points.strain[k];
        points.state[k] = returned.points.state[k];
      }
    }
    return {};
  });
}

void isotropic(Context& context) {
  if (!context.plugin().can(CLEAVE_ISOTROPIC)) context.skip("not declared isotropic");
  for_each_mapping(context, Forms::all, [&](const Instance&, const Mapping& map, Random& random) -> std::string {
    const double tolerance = map.is_single() ? 5e-5 : 1e-10;
    const Points trials = further_trials(map, random, 300);
    const Returned returned = map(trials);
    // Of the space around, and of the material.
    for (bool of_material : {false, true}) {
      if (of_material && map.of_b()) continue;
      std::vector<Matrix3> Q;
      Points rotated = trials;
      const auto rotate = [&](std::uint32_t k, const std::vector<double>& strain) {
        if (map.of_b()) return numbers(turned(Q[k], read<6>(strain)));
        return numbers(of_material ? product(read<9>(strain), Q[k]) : product(Q[k], read<9>(strain)));
      };
      for (std::uint32_t k = 0; k < trials.size(); ++k) {
        Q.push_back(random.rotation());
        rotated.strain[k] = map.seen(rotate(k, trials.strain[k]));
      }
      const Returned other = map(rotated);
      for (std::uint32_t k = 0; k < trials.size(); ++k) {
        if (!returned.valid(k) && !other.valid(k)) continue;
        if (returned.valid(k) != other.valid(k)) context.fail("a rotation changes the status; trial " + map.words(trials, k));
        const double apart = std::max(largest_change(rotate(k, returned.points.strain[k]), other.points.strain[k]),
                                      largest_change(returned.points.state[k], other.points.state[k]));
        if (!(apart <= tolerance))
          context.fail(std::string("the return does not commute with a rotation of the ") +
                       (of_material ? "material" : "trial state") + ": strain or state differ by " + short_text(apart) +
                       "; trial " + map.words(trials, k));
      }
    }
    for (std::uint32_t k = 0; k < trials.size(); ++k) {
      if (!returned.valid(k)) continue;
      const Matrix3 trial = full(map.b(trials.strain[k])), after = full(map.b(returned.points.strain[k]));
      const double apart = norm(sum(product(trial, after), product(after, trial), -1)) / (norm(trial) * norm(after));
      if (!(apart <= tolerance))
        context.fail("the eigenvectors of b change: b_trial and b_returned commute but for " + short_text(apart) + "; trial " +
                     map.words(trials, k));
    }
    return {};
  });
}

void hardening_direction(Context& context) {
  const cleave_schema& schema = context.plugin().schema();
  if (!schema.state_count) context.skip("no state variables");
  std::vector<const cleave_state_schema*> component;
  for (std::uint32_t i = 0; i < schema.state_count; ++i)
    component.insert(component.end(), schema.states[i]->tensor, schema.states[i]);
  for_each_mapping(context, Forms::all, [&](const Instance&, const Mapping& map, Random& random) -> std::string {
    const auto change = [&](const Points& from, const Returned& to, std::uint32_t k, std::size_t i) {
      const double before = from.state[k][i], after = to.points.state[k][i];
      const double unit = map.is_single() ? 1e-5 : 1e-12;
      return std::abs(after - before) <= unit * (1 + std::abs(before)) ? 0.0 : after - before;
    };
    for (double spread : {1.0, 4.0}) {
      const Points trials = further_trials(map, random, 400, spread);
      const Returned returned = map(trials);
      for (std::uint32_t k = 0; k < trials.size(); ++k)
        for (std::size_t i = 0; returned.valid(k) && i < component.size(); ++i) {
          const double by = change(trials, returned, k, i);
          const bool up = component[i]->monotonicity == CLEAVE_NEVER_DECREASES;
          const bool down = component[i]->monotonicity == CLEAVE_NEVER_INCREASES;
          if ((up && by < 0) || (down && by > 0))
            context.fail(std::string(component[i]->name) + " is declared to never " + (up ? "decrease" : "increase") +
                         ", and changes by " + short_text(by) + "; trial " + map.words(trials, k));
        }
    }
    // From the initial state along rays of compression, of extension and of shear: one direction on each.
    constexpr int steps = 40;
    for (int branch = 0; branch < 10; ++branch) {
      Vector3 e;
      for (double& x : e) x = branch == 0 ? -1 : branch == 1 ? 1 : random.uniform(-1, 1);
      const double mean = (e[0] + e[1] + e[2]) / 3;
      if (branch > 1)
        for (double& x : e) x -= mean;
      const Matrix3 left = random.rotation(), right = random.rotation();
      Points ray;
      for (int step = 0; step < steps; ++step) {
        const double t = 1e-3 * std::pow(400, step / (steps - 1.0));
        map.add(ray, {t * e[0], t * e[1], t * e[2]}, left, right);
      }
      const Returned returned = map(ray);
      for (std::size_t i = 0; i < component.size() && component[i]->tensor == CLEAVE_SCALAR; ++i) {
        double direction = 0;
        for (std::uint32_t k = 0; k < ray.size(); ++k) {
          if (!returned.valid(k)) continue;
          const double by = change(ray, returned, k, i);
          if (by * direction < 0)
            context.fail(std::string(component[i]->name) + (direction > 0 ? " rises" : " falls") + " under little " +
                         (branch == 0   ? "compression"
                          : branch == 1 ? "extension"
                                        : "shear") +
                         ", and the other way, by " + short_text(by) + ", under more: trial " + map.words(ray, k));
          if (by != 0) direction = by;
        }
      }
    }
    return {};
  });
}

Matrix3 inverse(const Matrix3& a) {
  const double J = determinant(a);
  Matrix3 b;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t p = (j + 1) % 3, q = (j + 2) % 3, r = (i + 1) % 3, s = (i + 2) % 3;
      b[3 * i + j] = (a[3 * p + r] * a[3 * q + s] - a[3 * p + s] * a[3 * q + r]) / J;
    }
  return b;
}

void b_and_F(Context& context) {
  if (!context.plugin().can(CLEAVE_ACCEPTS_B) || !context.plugin().can(CLEAVE_ACCEPTS_F))
    context.skip("accepts one strain measure only");
  for_each_mapping(context, Forms::all, [&](const Instance& instance, const Mapping& of_F, Random& random) -> std::string {
    if (of_F.of_b()) return "asked for F";
    const Mapping of_b(instance, of_F.is_single() ? Precision::single_precision : Precision::double_precision, "b");
    const double tolerance = of_F.is_single() ? 5e-5 : 1e-10;
    for (double spread : {1.0, 3.0}) {
      const Points trials = further_trials(of_F, random, 300, spread);
      Points squared{{}, trials.state};
      for (const auto& F : trials.strain) squared.strain.push_back(of_b.strain(read<9>(F)));
      const Returned from_F = of_F(trials), from_b = of_b(squared);
      for (std::uint32_t k = 0; k < trials.size(); ++k) {
        if (!from_F.valid(k) && !from_b.valid(k)) continue;
        if (from_F.valid(k) != from_b.valid(k)) context.fail("only one form has a result; trial " + of_F.words(trials, k));
        const Matrix3 F = read<9>(trials.strain[k]), F_new = read<9>(from_F.points.strain[k]);
        const double apart = std::max(largest_change(from_b.points.strain[k], numbers(left_cauchy_green(F_new))),
                                      largest_change(from_b.points.state[k], from_F.points.state[k]));
        const double allowed = tolerance * condition(left_cauchy_green(F));
        if (!(apart <= allowed))
          context.fail("the forms of b and F disagree by " + short_text(apart) +
                       ": F F^T = " + digits(numbers(left_cauchy_green(F_new))) + ", b = " + digits(from_b.points.strain[k]) +
                       "; trial " + of_F.words(trials, k));
        const Matrix3 V = product(F_new, inverse(F));
        const double turn = norm(sum(V, transpose(V), -1)) / norm(V);
        if (!(turn <= allowed))
          context.fail("F is turned by the return: F_new F_trial^-1 is not symmetric, by " + short_text(turn) +
                       " of its size; trial " + of_F.words(trials, k));
      }
    }
    return {};
  });
}

}  // namespace

std::vector<Check> plastic_flow_checks() {
  return {
      {"plasticity.isochoric-flow", 37, "Where it is declared, the return keeps det b to 1e-12.", plasticity_kind,
       isochoric_flow},
      {"plasticity.dissipation", 38, "Plastic flow dissipates: of a virgin point in every step, of any in sum over its path.",
       plasticity_kind, dissipates},
      {"plasticity.isotropy", 39,
       "Where isotropy is declared, the return commutes with rotations and keeps the eigenvectors of b.", plasticity_kind,
       isotropic},
      {"plasticity.hardening-direction", 41,
       "State variables change in the declared direction, and in one direction under more and more of one load.",
       plasticity_kind, hardening_direction},
      {"plasticity.b-and-F", 42, "The forms of b and of F agree, and the return adds no rotation to F.", plasticity_kind,
       b_and_F},
  };
}

}  // namespace cleave::testkit
