#include <cleave/damage.h>
#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>
#include <cleave/testkit/tensor3.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

namespace cleave::testkit {
namespace {

using testkit::text;
std::string text(double number) {
  char digits[32];
  std::snprintf(digits, sizeof digits, "%.6g", number);
  return digits;
}
template <std::size_t N>
std::string text(const std::array<double, N>& numbers) {
  std::string all;
  for (double number : numbers) all += (all.empty() ? "[" : " ") + text(number);
  return all + "]";
}

/// A material point under load. Fibres lie across the x axis.
struct Point {
  Matrix3 F = identity();
  Symmetric3 stress{};  ///< effective Cauchy stress [Pa]
  double energy = 0;    ///< psi_plus [J/m^3]
  Vector3 fiber{0, 1, 0}, second_fiber{0, 0, 1};
  double damage = 0, toughness = 1;
  std::vector<double> state;

  void load(const Matrix3& deformation) {
    F = deformation;
    Material::effective_stress(F.data(), stress.data());
    energy = Material::tensile_energy(F.data());
  }
  void unload() {
    F = identity();
    stress = {};
    energy = 0;
  }
};

struct Driven {
  bool valid;    ///< the law has a result
  double value;  ///< D; of local laws the new damage
  std::vector<double> state;
};

class Law {
 public:
  Law(const Instance& instance, Precision precision)
      : local(instance.can(CLEAVE_DAMAGE_IS_LOCAL)),
        single_precision(precision == Precision::single_precision),
        rounding(single_precision ? 1e-5 : 1e-12),
        initial_state(instance.initial_state()),
        instance_(instance),
        precision_(precision),
        measure_(measures(instance).front()) {
    if (single_precision)
      for (double& value : initial_state) value = double(float(value));
  }

  const bool local, single_precision;
  const double rounding;
  std::vector<double> initial_state;

  const char* output() const { return local ? "the new damage" : "the driving force"; }
  const cleave_schema& schema() const { return instance_.plugin().schema(); }
  bool can(std::uint64_t capability) const { return instance_.can(capability); }
  bool reads_fibers() const { return can(CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER); }

  std::vector<Driven> drive(const std::vector<Point>& points, double time_step = 1e-4) const {
    Request request;
    request.count = std::uint32_t(points.size());
    request.time_step = time_step;
    auto& in = request.inputs;
    for (const Point& point : points) {
      if (measure_ == "b") in[CLEAVE_FIELD_B].push_back(numbers(left_cauchy_green(point.F)));
      if (measure_ == "F") in[CLEAVE_FIELD_F].push_back(numbers(point.F));
      if (reads_fibers()) in[CLEAVE_FIELD_FIBER].push_back(numbers(point.fiber));
      if (can(CLEAVE_NEEDS_SECOND_FIBER)) in[CLEAVE_FIELD_SECOND_FIBER].push_back(numbers(point.second_fiber));
      if (can(CLEAVE_NEEDS_TENSILE_ENERGY)) in[CLEAVE_FIELD_TENSILE_ENERGY_IN].push_back({point.energy});
      if (can(CLEAVE_NEEDS_EFFECTIVE_STRESS)) in[CLEAVE_FIELD_EFFECTIVE_STRESS_IN].push_back(numbers(point.stress));
      in[CLEAVE_FIELD_DAMAGE].push_back({point.damage});
      in[CLEAVE_FIELD_TOUGHNESS].push_back({point.toughness});
      if (!initial_state.empty()) in[CLEAVE_FIELD_STATE].push_back(point.state);
    }
    const auto field = local ? CLEAVE_FIELD_DAMAGE_OUT : CLEAVE_FIELD_DRIVING_FORCE;
    request.outputs[field] = 1;
    if (!initial_state.empty()) request.outputs[CLEAVE_FIELD_STATE_OUT] = int(initial_state.size());
    const Answer answer = evaluated(instance_, precision_, request);
    std::vector<Driven> driven;
    for (std::size_t k = 0; k < points.size(); ++k)
      driven.push_back({answer.status[k] < CLEAVE_STATUS_RETRY, answer.outputs.at(field)[k][0],
                        initial_state.empty() ? std::vector<double>() : answer.outputs.at(CLEAVE_FIELD_STATE_OUT)[k]});
    return driven;
  }
  Driven drive(const Point& point, double time_step = 1e-4) const { return drive(std::vector{point}, time_step)[0]; }

  cleave_damage_model model() const {
    cleave_damage_model model;
    std::memset(&model, 0x5A, sizeof model);
    model.struct_size = sizeof model;
    static_cast<const cleave_damage*>(instance_.plugin().kind_table())->model(instance_.handle(), &model);
    return model;
  }

  Point at_rest() const {
    Point point;
    point.state = initial_state;
    return point;
  }
  /// Its damage and toughness as the law reads them.
  Point random_point(Random& random) const {
    Point point = at_rest();
    const Matrix3 frame = random.rotation();
    point.fiber = {frame[0], frame[3], frame[6]};
    point.second_fiber = {frame[1], frame[4], frame[7]};
    point.damage = double(float(random.uniform()));
    point.toughness = double(float(random.uniform(0.5, 2)));
    return point;
  }

 private:
  const Instance& instance_;
  Precision precision_;
  std::string measure_;
};

/// Stretches of exp(-0.22) to exp(0.22) where `amplitude` is 1.
Matrix3 random_deformation(Random& random, double amplitude) {
  double stretch[3];
  for (double& s : stretch) s = std::exp(amplitude * random.uniform(-0.22, 0.22));
  return product(product(random.rotation(), diagonal(stretch[0], stretch[1], stretch[2])), random.rotation());
}

template <class Body>
void with(Context& context, const Settings& settings, Precision precision, Body body) {
  const Instance instance(context.plugin(), settings);
  context.doing(std::string("driving damage in ") + name(precision) + " with " + text(settings));
  try {
    body(Law(instance, precision));
  } catch (const Failed& failed) {
    throw Failed{std::string(name(precision)) + ": " + failed.reason + ", with " + text(settings)};
  }
}
template <class Body>
void for_each_law(Context& context, const std::vector<Precision>& all, Body body) {
  for (const Settings& settings : context.settings())
    for (const Precision precision : all) with(context, settings, precision, body);
}
template <class Body>
void for_random_laws(Context& context, int count, Body body) {
  const std::vector<Settings> all = context.settings();
  const std::vector<Precision> offered = precisions(context.plugin());
  context.random_cases(count, [&](Random& random) {
    const Settings& settings = all[std::size_t(random.below(int(all.size())))];
    const Precision precision = offered[std::size_t(random.below(int(offered.size())))];
    with(context, settings, precision, [&](const Law& law) { body(law, random); });
  });
}

// ---------------------------------------------------------------- driving force

/// How each component of the state may change: enum cleave_monotonicity.
std::vector<std::uint32_t> monotonicities(const cleave_schema& schema) {
  std::vector<std::uint32_t> all;
  for (std::uint32_t i = 0; i < schema.state_count; ++i)
    all.insert(all.end(), schema.states[i]->tensor, schema.states[i]->monotonicity);
  return all;
}
std::string name_of_component(const cleave_schema& schema, std::size_t component) {
  for (std::uint32_t i = 0; i < schema.state_count; ++i) {
    if (component < schema.states[i]->tensor) return schema.states[i]->name;
    component -= schema.states[i]->tensor;
  }
  return {};
}

void expect_rest(Context& context, const Law& law, const Matrix3& rotation) {
  const double tolerance = law.single_precision ? 1e-4 : 1e-9;
  for (double damage : {0.0, 0.5, 1.0}) {
    Point point = law.at_rest();
    point.F = rotation;
    point.damage = damage;
    const Driven driven = law.drive(point);
    const double added = law.local ? driven.value - damage : driven.value;
    if (!(std::abs(added) <= tolerance))
      context.fail("at rest, with d = " + text(damage) + ", " + law.output() + " is " + text(driven.value) + " in place of " +
                   text(law.local ? damage : 0));
  }
}

void driving_force(Context& context) {
  for_each_law(context, precisions(context.plugin()), [&](const Law& law) { expect_rest(context, law, identity()); });
  for_random_laws(context, 150, [&](const Law& law, Random& random) {
    expect_rest(context, law, random.rotation());
    const auto changes = monotonicities(law.schema());
    const bool keeps_history = std::count(changes.begin(), changes.end(), std::uint32_t(CLEAVE_NEVER_DECREASES)) > 0;
    std::vector<Point> points;
    for (int k = 0; k < 20; ++k) points.push_back(law.random_point(random));
    std::vector<double> before(points.size(), 0);
    for (int step = 0; step < 10; ++step) {
      for (Point& point : points) point.load(random_deformation(random, std::exp(random.uniform(-7, 0.5))));
      const auto driven = law.drive(points);
      for (std::size_t k = 0; k < points.size(); ++k) {
        if (!driven[k].valid) continue;
        const double value = driven[k].value;
        const std::string where = " at F = " + text(points[k].F);
        for (std::size_t i = 0; i < changes.size(); ++i) {
          const double from = points[k].state[i], to = driven[k].state[i];
          if ((changes[i] == CLEAVE_NEVER_DECREASES && to < from) || (changes[i] == CLEAVE_NEVER_INCREASES && to > from))
            context.fail("the state \"" + name_of_component(law.schema(), i) + "\" goes from " + text(from) + " to " +
                         text(to) + where + ", declared never to " + (to < from ? "decrease" : "increase"));
        }
        if (!(value >= 0)) context.fail(std::string(law.output()) + " is " + text(value) + where);
        if (law.local) {
          if (!(value <= 1)) context.fail("the new damage is " + text(value) + ", not in [0, 1]," + where);
          if (value < points[k].damage)
            context.fail("damage heals from " + text(points[k].damage) + " to " + text(value) + where);
          points[k].damage = value;
        } else if (keeps_history) {
          if (value < before[k] * (1 - law.rounding))
            context.fail("the driving force falls from " + text(before[k]) + " to " + text(value) + where +
                         ", though a history is kept");
          before[k] = value;
        }
        points[k].state = driven[k].state;
      }
    }
  });
}

// ---------------------------------------------------------------- a bar under tension

/// Deformation of a free bar pulled along x by a strain: no stress across.
Matrix3 bar(double strain) {
  double low = 0.3, high = 1;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    const Matrix3 F = diagonal(1 + strain, middle, middle);
    Symmetric3 stress;
    Material::effective_stress(F.data(), stress.data());
    (stress[1] > 0 ? high : low) = middle;
  }
  const double across = (low + high) / 2;
  return diagonal(1 + strain, across, across);
}

constexpr double largest_strain = 0.5;

/// d of the evolution at rest.
double at_equilibrium(const Law& law, double value) {
  return law.local ? value : std::max(value, 0.0) / (1 + std::max(value, 0.0));
}

/// What the law makes of a bar that was never loaded before.
Driven at_once(const Law& law, double strain, double damage, double time_step) {
  Point point = law.at_rest();
  point.load(bar(strain));
  point.damage = damage;
  Driven driven = law.drive(point, time_step);
  if (!driven.valid) throw Failed{"no result for a bar pulled by a strain of " + text(strain)};
  return driven;
}

/// No closed form then: D changes while damage comes to rest.
bool depends_on_time_or_damage(const Law& law) {
  const double value = at_once(law, largest_strain, 0, 1e-6).value;
  return value != at_once(law, largest_strain, 0, 1e-3).value ||
         (!law.local && value != at_once(law, largest_strain, 0.5, 1e-6).value);
}

void check_model(Context& context, const Law& law) {
  const cleave_damage_model model = law.model(), again = law.model();
  if (std::memcmp(&model, &again, sizeof model) != 0) context.fail("model() gives something else at its second call");
  if (!(model.residual >= 0 && model.residual < 1))
    context.fail("model() gives the residual r = " + text(model.residual) + ", not in [0, 1): g(1) = r");
  if (law.local) return;
  if (!(model.viscosity > 0 && std::isfinite(model.viscosity)))
    context.fail("model() gives the viscosity eta = " + text(model.viscosity) + " s, not positive");
  if (!(model.length >= 0 && std::isfinite(model.length)))
    context.fail("model() gives the length l = " + text(model.length) + " m, not zero or positive");
  if (model.integration != CLEAVE_INTEGRATION_IMPLICIT && model.integration != CLEAVE_INTEGRATION_EXPLICIT)
    context.fail("model() gives the integration " + std::to_string(model.integration) + ", neither implicit nor explicit");
}

/// Pulls the bar through rising strains, and holds each until damage rests. Largest damage.
double pull_slowly(Context& context, const Law& law) {
  constexpr int levels = 40, holds = 6;
  constexpr double step_over_viscosity = 100;
  const double time_step = law.local ? 1e-4 : step_over_viscosity * law.model().viscosity;
  Point point = law.at_rest();
  for (int level = 0; level < levels; ++level) {
    const double strain = largest_strain * std::pow(1e-4 / largest_strain, 1 - (level + 1.) / levels);
    point.load(bar(strain));
    for (int hold = 0; hold < holds; ++hold) {
      const Driven driven = law.drive(point, time_step);
      if (!driven.valid) context.fail("no result for a bar pulled slowly to a strain of " + text(strain));
      const double D = std::max(driven.value, 0.0);
      const double implicit = (point.damage + step_over_viscosity * D) / (1 + step_over_viscosity * (1 + D));
      point.damage = law.local ? driven.value : std::max(point.damage, implicit);
      point.state = driven.state;
    }
    const double value = at_once(law, strain, law.local ? 0 : point.damage, time_step).value;
    const double expected = at_equilibrium(law, value);
    if (std::abs(point.damage - expected) <= (law.single_precision ? 1e-5 : 1e-9)) continue;
    context.fail("a bar pulled slowly to a strain of " + text(strain) + " has the damage " + text(point.damage) +
                 "; loaded at once, " +
                 (law.local ? "it has " + text(expected) : "D = " + text(value) + " gives D/(1 + D) = " + text(expected)));
  }
  return point.damage;
}

void degradation(Context& context) {
  double largest = 0;
  bool changing = false;
  for_each_law(context, {precisions(context.plugin()).front()}, [&](const Law& law) {
    check_model(context, law);
    if (depends_on_time_or_damage(law))
      changing = true;
    else
      largest = std::max(largest, pull_slowly(context, law));
  });
  if (changing) context.skip("model() is sound, but what the law gives for a load depends on the time step or on damage");
  if (largest < 1e-3)
    context.skip("model() is sound, but no parameters tried let a bar break at a strain of " + text(largest_strain) +
                 ": give others with --set");
}

// ---------------------------------------------------------------- directions

void rotations(Context& context, const Law& law, Random& random) {
  // Of a law without fibres the reference frame is its own affair unless it is isotropic.
  const bool turns_reference = law.reads_fibers() || law.can(CLEAVE_ISOTROPIC) || !law.can(CLEAVE_ACCEPTS_F);
  const Matrix3 Q = random.rotation(), R = turns_reference ? Matrix3(random.rotation()) : identity();
  std::vector<Point> points;
  for (int k = 0; k < 20; ++k) points.push_back(law.random_point(random));
  std::vector<Point> turned_points = points;
  for (Point& point : turned_points) {
    point.fiber = product(R, point.fiber);
    point.second_fiber = product(R, point.second_fiber);
  }
  for (int step = 0; step < 2; ++step) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      Point &point = points[k], &other = turned_points[k];
      point.load(random_deformation(random, std::exp(random.uniform(-5, 0))));
      other.F = product(product(Q, point.F), transpose(R));
      other.stress = turned(Q, point.stress);
      other.energy = point.energy;
    }
    const auto one = law.drive(points), two = law.drive(turned_points);
    for (std::size_t k = 0; k < points.size(); ++k) {
      points[k].state = one[k].state;
      turned_points[k].state = two[k].state;
      if (!one[k].valid && !two[k].valid) continue;
      const double apart = std::abs(one[k].value - two[k].value);
      if (one[k].valid == two[k].valid && apart <= (law.single_precision ? 1e-4 : 1e-10) * (1 + one[k].value)) continue;
      context.fail("turning the body, its fibres and its load changes " + std::string(law.output()) + " from " +
                   text(one[k].value) + " to " + text(two[k].value) + " at F = " + text(points[k].F));
    }
  }
}

bool same_bits(const Driven& a, const Driven& b) {
  return std::memcmp(&a.value, &b.value, sizeof a.value) == 0 &&
         (a.state.empty() || std::memcmp(a.state.data(), b.state.data(), a.state.size() * sizeof(double)) == 0);
}

/// A law may leave out what cannot matter where no point of a tile needs it. Points that nothing drives, alone and among
/// others that are driven, tell.
void early_outs(Context& context, const Law& law, Random& random) {
  std::vector<Point> points;
  for (int k = 0; k < 32; ++k) {
    points.push_back(law.random_point(random));
    points.back().load(random_deformation(random, 1));
  }
  const auto loaded = law.drive(points);
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (loaded[k].valid && random.below(3)) points[k].state = loaded[k].state;
    if (random.below(2)) points[k].load(random_deformation(random, std::exp(random.uniform(-9, -1))));
  }
  std::vector<Point> at_rest = points;
  for (Point& point : at_rest) point.unload();
  const auto mixed = law.drive(points), unloaded = law.drive(at_rest);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Driven alone = law.drive(points[k]);
    if (same_bits(alone, mixed[k]) || (!alone.valid && !mixed[k].valid)) continue;
    if (same_bits(alone, unloaded[k]))
      context.fail("a point that nothing drives has " + std::string(law.output()) + " " + text(alone.value) +
                   " alone, and other bits in a batch with points that are driven (" + text(mixed[k].value - alone.value) +
                   " more), at F = " + text(points[k].F));
    if (alone.valid != mixed[k].valid || !(std::abs(alone.value - mixed[k].value) <= law.rounding * (1 + alone.value)))
      context.fail("a point has " + std::string(law.output()) + " " + text(alone.value) + " alone and " + text(mixed[k].value) +
                   " among others, at F = " + text(points[k].F));
  }
}

void directional(Context& context) {
  for_random_laws(context, 60, [&](const Law& law, Random& random) {
    rotations(context, law, random);
    early_outs(context, law, random);
  });
}

// ---------------------------------------------------------------- integration in time

/// A bar pulled for two times eta at a constant rate, in this many steps.
struct Pulled {
  double apart = 0;         ///< largest difference between explicit and implicit integration
  double damage = 0;        ///< implicit, at the end
  double largest_step = 0;  ///< of the implicit damage
};
constexpr double duration_over_viscosity = 2;

Pulled pull(const Law& law, double strain, double viscosity, int steps) {
  const double step_over_viscosity = duration_over_viscosity / steps;
  Pulled pulled;
  std::vector<Point> points(2, law.at_rest());
  Point &explicitly = points[0], &implicitly = points[1];
  for (int step = 1; step <= steps; ++step) {
    const Matrix3 F = bar(strain * step / steps);
    for (Point& point : points) point.load(F);
    const auto driven = law.drive(points, step_over_viscosity * viscosity);
    for (std::size_t k = 0; k < points.size(); ++k) {
      if (!driven[k].valid) throw Failed{"no result for a bar pulled to a strain of " + text(strain * step / steps)};
      points[k].state = driven[k].state;
    }
    // eta dd/dt = <(1 - d) D - d>, the rate at the start or at the end of the step.
    const double D = driven[0].value, D_implicit = driven[1].value, before = implicitly.damage;
    explicitly.damage += step_over_viscosity * std::max((1 - explicitly.damage) * D - explicitly.damage, 0.0);
    explicitly.damage = std::min(explicitly.damage, 1.0);
    implicitly.damage =
        std::max(before, (before + step_over_viscosity * D_implicit) / (1 + step_over_viscosity * (1 + D_implicit)));
    pulled.apart = std::max(pulled.apart, std::abs(explicitly.damage - implicitly.damage));
    pulled.largest_step = std::max(pulled.largest_step, implicitly.damage - before);
  }
  pulled.damage = implicitly.damage;
  return pulled;
}

/// The strain of a bar at which D reaches one, or its largest value if that is less.
double strain_of_unit_force(const Law& law, double time_step) {
  const double wanted = std::min(1.0, at_once(law, largest_strain, 0, time_step).value);
  double low = 1e-7, high = largest_strain;
  for (int i = 0; i < 40; ++i) {
    const double middle = std::sqrt(low * high);
    (at_once(law, middle, 0, time_step).value >= wanted ? high : low) = middle;
  }
  return high;
}

void integration(Context& context) {
  if (context.plugin().can(CLEAVE_DAMAGE_IS_LOCAL)) context.skip("the law sets the damage itself");
  bool damaged = false;
  for_each_law(context, {precisions(context.plugin()).front()}, [&](const Law& law) {
    const double eta = law.model().viscosity, viscosity = eta > 0 && std::isfinite(eta) ? eta : 1;
    const double coarse_step = duration_over_viscosity * viscosity / 32;
    const double strain = strain_of_unit_force(law, coarse_step), force = at_once(law, strain, 0, coarse_step).value;
    if (force < 1e-2) return;
    damaged = true;
    // Explicit integration is stable where the step is below 2 eta/(1 + D).
    const int steps = int(std::clamp(4 * (1 + force), 32., 1024.));
    const Pulled first = pull(law, strain, viscosity, steps), third = pull(law, strain, viscosity, 4 * steps),
                 last = pull(law, strain, viscosity, 8 * steps);
    const std::string numbers = " in " + std::to_string(steps) + ", " + std::to_string(4 * steps) + " and " +
                                std::to_string(8 * steps) + " steps to a strain of " + text(strain);
    // Of first order, an eighth is left of the difference.
    if (!(last.apart <= std::max(0.2 * first.apart, law.single_precision ? 1e-4 : 1e-9)))
      context.fail("explicit and implicit damage differ by " + text(first.apart) + ", " + text(third.apart) + " and " +
                   text(last.apart) + numbers);
    // Half the step changes the result by less than two steps do, also where D jumps.
    if (!(std::abs(last.damage - third.damage) <= std::max(2 * third.largest_step, law.single_precision ? 1e-4 : 1e-9)))
      context.fail("damage reaches " + text(first.damage) + ", " + text(third.damage) + " and " + text(last.damage) + numbers);
  });
  if (!damaged)
    context.skip("no parameters tried let a bar break at a strain of " + text(largest_strain) + ": give others with --set");
}

}  // namespace

std::vector<Check> damage_checks() {
  return {
      {"damage.driving-force", 43,
       "D is zero at rest and never negative, and a history never goes back; local damage stays in [0, 1] and never heals.",
       damage_kind, driving_force},
      {"damage.degradation", 44,
       "r, eta and l are usable, and a bar pulled slowly ends at d = D/(1 + D), however many steps the load took.", damage_kind,
       degradation},
      {"damage.directional", 45,
       "Turning body, fibres and load together changes nothing; a point nothing drives has the same bits beside any others.",
       damage_kind, directional},
      {"damage.integration", 46,
       "Driven by the law, explicit and implicit integration of damage come together with the first power of the step.",
       damage_kind, integration},
  };
}

}  // namespace cleave::testkit
