/// An elastic law as its checks ask it: strains, degradation and fibres in; stress and whatever else it offers out.
#ifndef CLEAVE_TESTKIT_ELASTIC_LAW_HPP
#define CLEAVE_TESTKIT_ELASTIC_LAW_HPP

#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>
#include <cleave/testkit/tensor3.hpp>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

namespace cleave::testkit {

struct ElasticPoint {
  Matrix3 F = identity();
  double g = 1;
  Vector3 fiber{1, 0, 0}, second_fiber{0, 1, 0};
  Matrix3 dF{};
};

/// What the law does not offer stays 0.
struct ElasticResponse {
  cleave_status status = CLEAVE_STATUS_OK;
  Symmetric3 tau{}, effective_stress{};
  double energy = 0, tensile_energy = 0, wave_modulus = 0;
  Matrix3 P{}, dP{};

  bool valid() const { return status < CLEAVE_STATUS_RETRY; }
};

/// Degradations a law is asked at: intact, half, and what is left of a broken point.
constexpr double degradations[] = {1, 0.5, 0.001};

inline std::string short_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}
/// Rounding beside the largest number is left out.
template <std::size_t N>
std::string list_text(const std::array<double, N>& values) {
  const double size = std::sqrt(dot(values, values));
  std::string all;
  for (double value : values) all += (all.empty() ? "[" : ", ") + short_text(std::abs(value) < 1e-13 * size ? 0 : value);
  return all + "]";
}

class ElasticLaw {
 public:
  ElasticLaw(const Plugin& plugin, const Settings& settings, Precision precision, const std::string& measure)
      : instance_(plugin, settings), precision_(precision), measure_(measure) {
    // Largest stiffness at rest, by differences over strains along and across the axes.
    const double step = by_precision(1e-4, 1e-2);
    std::vector<ElasticPoint> points;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = i; j < 3; ++j)
        for (double sign : {-1, 1}) {
          ElasticPoint point;
          point.F[3 * i + j] += sign * step;
          points.push_back(point);
        }
    const auto answers = (*this)(points);
    for (std::size_t k = 0; k < answers.size(); k += 2)
      modulus_ = std::max(modulus_, norm(sum(answers[k + 1].tau, answers[k].tau, -1)) / (2 * step));
    if (!(modulus_ > 0) || !std::isfinite(modulus_))
      throw Failed{"its stiffness at rest is " + short_text(modulus_) + " Pa: small strains give no stress, or no finite one"};
  }

  bool can(std::uint64_t capability) const { return instance_.can(capability); }
  /// Capabilities the point's fibres are read with.
  bool has_fiber() const { return instance_.can(CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER); }
  bool has_second_fiber() const { return instance_.can(CLEAVE_NEEDS_SECOND_FIBER); }
  Precision precision() const { return precision_; }
  const std::string& measure() const { return measure_; }
  double by_precision(double in_double, double in_single) const {
    return precision_ == Precision::double_precision ? in_double : in_single;
  }
  /// Largest stiffness at rest [Pa], by which stresses are judged.
  double modulus() const { return modulus_; }

  enum Extra : unsigned { nothing = 0, wave = 1, effective = 2, tangent = 4, piola = 8 };
  /// Stress always, energies if the law has them, the extras if it can. A point's status is left to the caller.
  std::vector<ElasticResponse> operator()(const std::vector<ElasticPoint>& points, unsigned extras = nothing) const {
    Request request;
    request.count = std::uint32_t(points.size());
    for (const ElasticPoint& point : points) {
      if (measure_ == "b")
        request.inputs[CLEAVE_FIELD_B].push_back(numbers(left_cauchy_green(point.F)));
      else
        request.inputs[CLEAVE_FIELD_F].push_back(numbers(point.F));
      request.inputs[CLEAVE_FIELD_DEGRADATION].push_back({point.g});
      if (has_fiber()) request.inputs[CLEAVE_FIELD_FIBER].push_back(numbers(point.fiber));
      if (has_second_fiber()) request.inputs[CLEAVE_FIELD_SECOND_FIBER].push_back(numbers(point.second_fiber));
      if (extras & tangent) request.inputs[CLEAVE_FIELD_DELTA_F].push_back(numbers(point.dF));
    }
    auto& outputs = request.outputs;
    outputs[CLEAVE_FIELD_TAU] = 6;
    if (can(CLEAVE_HAS_ENERGY)) outputs[CLEAVE_FIELD_ENERGY] = outputs[CLEAVE_FIELD_TENSILE_ENERGY] = 1;
    if (extras & effective) outputs[CLEAVE_FIELD_EFFECTIVE_STRESS] = 6;
    if (extras & wave) outputs[CLEAVE_FIELD_WAVE_MODULUS] = 1;
    if (extras & tangent) outputs[CLEAVE_FIELD_DELTA_P] = 9;
    if (extras & piola) outputs[CLEAVE_FIELD_PIOLA] = 9;
    const Answer answer = evaluated(instance_, precision_, request);
    std::vector<ElasticResponse> responses(points.size());
    for (std::size_t k = 0; k < points.size(); ++k) {
      ElasticResponse& r = responses[k];
      r.status = answer.status[k];
      const auto of = [&](cleave_field_id field) -> const std::vector<double>& { return answer.outputs.at(field)[k]; };
      r.tau = read<6>(of(CLEAVE_FIELD_TAU));
      if (can(CLEAVE_HAS_ENERGY)) {
        r.energy = of(CLEAVE_FIELD_ENERGY)[0];
        r.tensile_energy = of(CLEAVE_FIELD_TENSILE_ENERGY)[0];
      }
      if (extras & effective) r.effective_stress = read<6>(of(CLEAVE_FIELD_EFFECTIVE_STRESS));
      if (extras & wave) r.wave_modulus = of(CLEAVE_FIELD_WAVE_MODULUS)[0];
      if (extras & tangent) r.dP = read<9>(of(CLEAVE_FIELD_DELTA_P));
      if (extras & piola) r.P = read<9>(of(CLEAVE_FIELD_PIOLA));
    }
    return responses;
  }

  std::string text(const ElasticPoint& point) const {
    std::string all = "at F = " + list_text(point.F) + ", g = " + short_text(point.g);
    if (has_fiber()) all += ", fibre " + list_text(point.fiber);
    if (has_second_fiber()) all += ", second fibre " + list_text(point.second_fiber);
    return all;
  }

 private:
  Instance instance_;
  Precision precision_;
  std::string measure_;
  double modulus_ = 0;
};

/// F of stretches up to e^(+-spread) along random axes, turned at random; random orthogonal fibres.
inline ElasticPoint random_point(Random& random, double spread, double g = 1) {
  const auto frame = random.rotation();
  ElasticPoint point;
  const auto stretch = [&] { return std::exp(random.uniform(-spread, spread)); };
  const Matrix3 D = diagonal(stretch(), stretch(), stretch());
  point.F = product(product(random.rotation(), D), random.rotation());
  point.g = g;
  point.fiber = {frame[0], frame[3], frame[6]};
  point.second_fiber = {frame[1], frame[4], frame[7]};
  return point;
}

/// For differences by F: of each point and component, the point with `step` more of it, then with `step` less.
inline std::vector<ElasticPoint> moved_each_way(const std::vector<ElasticPoint>& points, double step) {
  std::vector<ElasticPoint> moved;
  for (const ElasticPoint& point : points)
    for (std::size_t i = 0; i < 9; ++i)
      for (double sign : {1, -1}) {
        moved.push_back(point);
        moved.back().F[i] += sign * step;
      }
  return moved;
}

/// P = tau F^-T, row-major; det F must not vanish.
inline Matrix3 piola(const Symmetric3& tau, const Matrix3& F) {
  const Matrix3 cofactor{F[4] * F[8] - F[5] * F[7], F[5] * F[6] - F[3] * F[8], F[3] * F[7] - F[4] * F[6],
                         F[2] * F[7] - F[1] * F[8], F[0] * F[8] - F[2] * F[6], F[1] * F[6] - F[0] * F[7],
                         F[1] * F[5] - F[2] * F[4], F[2] * F[3] - F[0] * F[5], F[0] * F[4] - F[1] * F[3]};
  Matrix3 P = product(full(tau), cofactor);
  for (double& x : P) x /= determinant(F);
  return P;
}

/// Parameters to check a law with: those of the context, and there also with what is off by default: each capability that a
/// parameter brings (cleave_parameter_schema::needs), all of them together, each choice that is not the default, softer and
/// stiffer numbers.
inline std::vector<Settings> elastic_settings(Context& context) {
  const cleave_schema& schema = context.plugin().schema();
  std::vector<Settings> all;
  const auto add = [&](const Settings& settings) {
    if (std::find(all.begin(), all.end(), settings) != all.end()) return;
    try {
      const Instance accepted(context.plugin(), settings);
      all.push_back(settings);
    } catch (const Failed&) {
      // Values that do not go together.
    }
  };
  const auto with_options = [&](const Settings& base) {
    Settings everything = base;
    for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
      const cleave_parameter_schema& p = *schema.parameters[i];
      if (!(p.needs[0] | p.needs[1]) || p.in_set || base.contains(p.key)) continue;
      Settings one = base;
      one[p.key] = everything[p.key] = typical_value(p, 0.03, 0);
      add(one);
    }
    add(everything);
    for (std::uint32_t i = 0; i < schema.parameter_count; ++i) {
      const cleave_parameter_schema& p = *schema.parameters[i];
      if (p.required || p.in_set || base.contains(p.key)) continue;
      Settings other = everything;
      if (p.type == CLEAVE_TYPE_BOOLEAN) {
        other[p.key] = p.default_number == 0;
        add(other);
      }
      for (std::uint32_t k = 0; p.type == CLEAVE_TYPE_TEXT && k < p.choice_count; ++k) {
        other[p.key] = std::string(p.choices[k]);
        if (std::string(p.choices[k]) != p.default_text) add(other);
      }
    }
  };
  for (const Settings& settings : context.settings()) add(settings), with_options(settings);
  for (double place : {0.35, 0.9})
    if (const auto settings = context.settings_at(place)) with_options(*settings);
  return all;
}

enum class Forms {
  double_precision,  ///< f64 alone; throws Skipped if the law does not offer it
  all_precisions
};

/// `body(law, random)` for `cases` random cases of every set of parameters, precision and strain measure. What it throws is
/// completed by the form and the parameters.
template <class Body>
void for_each_law(Context& context, Forms forms, int cases, Body body) {
  const Plugin& plugin = context.plugin();
  if (forms == Forms::double_precision && !plugin.can(CLEAVE_DOUBLE))
    context.skip("differences of its results mean something in f64 only, which it does not offer");
  for (const Settings& settings : elastic_settings(context))
    for (const auto precision : precisions(plugin)) {
      if (forms == Forms::double_precision && precision != Precision::double_precision) continue;
      for (const auto& measure : measures(Instance(plugin, settings))) {
        const std::string form = std::string(name(precision)) + " of " + measure;
        context.doing("evaluating in " + form + " with " + text(settings));
        try {
          const ElasticLaw law(plugin, settings, precision, measure);
          context.random_cases(cases, [&](Random& random) { body(law, random); });
        } catch (const Failed& failed) {
          throw Failed{form + ": " + failed.reason + ", with " + text(settings)};
        }
      }
    }
}

/// Throws Failed unless the law has a finite stress at the point.
inline void expect_valid(const ElasticLaw& law, const ElasticPoint& point, const ElasticResponse& response) {
  if (response.valid() && std::isfinite(norm(response.tau))) return;
  throw Failed{"no stress (status " + std::to_string(response.status) + ") " + law.text(point) +
               ", where every elastic law has one"};
}

}  // namespace cleave::testkit

#endif
