// Moduli of the peridynamic solid against those it is given.
#include "figure.hpp"
#include "specimen.hpp"

namespace cleave::test {
namespace {

constexpr double mu = 1e5, kappa = 2e5, strain = 1e-4, instant = 1e-9;

using Matrix = std::array<Point, 3>;
const Matrix volume = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, shear_xy = {{{0, 1, 0}, {0, 0, 0}, {0, 0, 0}}},
             shear_xz = {{{0, 0, 1}, {0, 0, 0}, {0, 0, 0}}}, stretch_xz = {{{0.5, 0, 0}, {0, 0, 0}, {0, 0, -0.5}}},
             stretch_xy = {{{0.5, 0, 0}, {0, -0.5, 0}, {0, 0, 0}}};
const Matrix shears[] = {shear_xy, shear_xz, stretch_xy, stretch_xz};

/// Energy density of points under a uniform strain, over that of the continuum: 9/2 kappa eps^2, or mu/2 gamma^2.
std::vector<double> relative_energy(const Texts& parameters, Points points, const Matrix& E) {
  points.towards(
      [&](const Point& x) {
        Point y = x;
        for (std::size_t a = 0; a < 3; ++a)
          for (std::size_t b = 0; b < 3; ++b) y[a] += strain * E[a][b] * x[b];
        return y;
      },
      instant);
  auto energy = Specimen(parameters).add(points).step(instant).field("energy");
  const bool isotropic = E[0][0] == E[1][1] && E[0][0] != 0;
  for (double& e : energy) e /= (isotropic ? 4.5 * kappa : 0.5 * mu) * strain * strain;
  return energy;
}
double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v / double(values.size());
  return sum;
}

TEST(PeridynamicModuli, AreRecoveredInside) {
  const Points cube = Points::box(13, 13, 13);
  for (const char* horizon : {"1.45", "2.2", "3.015"}) {
    const Texts parameters = {{"horizon", horizon}};
    const std::string problem = std::string("inside of a lattice, horizon ") + horizon;
    report({.row = 22,
            .problem = problem,
            .quantity = "bulk modulus / kappa",
            .reference = 1,
            .measured = relative_energy(parameters, cube, volume)[cube.size() / 2],
            .tolerance = 1e-3});
    double farthest = 1;
    for (const Matrix& shear : shears) {
      const double modulus = relative_energy(parameters, cube, shear)[cube.size() / 2];
      if (std::abs(modulus - 1) > std::abs(farthest - 1)) farthest = modulus;
    }
    report({.row = 22,
            .problem = problem,
            .quantity = "shear modulus / mu, worst of four orientations",
            .reference = 1,
            .measured = farthest,
            .tolerance = 0.02});
  }
  // Without weights that make it so, a lattice is not isotropic: by 12 % at the horizon of 1.45 spacings.
  const Texts published = {{"horizon", "1.45"}, {"deviatoric", "published"}};
  EXPECT_LT(relative_energy(published, cube, shear_xy)[cube.size() / 2], 0.95);
  EXPECT_GT(relative_energy(published, cube, stretch_xy)[cube.size() / 2], 1.1);
}

TEST(PeridynamicModuli, AreRecoveredWhereTheSurfaceIsNear) {
  // A plate four points thick, wide enough that its edges hardly count.
  const Points plate = Points::box(24, 24, 4);
  for (const char* horizon : {"1.45", "3.015"}) {
    const Texts parameters = {{"horizon", horizon}};
    EXPECT_NEAR(mean(relative_energy(parameters, plate, volume)), 1, 0.05) << horizon;
    for (const Matrix& shear : shears) EXPECT_NEAR(mean(relative_energy(parameters, plate, shear)), 1, 0.05) << horizon;
  }
  const Texts uncorrected = {{"horizon", "3.015"}, {"surface_correction", "false"}};
  EXPECT_LT(mean(relative_energy(uncorrected, plate, volume)), 0.7);
  EXPECT_LT(mean(relative_energy(uncorrected, plate, shear_xz)), 0.8);
}

/// A beam of 8 x 8 x 32 points pulled by its ends until it rests; lateral over longitudinal strain of its middle third.
double poissons_ratio(double given) {
  constexpr int across = 8, along = 32;
  Points beam = Points::box(along, across, across);
  Specimen solid(Texts{{"youngs_modulus", "1e5"}, {"poissons_ratio", std::to_string(given)}, {"air_damping", "0.02"}});
  const double pulled = 1e-3, h = beam.spacing;
  const auto uniaxial = [&](const Point& x) { return Point{(1 + pulled) * x[0], x[1], x[2]}; };
  solid.add(beam.towards(uniaxial, instant)).step(instant);
  solid.handle = [&](std::size_t, std::size_t i, Point& x, Point& v) {
    x = uniaxial(beam.at(i));
    v = {};
    return x[0] < 1.5 * h || x[0] > (along - 2.5) * h;
  };
  // The velocity that led to the stretch in one step is taken back by holding all points for one.
  const auto ends = solid.handle;
  solid.handle = [&](std::size_t b, std::size_t i, Point& x, Point& v) {
    ends(b, i, x, v);
    return true;
  };
  solid.step(instant);
  solid.handle = ends;
  solid.step(0.9 * solid.stable_step(), 700);
  const auto x = solid.field("position");
  const auto place = [&](int i, int j, int k) { return std::size_t((i * across + j) * across + k); };
  double lateral = 0, longitudinal = 0;
  const int first = along / 2 - 4, last = along / 2 + 3;
  for (int j = 0; j < across; ++j)
    for (int k = 0; k < across; ++k)
      longitudinal += (x[3 * place(last, j, k)] - x[3 * place(first, j, k)]) / ((last - first) * h) - 1;
  for (int i = first; i <= last; ++i)
    for (int k = 0; k < across; ++k)
      lateral += (x[3 * place(i, across - 1, k) + 1] - x[3 * place(i, 0, k) + 1]) / ((across - 1) * h) - 1;
  return -(lateral / (8 * across)) / (longitudinal / (across * across));
}

TEST(PeridynamicBeam, ContractsByPoissonsRatio) {
  for (const double nu : {0.1, 0.2, 0.3, 0.4, 0.45})
    report({.row = 22,
            .problem = "pulled beam",
            .quantity = "Poisson's ratio of " + std::to_string(nu).substr(0, 4),
            .reference = nu,
            .measured = poissons_ratio(nu),
            .tolerance = 0.02});
}

/// Period of the first longitudinal mode of a free bar of nu = 0: 2 L/c, c = sqrt(E/rho).
TEST(PeridynamicBar, VibratesWithTheSpeedOfSound) {
  constexpr int along = 40, across = 4;
  Points bar = Points::box(along, across, across);
  const double length = along * bar.spacing, c = std::sqrt(1e5 / bar.density), pi = std::acos(-1.0);
  for (std::size_t i = 0; i < bar.size(); ++i)
    bar.velocity[3 * i] = 1e-3 * std::cos(pi * (bar.at(i)[0] + bar.spacing / 2) / length);
  Specimen solid(Texts{{"youngs_modulus", "1e5"}, {"poissons_ratio", "0"}, {"integrator", "velocity-verlet"}});
  solid.add(bar);
  const double step = 0.8 * solid.stable_step();
  // The amplitude crosses zero at a quarter and at three quarters of the period.
  double before = 1, crossings[2] = {}, time = 0;
  for (int found = 0; found < 2 && time < 10 * length / c; time += step) {
    const auto v = solid.step(step).field("velocity");
    double amplitude = 0;
    for (std::size_t i = 0; i < bar.size(); ++i) amplitude += v[3 * i] * bar.velocity[3 * i];
    if (amplitude * before < 0) crossings[found++] = time + step * before / (before - amplitude);
    before = amplitude;
  }
  EXPECT_NEAR(2 * (crossings[1] - crossings[0]) / (2 * length / c), 1, 0.02);
}

}  // namespace
}  // namespace cleave::test
