// What an elastic law says of a state of strain: rest, frames, symmetry, energy and its parts.
#include "elastic_law.hpp"

namespace cleave::testkit {
namespace {

constexpr double pi = 3.14159265358979323846;

void reference_state(Context& context) {
  for_each_law(context, Forms::all_precisions, 4, [&](const ElasticLaw& law, Random& random) {
    std::vector<ElasticPoint> points;
    for (double g : degradations)
      for (int turned = 0; turned < 6; ++turned) {
        points.push_back(random_point(random, 0, g));
        points.back().F = turned ? random.rotation() : identity();
      }
    const auto answers = law(points);
    // A rotation written in numbers is one to rounding only.
    const double rounding = law.by_precision(1e-12, 1e-5);
    for (std::size_t k = 0; k < points.size(); ++k) {
      expect_valid(law, points[k], answers[k]);
      const auto expect_none = [&](double value, const char* what, const char* unit) {
        if (!(std::abs(value) <= rounding * law.modulus()))
          context.fail("the body at rest has " + std::string(what) + short_text(value) + unit + " (stiffness " +
                       short_text(law.modulus()) + " Pa) " + law.text(points[k]));
      };
      expect_none(norm(answers[k].tau), "|tau| = ", " Pa");
      expect_none(answers[k].energy, "the energy ", " J/m^3");
      expect_none(answers[k].tensile_energy, "psi_plus = ", " J/m^3");
    }
  });
}

double spread_of(Random& random) { return 0.22 * std::exp(random.uniform(-2, 1.2)); }

/// Stress and energies of each pair of points agree, tau of the second being Q tau Q^T of the first.
void expect_equal(const ElasticLaw& law, const std::vector<ElasticPoint>& first, const std::vector<ElasticPoint>& second,
                  const std::vector<Matrix3>& Q, const std::string& what) {
  const auto a = law(first), b = law(second);
  double stress = law.modulus(), energy = law.modulus();
  for (std::size_t k = 0; k < a.size(); ++k) {
    expect_valid(law, first[k], a[k]);
    expect_valid(law, second[k], b[k]);
    stress = std::max(stress, norm(a[k].tau));
    energy = std::max({energy, std::abs(a[k].energy), std::abs(a[k].tensile_energy)});
  }
  const double tolerance = law.by_precision(1e-11, 3e-5);
  for (std::size_t k = 0; k < a.size(); ++k) {
    const Symmetric3 expected = turned(Q[k], a[k].tau);
    const double apart = norm(sum(b[k].tau, expected, -1));
    if (!(apart <= tolerance * stress))
      throw Failed{what + ": tau is " + list_text(b[k].tau) + " in place of " + list_text(expected) + " Pa, " +
                   short_text(apart) + " Pa apart, " + law.text(first[k])};
    if (!(std::abs(a[k].energy - b[k].energy) <= tolerance * energy))
      throw Failed{what + ": the energy is " + short_text(b[k].energy) + " in place of " + short_text(a[k].energy) +
                   " J/m^3, " + law.text(first[k])};
    if (!(std::abs(a[k].tensile_energy - b[k].tensile_energy) <= tolerance * energy))
      throw Failed{what + ": psi_plus is " + short_text(b[k].tensile_energy) + " in place of " +
                   short_text(a[k].tensile_energy) + " J/m^3, " + law.text(first[k])};
  }
}

void objectivity(Context& context) {
  for_each_law(context, Forms::all_precisions, 4, [&](const ElasticLaw& law, Random& random) {
    std::vector<ElasticPoint> first, second;
    std::vector<Matrix3> Q;
    const double spread = spread_of(random);
    for (int k = 0; k < 24; ++k) {
      first.push_back(random_point(random, spread, random.uniform()));
      second.push_back(first.back());
      Q.push_back(random.rotation());
      second.back().F = product(Q.back(), first.back().F);
    }
    expect_equal(law, first, second, Q, "the body was turned, and its stress did not turn with it");

    const ElasticPoint start = first[0];
    const Matrix3 axes = random.rotation(), step = rotation({axes[0], axes[1], axes[2]}, pi / 180);
    first.assign(360, start);
    second = first;
    Q.assign(360, step);
    for (std::size_t k = 0; k < 360; ++k) {
      second[k].F = product(step, k ? second[k - 1].F : start.F);
      if (k) Q[k] = product(step, Q[k - 1]);
    }
    expect_equal(law, first, second, Q, "in a full turn of 360 steps");
  });
}

/// Turns of the material that no law with these fibres can tell: about a single fibre, by half a turn about each of two.
/// Without fibres, any.
Matrix3 symmetry(const ElasticLaw& law, const ElasticPoint& point, Random& random) {
  if (!law.has_fiber()) return random.rotation();
  if (!law.has_second_fiber()) return rotation(point.fiber, random.uniform(0, 2 * pi));
  const Vector3 &a = point.fiber, &b = point.second_fiber;
  const Vector3 normal{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  const int which = random.below(3);
  return rotation(which == 0 ? a : which == 1 ? b : normal, pi);
}

void material_symmetry(Context& context) {
  bool declared = false;
  for_each_law(context, Forms::all_precisions, 4, [&](const ElasticLaw& law, Random& random) {
    if (!law.has_fiber() && !law.can(CLEAVE_ISOTROPIC)) return;
    declared = true;
    std::vector<ElasticPoint> first, second, flipped;
    const double spread = spread_of(random);
    for (int k = 0; k < 24; ++k) {
      first.push_back(random_point(random, spread, random.uniform()));
      const ElasticPoint& point = first.back();
      second.push_back(point);
      second.back().F = product(point.F, symmetry(law, point, random));
      flipped.push_back(point);
      if (random.below(2))
        for (double& x : flipped.back().fiber) x = -x;
      else
        for (double& x : flipped.back().second_fiber) x = -x;
    }
    const std::vector<Matrix3> still(first.size(), identity());
    expect_equal(law, first, second, still,
                 !law.has_fiber() ? "declared isotropic, but turning the material before straining it changes its stress"
                 : law.has_second_fiber() ? "half a turn of the material about an axis of its fibres changes its stress"
                                          : "turning the material about its fibre changes its stress");
    if (law.has_fiber()) expect_equal(law, first, flipped, still, "a fibre that points the other way changes the stress");
  });
  if (!declared) context.skip("declares neither isotropy nor fibres");
}

/// (d psi / d F) F^T by central differences with `step`.
std::vector<Matrix3> energy_derivatives(const ElasticLaw& law, const std::vector<ElasticPoint>& points, double step) {
  const std::vector<ElasticPoint> moved = moved_each_way(points, step);
  const auto answers = law(moved);
  std::vector<Matrix3> derivatives;
  for (std::size_t k = 0; k < points.size(); ++k) {
    Matrix3 P;
    for (std::size_t i = 0; i < 9; ++i) {
      const std::size_t at = 18 * k + 2 * i;
      expect_valid(law, moved[at], answers[at]);
      expect_valid(law, moved[at + 1], answers[at + 1]);
      P[i] = (answers[at].energy - answers[at + 1].energy) / (2 * step);
    }
    derivatives.push_back(product(P, transpose(points[k].F)));
  }
  return derivatives;
}

/// Undegraded and without fibres, tau/J is the effective stress.
void expect_effective_stress(const ElasticLaw& law, const std::vector<ElasticPoint>& points) {
  if (!law.can(CLEAVE_HAS_EFFECTIVE_STRESS) || law.has_fiber()) return;
  const auto degraded = law(points, ElasticLaw::effective);
  auto undegraded = points;
  for (ElasticPoint& point : undegraded) point.g = 1;
  const auto intact = law(undegraded);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const double J = determinant(points[k].F), scale = law.modulus() + norm(intact[k].tau) / J;
    Symmetric3 expected = intact[k].tau;
    for (double& x : expected) x /= J;
    if (!(norm(sum(degraded[k].effective_stress, expected, -1)) <= 1e-9 * scale))
      throw Failed{"the effective stress is " + list_text(degraded[k].effective_stress) + " in place of tau/J at g = 1, " +
                   list_text(expected) + " Pa, " + law.text(points[k])};
  }
}

void stress_is_energy_derivative(Context& context) {
  if (!context.plugin().can(CLEAVE_HAS_ENERGY)) context.skip("no energy declared");
  for_each_law(context, Forms::double_precision, 4, [&](const ElasticLaw& law, Random& random) {
    std::vector<ElasticPoint> points;
    const double spread = spread_of(random);
    for (double g : degradations)
      for (int k = 0; k < 4; ++k) points.push_back(random_point(random, spread, g));
    expect_effective_stress(law, points);
    const auto answers = law(points);
    const auto coarse = energy_derivatives(law, points, 2e-5), fine = energy_derivatives(law, points, 1e-5);
    double largest = 0;
    for (const auto& answer : answers) largest = std::max(largest, norm(answer.tau));
    for (std::size_t k = 0; k < points.size(); ++k) {
      expect_valid(law, points[k], answers[k]);
      const double scale = std::max(norm(answers[k].tau), 0.01 * largest);
      // Where the two steps disagree the energy has a kink.
      if (norm(sum(coarse[k], fine[k], -1)) > 5e-7 * scale) continue;
      const Symmetric3 expected = symmetric_part(fine[k]);
      if (!(norm(sum(fine[k], full(expected), -1)) <= 1e-6 * scale))
        context.fail("(dpsi/dF) F^T is not symmetric: the energy changes when the body turns, " + law.text(points[k]));
      const double apart = norm(sum(answers[k].tau, expected, -1));
      if (!(apart <= 1e-6 * scale))
        context.fail("tau is " + list_text(answers[k].tau) + " Pa and the derivative of the energy " + list_text(expected) +
                     ", " + short_text(apart / scale) + " of it apart, " + law.text(points[k]));
    }
  });
}

/// psi = g psi_plus + rest, neither depending on g; the rest not negative, and psi_plus not where nothing is compressed.
void expect_parts(const ElasticLaw& law, const std::vector<ElasticPoint>& points, bool stretched) {
  constexpr double values[] = {0, 1, 0.5, 0.001};
  std::vector<std::vector<ElasticResponse>> at;
  double scale = law.modulus() * 1e-3;
  for (double g : values) {
    auto degraded = points;
    for (auto& point : degraded) point.g = g;
    at.push_back(law(degraded));
    for (const auto& answer : at.back()) scale = std::max({scale, std::abs(answer.energy), std::abs(answer.tensile_energy)});
  }
  const double rounding = law.by_precision(1e-10, 1e-4) * scale;
  for (std::size_t k = 0; k < points.size(); ++k) {
    expect_valid(law, points[k], at[0][k]);
    const double rest = at[0][k].energy, tension = at[1][k].tensile_energy;
    for (std::size_t i = 1; i < 4; ++i) {
      const auto& answer = at[i][k];
      if (!(std::abs(answer.tensile_energy - tension) <= rounding))
        throw Failed{"psi_plus is " + short_text(answer.tensile_energy) + " J/m^3 at g = " + short_text(values[i]) + " and " +
                     short_text(tension) + " at g = 1; it is not degraded, " + law.text(points[k])};
      if (!(std::abs(answer.energy - rest - values[i] * tension) <= rounding))
        throw Failed{"psi is not g psi_plus + psi_minus + psi_fiber: from g = 0 to " + short_text(values[i]) + " it grows by " +
                     short_text(answer.energy - rest) + " J/m^3, and g psi_plus is " + short_text(values[i] * tension) + ", " +
                     law.text(points[k])};
    }
    if (!(rest >= -rounding))
      throw Failed{"psi_minus + psi_fiber is " + short_text(rest) + " J/m^3, below the energy at rest, " + law.text(points[k])};
    if (stretched && !(tension >= -rounding))
      throw Failed{"psi_plus is " + short_text(tension) + " J/m^3, below the energy at rest, though nothing is compressed, " +
                   law.text(points[k])};
  }
}

/// Energies on both sides of each point, which differ in its F by 1e-8.
void expect_continuous(const ElasticLaw& law, const std::vector<ElasticPoint>& below, const std::vector<ElasticPoint>& above,
                       const std::string& where) {
  const auto a = law(below), b = law(above);
  for (std::size_t k = 0; k < a.size(); ++k) {
    expect_valid(law, below[k], a[k]);
    expect_valid(law, above[k], b[k]);
    const double slope = law.modulus() + norm(a[k].tau) + norm(b[k].tau);
    for (const auto part : {&ElasticResponse::energy, &ElasticResponse::tensile_energy})
      if (!(std::abs(a[k].*part - b[k].*part) <= 1e-6 * slope))
        throw Failed{std::string(part == &ElasticResponse::energy ? "psi" : "psi_plus") + " jumps from " +
                     short_text(a[k].*part) + " to " + short_text(b[k].*part) + " J/m^3 across " + where + ", " +
                     law.text(below[k])};
  }
}

void energy_split(Context& context) {
  if (!context.plugin().can(CLEAVE_HAS_ENERGY)) context.skip("no energy declared");
  for_each_law(context, Forms::double_precision, 4, [&](const ElasticLaw& law, Random& random) {
    const double spread = spread_of(random);
    std::vector<ElasticPoint> points, stretched, below, above, shorter, longer;
    for (int k = 0; k < 24; ++k) {
      points.push_back(random_point(random, spread));
      stretched.push_back(points.back());
      const auto grown = [&] { return std::exp(random.uniform(0, spread)); };
      stretched.back().F = product(product(random.rotation(), diagonal(grown(), grown(), grown())), random.rotation());
    }
    expect_parts(law, points, false);
    expect_parts(law, stretched, true);

    for (auto point : points) {
      point.g = degradations[random.below(3)];
      const double length = norm(product(point.F, point.fiber)), volume = std::cbrt(determinant(point.F));
      for (double side : {-1e-8, 1e-8}) {
        ElasticPoint at = point;
        for (double& x : at.F) x *= (1 + side) / volume;
        (side < 0 ? below : above).push_back(at);
        for (std::size_t i = 0; i < 9; ++i) at.F[i] = point.F[i] * (1 + side) / length;
        (side < 0 ? shorter : longer).push_back(at);
      }
    }
    expect_continuous(law, below, above, "J = 1");
    if (law.has_fiber()) expect_continuous(law, shorter, longer, "the length at rest of the fibre");
  });
}

}  // namespace

std::vector<Check> elasticity_checks() {
  return {
      {"elasticity.reference-state", 25, "The reference state has neither stress nor energy, however it is turned.",
       elasticity_kind, reference_state},
      {"elasticity.objectivity", 26, "Stress turns with the body, and a full turn in 360 steps changes nothing.",
       elasticity_kind, objectivity},
      {"elasticity.symmetry", 27,
       "A law declared isotropic does not know how the material was turned, and one with fibres knows only their axes.",
       elasticity_kind, material_symmetry},
      {"elasticity.stress-is-energy-derivative", 28,
       "Stress is the derivative of the energy to 1e-6, intact and degraded; the effective stress is tau/J at g = 1.",
       elasticity_kind, stress_is_energy_derivative},
      {"elasticity.energy-split", 30,
       "psi = g psi_plus + psi_minus + psi_fiber with parts that do not depend on g, continuous across J = 1; psi_minus + "
       "psi_fiber is not negative, and psi_plus is not where nothing is compressed.",
       elasticity_kind, energy_split},
  };
}

}  // namespace cleave::testkit
