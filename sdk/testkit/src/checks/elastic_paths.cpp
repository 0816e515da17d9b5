// What an elastic law does along paths: around closed cycles, and out to collapse, inversion and enormous stretches.
#include "elastic_law.hpp"

namespace cleave::testkit {
namespace {

constexpr double pi = 3.14159265358979323846;

/// F(t) = J^(1/3) R D S of period 2 pi, R(t) a rotation, D(t) = A diag(e^e_i) A^T of determinant 1, S(t) = I + gamma u v^T a
/// simple shear; J stays on one side of 1, where laws that take tension and compression apart have their kink.
class Cycle {
 public:
  explicit Cycle(Random& random)
      : frame_(random.rotation()),
        shear_frame_(random.rotation()),
        fibers_(random_point(random, 0)),
        g_(random.uniform(0.2, 1)) {
    for (double& x : phase_) x = random.uniform(0, 2 * pi);
    const double size = random.uniform(0.3, 1);
    shape_ = 0.2 * size;
    shear_ = 0.4 * size;
    const int volume = random.below(3);
    mean_volume_ = volume == 0 ? 1.05 : volume == 1 ? 1.2 : 0.85;
    volume_ = volume == 0 ? 0 : 0.12 * size;
  }

  struct Place {
    ElasticPoint point;
    Symmetric3 rate;  ///< symmetric part of (dF/dt) F^-1
  };
  Place at(double t) const {
    const auto wave = [&](int i, int times) { return std::sin(times * t + phase_[i]); };
    const auto slope = [&](int i, int times) { return times * std::cos(times * t + phase_[i]); };
    const double e0 = shape_ * wave(0, 1), e1 = shape_ * (wave(1, 1) + 0.5 * wave(2, 2));
    const double de0 = shape_ * slope(0, 1), de1 = shape_ * (slope(1, 1) + 0.5 * slope(2, 2));
    const double gamma = shear_ * wave(3, 1), dgamma = shear_ * slope(3, 1);
    const double J = mean_volume_ + volume_ * wave(4, 1), dJ = volume_ * slope(4, 1);
    const Matrix3 R = rotation({frame_[0], frame_[1], frame_[2]}, wave(5, 1));
    const Matrix3 D = turned(frame_, diagonal(std::exp(e0), std::exp(e1), std::exp(-e0 - e1)));
    const Matrix3 D_inverse = turned(frame_, diagonal(std::exp(-e0), std::exp(-e1), std::exp(e0 + e1)));
    const Matrix3 uv = turned(shear_frame_, Matrix3{0, 1, 0, 0, 0, 0, 0, 0, 0});
    Place place;
    place.point = fibers_;
    place.point.g = g_;
    place.point.F = product(product(R, D), sum(identity(), uv, gamma));
    for (double& x : place.point.F) x *= std::cbrt(J);
    // R' R^-1 is a spin, which no symmetric stress works on.
    Matrix3 rate = sum(turned(frame_, diagonal(de0, de1, -de0 - de1)), product(product(D, uv), D_inverse), dgamma);
    rate = sum(turned(R, rate), identity(), dJ / (3 * J));
    place.rate = symmetric_part(rate);
    return place;
  }

 private:
  Matrix3 frame_, shear_frame_;
  ElasticPoint fibers_;
  double g_, phase_[6], shape_, shear_, mean_volume_, volume_;
};

struct Work {
  double net = 0, peak = 0;  ///< J/m^3
};

/// Trapezoidal rule, which converges faster than any power of 1/steps along a smooth closed path.
Work work_along(const ElasticLaw& law, const Cycle& cycle, int steps) {
  std::vector<ElasticPoint> points;
  std::vector<Symmetric3> rates;
  for (int k = 0; k < steps; ++k) {
    const auto place = cycle.at(2 * pi * k / steps);
    points.push_back(place.point);
    rates.push_back(place.rate);
  }
  const auto answers = law(points);
  Work work;
  double low = 0, high = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    expect_valid(law, points[k], answers[k]);
    work.net += dot(full(answers[k].tau), full(rates[k])) * 2 * pi / steps;
    low = std::min(low, work.net);
    high = std::max(high, work.net);
    work.peak = std::max(work.peak, std::abs(answers[k].energy));
  }
  work.peak = std::max(work.peak, high - low);
  return work;
}

void closed_cycle(Context& context) {
  const bool wide = context.plugin().can(CLEAVE_DOUBLE);
  for_each_law(context, wide ? Forms::double_precision : Forms::all_precisions, 4, [&](const ElasticLaw& law, Random& random) {
    const Cycle cycle(random);
    const double tolerance = law.by_precision(1e-10, 1e-4);
    // At kinks of the stress the rule converges slowly: the net work is then known to what more steps change in it.
    constexpr int rounds = 4;
    double net[rounds], peak = 0, unknown = 0;
    for (int i = 0; i < rounds; ++i) {
      const Work work = work_along(law, cycle, 512 << i);
      if (std::abs(work.net) <= tolerance * work.peak) return;
      net[i] = work.net;
      peak = work.peak;
      if (i) unknown = std::max(unknown, 4 * std::abs(net[i] - net[i - 1]));
    }
    const double left = std::abs(net[rounds - 1]);
    if (!(left <= tolerance * peak + unknown))
      context.fail("a closed cycle of strain " + std::string(net[rounds - 1] > 0 ? "takes up " : "gives off ") +
                   short_text(left) + " J/m^3, " + short_text(left / peak) + " of its peak energy; one of its states is " +
                   law.text(cycle.at(0).point));
  });
}

/// Whatever has no status is finite.
void expect_nothing_silent(const ElasticLaw& law, const ElasticPoint& point, const ElasticResponse& r) {
  if (r.status > CLEAVE_STATUS_FATAL) throw Failed{"a status that does not exist, " + law.text(point)};
  if (!r.valid()) return;
  const auto expect_finite = [&](double size, const char* what) {
    if (!std::isfinite(size)) throw Failed{std::string(what) + " is not finite and no status says so, " + law.text(point)};
  };
  expect_finite(dot(full(r.tau), identity()) + r.tau[3] + r.tau[4] + r.tau[5], "the stress");
  expect_finite(r.energy, "the energy");
  expect_finite(r.tensile_energy, "psi_plus");
  expect_finite(r.wave_modulus, "the wave modulus");
  double sum_of_effective = 0, sum_of_P = 0, sum_of_dP = 0;
  for (double x : r.effective_stress) sum_of_effective += x;
  for (double x : r.P) sum_of_P += x;
  for (double x : r.dP) sum_of_dP += x;
  expect_finite(sum_of_effective, "the effective stress");
  expect_finite(sum_of_P, "PIOLA");
  expect_finite(sum_of_dP, "DELTA_P");
}

/// Stretches over many orders of magnitude, mirrored, flat, and nothing at all.
std::vector<ElasticPoint> extreme_points(const ElasticLaw& law, Random& random) {
  const double range = law.by_precision(6, 3) * std::log(10.);
  std::vector<ElasticPoint> points;
  for (int k = 0; k < 32; ++k) {
    points.push_back(random_point(random, k < 16 ? range : 0.3, degradations[random.below(3)]));
    if (random.below(2)) points.back().F = product(points.back().F, diagonal(-1, 1, 1));
  }
  const double all = std::exp(random.uniform(-range, range));
  for (const Matrix3& D : {diagonal(1, 1, 0), diagonal(1, 0, 0), diagonal(0, 0, 0), diagonal(1, 1, 1e-6), diagonal(1, 1, -1e-6),
                           diagonal(1, 1, -1), diagonal(-1, -1, -1), diagonal(all, all, all), diagonal(-all, -all, -all)})
    for (bool turned : {false, true}) {
      points.push_back(random_point(random, 0));
      points.back().F = turned ? product(product(random.rotation(), D), random.rotation()) : D;
    }
  for (ElasticPoint& point : points)
    for (double& x : point.dF) x = random.uniform(-1, 1);
  return points;
}

/// One axis pressed flat and through, the others moderately strained, fibres across it: the stress drives it back out, and
/// with it the energy falls.
void expect_restoring(const ElasticLaw& law, Random& random) {
  const double thin = law.by_precision(1e-4, 1e-2);
  const Matrix3 left = random.rotation(), right = random.rotation();
  const Vector3 u{left[2], left[5], left[8]};
  const double a = random.uniform(0.7, 1.4), b = random.uniform(0.7, 1.4), angle = random.uniform(0, 2 * pi);
  const std::vector<double> stretches{-0.5, -0.25, -0.1, -thin, thin, 0.1, 0.3};
  std::vector<ElasticPoint> points;
  for (double stretch : stretches) {
    ElasticPoint point;
    point.F = product(product(left, diagonal(a, b, stretch)), right);
    point.fiber = product(transpose(right), Vector3{std::cos(angle), std::sin(angle), 0});
    point.second_fiber = product(transpose(right), Vector3{-std::sin(angle), std::cos(angle), 0});
    points.push_back(point);
  }
  const auto answers = law(points);
  for (std::size_t k = 0; k < points.size(); ++k) {
    expect_valid(law, points[k], answers[k]);
    // P : (u v^T), the power of the stress as the stretch grows.
    const double power = dot(u, product(full(answers[k].tau), u)) / stretches[k];
    if (!(power < 0))
      throw Failed{"declared inversion safe, but with one axis at " + short_text(stretches[k]) +
                   " of its length the stress presses it further: P along it is " + short_text(power) + " Pa, " +
                   law.text(points[k])};
    if (k && law.can(CLEAVE_HAS_ENERGY) && !(answers[k].energy < answers[k - 1].energy))
      throw Failed{"declared inversion safe, but the energy does not fall as an axis comes back from " +
                   short_text(stretches[k - 1]) + " to " + short_text(stretches[k]) + " of its length: from " +
                   short_text(answers[k - 1].energy) + " to " + short_text(answers[k].energy) + " J/m^3, " +
                   law.text(points[k])};
  }
}

void inversion(Context& context) {
  const Plugin& plugin = context.plugin();
  for_each_law(context, Forms::all_precisions, 6, [&](const ElasticLaw& law, Random& random) {
    const bool knows_sign = law.measure() == "F", safe = law.can(CLEAVE_INVERSION_SAFE);
    const auto points = extreme_points(law, random);
    const unsigned extras = (plugin.can(CLEAVE_HAS_WAVE_MODULUS) ? ElasticLaw::wave : 0u) |
                            (plugin.can(CLEAVE_HAS_EFFECTIVE_STRESS) ? ElasticLaw::effective : 0u) |
                            (plugin.can(CLEAVE_HAS_TANGENT) && knows_sign ? ElasticLaw::tangent : 0u) |
                            (plugin.can(CLEAVE_HAS_PIOLA) && knows_sign ? ElasticLaw::piola : 0u);
    const auto answers = law(points), with_extras = law(points, extras);
    for (std::size_t k = 0; k < points.size(); ++k) {
      expect_nothing_silent(law, points[k], answers[k]);
      expect_nothing_silent(law, points[k], with_extras[k]);
      const Matrix3& F = points[k].F;
      const double J = determinant(F), size = norm(F);
      // Along the axes a flat F is flat without rounding.
      const bool collapsed = F == diagonal(F[0], F[4], F[8]) && J == 0;
      if (safe) {
        if (!answers[k].valid()) context.fail("declared inversion safe, but has no finite stress " + law.text(points[k]));
        if ((extras & ElasticLaw::piola) && !with_extras[k].valid())
          context.fail("declared inversion safe with PIOLA, but not all of its outputs are finite along dF = " +
                       list_text(points[k].dF) + " " + law.text(points[k]));
      } else if ((collapsed || (knows_sign && J < -1e-3 * size * size * size)) && answers[k].valid()) {
        context.fail("J = " + short_text(J) + " has no status, and the law is not declared inversion safe, " +
                     law.text(points[k]));
      }
    }
    if (safe) expect_restoring(law, random);
  });
}

}  // namespace

std::vector<Check> elastic_paths_checks() {
  return {
      {"elasticity.closed-cycle", 32,
       "A closed cycle of strain takes no net work, to 1e-10 of its peak energy where the stress has no kinks.",
       elasticity_kind, closed_cycle},
      {"elasticity.inversion", 33,
       "Collapse, inversion and stretches of 1e-6 to 1e6 give a finite stress or a status; a law declared inversion safe gives "
       "a stress that drives an inverted point back, and with PIOLA finite outputs alone.",
       elasticity_kind, inversion},
  };
}

}  // namespace cleave::testkit
