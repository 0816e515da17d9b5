// What implicit and explicit steps ask of an elastic law beside tau: P and its differential, and the bound of the fastest wave.
#include "elastic_law.hpp"

namespace cleave::testkit {
namespace {

/// F of a point whose third axis is `stretch` times as long as at rest, the others moderately strained.
ElasticPoint thin_point(Random& random, double stretch, double g) {
  ElasticPoint point = random_point(random, 0, g);
  point.F = product(product(random.rotation(), diagonal(random.uniform(0.7, 1.4), random.uniform(0.7, 1.4), stretch)),
                    random.rotation());
  return point;
}

/// Central differences of psi by F, and how much those to its two sides differ: by the step times the stiffness, and by all of
/// it at a kink.
struct EnergyGradient {
  Matrix3 P{}, jump{};
};
std::vector<EnergyGradient> energy_gradients(const ElasticLaw& law, const std::vector<ElasticPoint>& points) {
  constexpr double step = 1e-5;
  const std::vector<ElasticPoint> moved = moved_each_way(points, step);
  const auto here = law(points), around = law(moved);
  std::vector<EnergyGradient> gradients(points.size());
  for (std::size_t k = 0; k < around.size(); k += 2) {
    expect_valid(law, moved[k], around[k]);
    expect_valid(law, moved[k + 1], around[k + 1]);
    EnergyGradient& gradient = gradients[k / 18];
    gradient.P[k / 2 % 9] = (around[k].energy - around[k + 1].energy) / (2 * step);
    gradient.jump[k / 2 % 9] = (around[k].energy - 2 * here[k / 18].energy + around[k + 1].energy) / step;
  }
  return gradients;
}

/// Where F cannot be divided by, tau says nothing of P along what is flat; the energy does.
void expect_gradient_when_flat(const ElasticLaw& law, Random& random) {
  std::vector<ElasticPoint> points;
  for (double g : degradations)
    for (double stretch : {0., 1e-3, -1e-3, -0.5}) points.push_back(thin_point(random, stretch, g));
  const auto answers = law(points, ElasticLaw::piola);
  const auto gradients = energy_gradients(law, points);
  for (std::size_t k = 0; k < points.size(); ++k) {
    expect_valid(law, points[k], answers[k]);
    const auto& [P, jump] = gradients[k];
    const double scale = norm(P) + 0.01 * law.modulus(), apart = norm(sum(answers[k].P, P, -1));
    if (!(apart <= 1e-6 * scale + norm(jump)))
      throw Failed{"declared inversion safe, but PIOLA is " + list_text(answers[k].P) +
                   " Pa and the derivative of the energy " + list_text(P) + ", " + short_text(apart / scale) +
                   " of it apart, " + law.text(points[k])};
  }
}

void piola_stress(Context& context) {
  const Plugin& plugin = context.plugin();
  if (!plugin.can(CLEAVE_HAS_PIOLA)) context.skip("no first Piola-Kirchhoff stress declared");
  if (!plugin.can(CLEAVE_ACCEPTS_F)) context.skip("it is asked for with F, which the law does not accept");
  for_each_law(context, Forms::all_precisions, 6, [&](const ElasticLaw& law, Random& random) {
    if (law.measure() != "F") return;
    const bool safe = law.can(CLEAVE_INVERSION_SAFE);
    std::vector<ElasticPoint> points;
    for (double g : degradations)
      for (int k = 0; k < 8; ++k) {
        points.push_back(random_point(random, 0.22 * std::exp(random.uniform(-2, 1.2)), g));
        if (safe && k % 4 == 0) points.back().F = product(points.back().F, diagonal(1, -1, 1));
        if (safe && k % 4 == 1) points.back() = thin_point(random, 1e-3, g);
      }
    const auto answers = law(points, ElasticLaw::piola);
    for (std::size_t k = 0; k < points.size(); ++k) {
      expect_valid(law, points[k], answers[k]);
      const Matrix3 tau = full(answers[k].tau), pulled = product(answers[k].P, transpose(points[k].F));
      const double size = norm(answers[k].P) * norm(points[k].F) + law.modulus(), apart = norm(sum(pulled, tau, -1));
      if (!(apart <= law.by_precision(1e-11, 3e-5) * size))
        context.fail("PIOLA F^T is " + list_text(pulled) + " Pa and TAU " + list_text(tau) + ", " + short_text(apart / size) +
                     " of it apart, " + law.text(points[k]));
    }
    if (safe && law.can(CLEAVE_HAS_ENERGY) && law.precision() == Precision::double_precision)
      expect_gradient_when_flat(law, random);
  });
}

/// dP along point.dF by central differences of P, which is tau F^-T where the law was not asked for it.
std::vector<Matrix3> piola_differences(const ElasticLaw& law, const std::vector<ElasticPoint>& points, double step,
                                       bool ask_for_piola) {
  std::vector<ElasticPoint> moved;
  for (const ElasticPoint& point : points)
    for (double sign : {1, -1}) {
      moved.push_back(point);
      moved.back().F = sum(point.F, point.dF, sign * step / norm(point.dF));
    }
  const auto answers = law(moved, ask_for_piola ? ElasticLaw::piola : ElasticLaw::nothing);
  const auto P = [&](std::size_t k) {
    expect_valid(law, moved[k], answers[k]);
    return ask_for_piola ? answers[k].P : piola(answers[k].tau, moved[k].F);
  };
  std::vector<Matrix3> differences;
  for (std::size_t k = 0; k < points.size(); ++k) {
    Matrix3 dP = sum(P(2 * k), P(2 * k + 1), -1);
    for (double& x : dP) x *= norm(points[k].dF) / (2 * step);
    differences.push_back(dP);
  }
  return differences;
}

/// Points are groups of `directions` that share F: DELTA_P is the difference of stresses, and symmetric if there is an energy.
void expect_tangent(Context& context, const ElasticLaw& law, const std::vector<ElasticPoint>& points, std::size_t directions,
                    bool ask_for_piola) {
  const auto answers = law(points, ElasticLaw::tangent);
  const auto coarse = piola_differences(law, points, 2e-5, ask_for_piola);
  const auto fine = piola_differences(law, points, 1e-5, ask_for_piola);
  for (std::size_t first = 0; first < points.size(); first += directions) {
    double stiffness = 0.01 * law.modulus();
    for (std::size_t k = first; k < first + directions; ++k)
      stiffness = std::max(stiffness, norm(fine[k]) / norm(points[k].dF));
    for (std::size_t k = first; k < first + directions; ++k) {
      expect_valid(law, points[k], answers[k]);
      const double scale = stiffness * norm(points[k].dF);
      const double apart = norm(sum(answers[k].dP, fine[k], -1));
      // Where the two steps disagree the stress has a kink.
      if (!(norm(sum(coarse[k], fine[k], -1)) > 5e-6 * scale) && !(apart <= 1e-5 * scale))
        context.fail("DELTA_P is " + list_text(answers[k].dP) + " Pa and the difference of stresses " + list_text(fine[k]) +
                     ", " + short_text(apart / scale) + " of it apart, along dF = " + list_text(points[k].dF) + " " +
                     law.text(points[k]));
      for (std::size_t other = first; law.can(CLEAVE_HAS_ENERGY) && other < k; ++other) {
        const double there = dot(points[k].dF, answers[other].dP), back = dot(points[other].dF, answers[k].dP);
        if (!(std::abs(there - back) <= 1e-9 * stiffness * norm(points[k].dF) * norm(points[other].dF)))
          context.fail("the law has an energy, but its tangent is not symmetric: dF1 : dP(dF2) = " + short_text(there) +
                       " J/m^3, and " + short_text(back - there) + " more for dF2 : dP(dF1), with dF1 = " +
                       list_text(points[k].dF) + ", dF2 = " + list_text(points[other].dF) + " " + law.text(points[k]));
      }
    }
  }
}

void tangent(Context& context) {
  const Plugin& plugin = context.plugin();
  if (!plugin.can(CLEAVE_HAS_TANGENT)) context.skip("no tangent declared");
  if (!plugin.can(CLEAVE_ACCEPTS_F)) context.skip("the tangent is asked for with F, which it does not accept");
  for_each_law(context, Forms::double_precision, 4, [&](const ElasticLaw& law, Random& random) {
    if (law.measure() != "F") return;
    constexpr std::size_t directions = 4;
    const double spread = 0.22 * std::exp(random.uniform(-2, 1.2));
    const auto in_all_directions = [&](std::vector<ElasticPoint>& points, ElasticPoint point) {
      for (std::size_t i = 0; i < directions; ++i) {
        const double size = std::exp(random.uniform(-7, 7));
        for (double& x : point.dF) x = size * random.uniform(-1, 1);
        points.push_back(point);
      }
    };
    std::vector<ElasticPoint> points, inverted;
    for (double g : degradations)
      for (int k = 0; k < 4; ++k) in_all_directions(points, random_point(random, spread, g));
    expect_tangent(context, law, points, directions, false);
    if (!law.can(CLEAVE_INVERSION_SAFE) || !law.can(CLEAVE_HAS_PIOLA)) return;
    for (double g : degradations)
      for (double stretch : {0.01, 0., -0.01, -0.4}) in_all_directions(inverted, thin_point(random, stretch, g));
    expect_tangent(context, law, inverted, directions, true);
  });
}

/// a_ijkl = (d tau_ij along (e_k e_l^T) F) - tau_il delta_jk: a wave along n that moves along m has
/// rho_0 c^2 = a_ijkl m_i n_j m_k n_l through the current configuration.
using SpatialTangent = std::array<double, 81>;

SpatialTangent spatial_tangent(const ElasticLaw& law, const ElasticPoint& point, double step) {
  std::vector<ElasticPoint> moved{point};
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t l = 0; l < 3; ++l)
      for (double sign : {1, -1}) {
        moved.push_back(point);
        for (std::size_t j = 0; j < 3; ++j) moved.back().F[3 * k + j] += sign * step * point.F[3 * l + j];
      }
  const auto answers = law(moved);
  const Matrix3 tau = full(answers[0].tau);
  SpatialTangent a{};
  for (std::size_t kl = 0; kl < 9; ++kl) {
    const auto &plus = answers[1 + 2 * kl], &minus = answers[2 + 2 * kl];
    expect_valid(law, moved[1 + 2 * kl], plus);
    expect_valid(law, moved[2 + 2 * kl], minus);
    const Matrix3 dtau = full(sum(plus.tau, minus.tau, -1));
    const std::size_t k = kl / 3, l = kl % 3;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        a[27 * i + 9 * j + 3 * k + l] = dtau[3 * i + j] / (2 * step) - (j == k ? tau[3 * i + l] : 0);
  }
  return a;
}

/// q of x . q x, a with the other two places taken by y: those of n if `of_motion`, of m otherwise.
Symmetric3 contracted(const SpatialTangent& a, const Vector3& y, bool of_motion) {
  Matrix3 q{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t l = 0; l < 3; ++l) {
          const double value = a[27 * i + 9 * j + 3 * k + l];
          if (of_motion)
            q[3 * i + k] += value * y[j] * y[l];
          else
            q[3 * j + l] += value * y[i] * y[k];
        }
  return symmetric_part(q);
}

/// Power iteration, shifted so that the largest eigenvalue is the one of the largest size: x . q x never falls.
Vector3 towards_largest(const Symmetric3& q, Vector3 x, int steps) {
  const double shift = norm(q);
  for (int step = 0; shift > 0 && step < steps; ++step) {
    const Vector3 next = sum(product(full(q), x), x, shift);
    const double length = norm(next);
    if (!(length > 0)) break;
    for (std::size_t i = 0; i < 3; ++i) x[i] = next[i] / length;
  }
  return x;
}

struct Wave {
  double modulus = 0;  ///< rho_0 c^2 [Pa]
  Vector3 direction{}, motion{};
};

/// The fastest wave: directions on a spiral over half a sphere, the best of them refined by turns in n and m.
Wave fastest_wave(const SpatialTangent& a) {
  constexpr int directions = 120;
  std::vector<Wave> waves;
  for (int k = 0; k < directions; ++k) {
    const double z = (k + 0.5) / directions, r = std::sqrt(1 - z * z), angle = 2.399963229728653 * k;
    Wave wave{0, {r * std::cos(angle), r * std::sin(angle), z}, {}};
    const Symmetric3 q = contracted(a, wave.direction, true);
    wave.motion = towards_largest(q, sum(wave.direction, Vector3{0.3, -0.2, 0.1}), 12);
    wave.modulus = dot(wave.motion, product(full(q), wave.motion));
    waves.push_back(wave);
  }
  std::partial_sort(waves.begin(), waves.begin() + 4, waves.end(),
                    [](const Wave& x, const Wave& y) { return x.modulus > y.modulus; });
  for (auto wave = waves.begin(); wave != waves.begin() + 4; ++wave) {
    for (int round = 0; round < 20; ++round) {
      wave->direction = towards_largest(contracted(a, wave->motion, false), wave->direction, 4);
      wave->motion = towards_largest(contracted(a, wave->direction, true), wave->motion, 4);
    }
    wave->modulus = dot(wave->motion, product(full(contracted(a, wave->direction, true)), wave->motion));
  }
  return *std::max_element(waves.begin(), waves.begin() + 4,
                           [](const Wave& x, const Wave& y) { return x.modulus < y.modulus; });
}

void wave_modulus(Context& context) {
  if (!context.plugin().can(CLEAVE_HAS_WAVE_MODULUS)) context.skip("no wave modulus declared");
  for_each_law(context, Forms::double_precision, 8, [&](const ElasticLaw& law, Random& random) {
    const double spread = 0.22 * std::exp(random.uniform(-2, 1.2));
    std::vector<ElasticPoint> points{ElasticPoint{}};
    for (int k = 0; k < 6; ++k) {
      points.push_back(random_point(random, spread, degradations[random.below(3)]));
      if (k % 3 == 0 && law.can(CLEAVE_INVERSION_SAFE) && law.measure() == "F")
        points.back().F = product(points.back().F, diagonal(-1, 1, 1));
    }
    const auto answers = law(points, ElasticLaw::wave);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double bound = answers[k].wave_modulus;
      expect_valid(law, points[k], answers[k]);
      if (!std::isfinite(bound) || !(bound > 0))
        context.fail("WAVE_MODULUS is " + short_text(bound) + " Pa, no positive finite number, " + law.text(points[k]));
      const Wave wave = fastest_wave(spatial_tangent(law, points[k], 1e-5));
      if (bound >= 0.99 * wave.modulus) continue;
      // Where another step gives another stiffness, as near a kink of the stress, differences are not the tangent.
      const double fine = fastest_wave(spatial_tangent(law, points[k], 1e-6)).modulus;
      if (std::abs(fine - wave.modulus) <= 0.005 * wave.modulus)
        context.fail("WAVE_MODULUS is " + short_text(bound) + " Pa, but differences of the stress give rho_0 c^2 = " +
                     short_text(wave.modulus) + " Pa for a wave along " + list_text(wave.direction) + " that moves along " +
                     list_text(wave.motion) + ", " + law.text(points[k]));
    }
  });
}

}  // namespace

std::vector<Check> elastic_stiffness_checks() {
  return {
      {"elasticity.tangent", 29,
       "The stress differential is the difference of stresses to 1e-5, and symmetric if the law has an energy.",
       elasticity_kind, tangent},
      {"elasticity.piola", 70,
       "P F^T is the Kirchhoff stress to rounding, intact and degraded; a law declared inversion safe gives the derivative of "
       "its energy where F is flat or inverted, too.",
       elasticity_kind, piola_stress},
      {"elasticity.wave-modulus", 31,
       "The wave modulus is finite, positive and at least 0.99 of that of the fastest wave, fibres included.", elasticity_kind,
       wave_modulus},
  };
}

}  // namespace cleave::testkit
