#include "return_mapping.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace cleave::testkit::plasticity {
namespace {

struct Principal {
  Vector3 values;
  Matrix3 vectors;  ///< in columns
};

/// Cyclic Jacobi rotations.
Principal eigen(const Symmetric3& s) {
  Matrix3 a = full(s), Q = identity();
  for (int sweep = 0; sweep < 20; ++sweep) {
    if (std::abs(a[1]) + std::abs(a[2]) + std::abs(a[5]) == 0) break;
    for (const auto& [i, j] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
      if (a[3 * i + j] == 0) continue;
      const double theta = (a[4 * j] - a[4 * i]) / (2 * a[3 * i + j]);
      const double t = std::copysign(1, theta) / (std::abs(theta) + std::hypot(1, theta)), c = 1 / std::hypot(1, t);
      Matrix3 R = identity();
      R[4 * i] = R[4 * j] = c;
      R[3 * i + j] = t * c;
      R[3 * j + i] = -t * c;
      a = product(product(transpose(R), a), R);
      a[3 * i + j] = a[3 * j + i] = 0;
      Q = product(Q, R);
    }
  }
  return {{a[0], a[4], a[8]}, Q};
}

double trace(const Symmetric3& s) { return s[0] + s[1] + s[2]; }

}  // namespace

Symmetric3 function_of(const Symmetric3& s, double (*f)(double)) {
  const auto [values, Q] = eigen(s);
  return turned(Q, Symmetric3{f(values[0]), f(values[1]), f(values[2]), 0, 0, 0});
}
Symmetric3 logarithmic_strain(const Symmetric3& b) {
  return function_of(b, [](double x) { return 0.5 * std::log(x); });
}

double condition(const Symmetric3& b) {
  const Vector3 values = eigen(b).values;
  const auto [low, high] = std::minmax({values[0], values[1], values[2]});
  return low > 0 ? high / low : std::numeric_limits<double>::infinity();
}

Symmetric3 stress(const Symmetric3& b) {
  const double squared_J = determinant(full(b)), shear = Material::shear_modulus / std::cbrt(squared_J);
  const double mean = shear * trace(b) / 3 - 0.5 * Material::bulk_modulus * (squared_J - 1);
  return {shear * b[0] - mean, shear * b[1] - mean, shear * b[2] - mean, shear * b[3], shear * b[4], shear * b[5]};
}

double largest_change(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0, size = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double change = std::abs(a[i] - b[i]);
    if (std::isnan(change)) return std::numeric_limits<double>::infinity();
    largest = std::max(largest, change);
    size = std::max(size, std::abs(a[i]));
  }
  return largest / std::max(size, 1.0);
}

namespace {
std::string formatted(const char* format, double x) {
  char buffer[48];
  std::snprintf(buffer, sizeof buffer, format, x);
  return buffer;
}
}  // namespace
std::string short_text(double x) { return formatted("%.3g", x); }
std::string digits(const std::vector<double>& values) {
  std::string all;
  for (double value : values) all += (all.empty() ? "" : ", ") + formatted("%.17g", value);
  return "[" + all + "]";
}

Returned Mapping::operator()(const Points& points, double time_step) const {
  Request request;
  request.count = points.size();
  request.time_step = time_step;
  request.inputs[of_b() ? CLEAVE_FIELD_B : CLEAVE_FIELD_F] = points.strain;
  if (!initial_.empty()) request.inputs[CLEAVE_FIELD_STATE] = points.state;
  if (instance_.can(CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER))
    request.inputs[CLEAVE_FIELD_FIBER] = Field(points.size(), {1, 0, 0});
  if (instance_.can(CLEAVE_NEEDS_SECOND_FIBER)) request.inputs[CLEAVE_FIELD_SECOND_FIBER] = Field(points.size(), {0, 1, 0});
  const cleave_field_id strain_out = of_b() ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT;
  request.outputs = {{strain_out, of_b() ? 6 : 9}, {CLEAVE_FIELD_YIELDED, 1}};
  if (!initial_.empty()) request.outputs[CLEAVE_FIELD_STATE_OUT] = int(initial_.size());
  Answer answer = evaluated(instance_, precision_, request);
  Returned returned;
  returned.points.strain = std::move(answer.outputs[strain_out]);
  returned.points.state = initial_.empty() ? points.state : std::move(answer.outputs[CLEAVE_FIELD_STATE_OUT]);
  for (const auto& flag : answer.outputs[CLEAVE_FIELD_YIELDED]) returned.yielded.push_back(flag[0] != 0);
  returned.status = std::move(answer.status);
  return returned;
}

void Mapping::add(Points& points, const Vector3& e, const Matrix3& left, const Matrix3& right) const {
  const Matrix3 stretch = diagonal(std::exp(e[0]), std::exp(e[1]), std::exp(e[2]));
  points.strain.push_back(strain(product(product(left, stretch), transpose(right))));
  points.state.push_back(seen(initial_));
}

std::string Mapping::words(const Points& points, std::uint32_t k) const {
  std::string all = measure_ + " = " + digits(points.strain[k]);
  if (!initial_.empty()) all += ", state " + digits(points.state[k]);
  return all;
}

std::vector<double> Mapping::moved(const std::vector<double>& strain, const Symmetric3& way, double step) const {
  if (of_b()) {
    const Symmetric3 e = sum(logarithmic_strain(b(strain)), way, step);
    return seen(numbers(function_of(e, [](double x) { return std::exp(2 * x); })));
  }
  const Symmetric3 stretch = function_of(sum(Symmetric3{}, way, step), [](double x) { return std::exp(x); });
  return seen(numbers(product(full(stretch), read<9>(strain))));
}

Points random_trials(const Mapping& map, Random& random, std::uint32_t count, double spread) {
  Points trials;
  for (std::uint32_t k = 0; k < count; ++k) {
    const double size = 0.22 * spread * std::exp(random.uniform(-5, 0));
    Vector3 e;
    for (double& x : e) x = random.uniform(-size, size);
    const Matrix3 left = random.rotation();
    map.add(trials, e, left, random.rotation());
  }
  return trials;
}

Points further_trials(const Mapping& map, Random& random, std::uint32_t count, double spread) {
  const Returned before = map(random_trials(map, random, count, spread));
  Points trials = random_trials(map, random, count, spread);
  for (std::uint32_t k = 0; k < count; k += 2)
    if (before.valid(k)) trials.state[k] = before.points.state[k];
  return trials;
}

std::vector<Settings> all_settings(Context& context) {
  std::vector<Settings> all = context.settings();
  const cleave_schema& schema = context.plugin().schema();
  Settings more = all.front();
  for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
    const cleave_parameter_schema& p = *schema.parameters[i];
    if (p.type == CLEAVE_TYPE_NUMBER && !p.required && !p.in_set)
      more.try_emplace(p.key, typical_value(p, 0.5, 0.01 * Material::youngs_modulus));
  }
  if (more == all.front()) return all;
  try {
    const Instance accepted(context.plugin(), more);
    all.push_back(more);
  } catch (const Failed&) {
    // Values that do not go together.
  }
  return all;
}

std::uint64_t guarantees(const Instance& instance) {
  const auto* table =
      static_cast<const cleave_return_guarantees*>(instance.plugin().table().extension(CLEAVE_EXTENSION_RETURN_GUARANTEES));
  if (table && CLEAVE_HAS(cleave_return_guarantees, table, of)) return table->of(instance.handle());
  return CLEAVE_RETURN_IS_CONSISTENT | (instance.can(CLEAVE_FLOW_IS_ISOCHORIC) ? CLEAVE_RETURN_KEEPS_VOLUME : 0);
}

std::string excuse(const Instance& instance, const Mapping& map) {
  if (!(guarantees(instance) & CLEAVE_RETURN_IS_CONSISTENT)) return "its return is not declared consistent";
  Random random(1);
  const Points trials = random_trials(map, random, 64);
  const Returned slow = map(trials, 1), fast = map(trials, 1e-6);
  if (slow.points.strain != fast.points.strain)
    return "its flow depends on the rate, so that states may stay beyond the surface";
  return {};
}

std::optional<Symmetric3> interior(const Mapping& map, Random& random) {
  for (double spread : {1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5}) {
    const Points trials = random_trials(map, random, 200, spread);
    const Returned returned = map(trials);
    Symmetric3 mean{};
    int elastic = 0;
    for (std::uint32_t k = 0; k < trials.size(); ++k)
      if (returned.elastic(k) && ++elastic) mean = sum(mean, logarithmic_strain(map.b(trials.strain[k])));
    if (elastic < 20) continue;
    for (double& x : mean) x /= elastic;
    return mean;
  }
  return std::nullopt;
}

std::vector<double> inward(const Mapping& map, const std::vector<double>& strain, const Symmetric3& interior) {
  const Symmetric3 b = map.b(strain), way = sum(interior, logarithmic_strain(b), -1);
  const double beyond_rounding = 256 * map.rounding() * condition(b) / norm(way);
  return map.moved(strain, way, std::clamp(beyond_rounding, map.is_single() ? 1e-3 : 1e-8, 1.0));
}

SecondReturn::SecondReturn(const Mapping& map, const Points& trial, const Returned& first)
    : with_old(map({first.points.strain, trial.state})), with_new(map(first.points)) {}

double stress_tolerance(const Mapping& map, const Symmetric3& trial, const Symmetric3& b) {
  const double squared_J = determinant(full(b));
  const double stiffness =
      Material::bulk_modulus * std::max(squared_J, 1.0) + Material::shear_modulus * trace(b) / std::cbrt(squared_J);
  return (map.is_single() ? 1e-4 : 1e-8) * norm(stress(b)) + 64 * map.rounding() * condition(trial) * stiffness;
}

void for_each_mapping(Context& context, Forms forms,
                      const std::function<std::string(const Instance&, const Mapping&, Random&)>& body) {
  bool applies = false, same_reason = true;
  std::string reason, first_settings;
  const auto ask = [&](const Settings& settings, const Instance& instance, Precision precision, const std::string& measure) {
    const Mapping map(instance, precision, measure);
    const std::string where = map.form() + ", with " + text(settings);
    context.doing("returning in " + where);
    Random random(context.seed());
    try {
      const std::string why_not = body(instance, map, random);
      applies = applies || why_not.empty();
      if (reason.empty()) {
        reason = why_not;
        first_settings = text(settings);
      }
      same_reason = same_reason && why_not == reason;
    } catch (const Failed& failed) {
      throw Failed{failed.reason + "; " + where};
    }
  };
  for (const Settings& settings : all_settings(context)) {
    const Instance instance(context.plugin(), settings);
    const auto all_precisions = precisions(context.plugin());
    const auto all_measures = measures(instance);
    if (forms == Forms::widest)
      ask(settings, instance, all_precisions.front(), all_measures.front());
    else
      for (const auto precision : all_precisions)
        for (const auto& measure : all_measures) ask(settings, instance, precision, measure);
  }
  if (!applies) context.skip(same_reason ? reason : reason + ", with " + first_settings);
}

}  // namespace cleave::testkit::plasticity
