// Bars and beams of finite elements against closed forms.
#include "figure.hpp"
#include "specimen.hpp"

#include <algorithm>

namespace cleave::test {
namespace {

const double pi = std::acos(-1.0);

std::function<bool(const Point&, Point&, Point&)> clamped_at_zero() {
  return [](const Point& rest, Point&, Point&) { return rest[0] < 1e-9; };
}

TEST(FiniteElementPatch, StrainsUniformlyWhereItsSurfaceDoes) {
  // Vertices inside are anywhere and free; those of the surface follow an affine map, in which only what is inside is solved
  // for.
  constexpr int n = 4;
  Tets cube = Tets::box(n, n, n, {0.01, 0.01, 0.01});
  const auto outside = [](const Point& x) {
    return std::any_of(x.begin(), x.end(), [](double c) { return c < 1e-6 || c > n * 0.01 - 1e-6; });
  };
  unsigned seed = 3;
  for (std::size_t k = 0; k < cube.vertices.size(); ++k) {
    seed = seed * 1664525u + 1013904223u;
    if (!outside(cube.at(k / 3))) cube.vertices[k] += 0.002 * (2.0 * (seed >> 8) / (1u << 24) - 1);
  }
  const Tensor A = {1.2, 0.3, 0, -0.1, 0.9, 0.2, 0.1, 0, 1.1};
  const NeoHookean law(1e5, 0.3);
  Specimen solid(Texts{{"integrator", "quasi-static"}, {"tolerance", "1e-11"}});
  solid.add(cube, &law);
  solid.handle = [&](const Point& rest, Point& x, Point&) {
    for (int i = 0; i < 3; ++i) {
      x[std::size_t(i)] = 0;
      for (int j = 0; j < 3; ++j) x[std::size_t(i)] += A(i, j) * rest[std::size_t(j)];
    }
    return outside(rest);
  };
  const auto F = solid.step(1).field("F");
  for (std::size_t k = 0; k < F.size(); ++k) EXPECT_NEAR(F[k], A[int(k % 9)], 1e-9);
}

/// Velocity of the centre of mass of a bar that is clamped at one end, L = 25 m, E = 100 Pa, 1 kg/m^3, in its first mode:
/// (2/pi) v0 cos(omega t), omega = pi c/(2 L), c = sqrt(E/rho).
struct VibratingBar {
  static constexpr double length = 25, modulus = 100, speed = 0.1;
  const double omega = pi * std::sqrt(modulus) / (2 * length), period = 2 * pi / omega, amplitude = 2 / pi * speed;
  const NeoHookean law{modulus, 0};
  Tets bar;
  std::vector<double> mass;

  explicit VibratingBar(int cells) : bar(Tets::box(cells, 1, 1, {length / cells, 1, 1})) {
    bar.density = 1;
    mass = bar.masses();
    for (std::size_t v = 0; v < bar.size(); ++v) bar.velocity[3 * v] = speed * std::sin(pi * bar.at(v)[0] / (2 * length));
  }
  double velocity(const Specimen& solid) const {
    const auto v = solid.vertex_velocity();
    double sum = 0, total = 0;
    for (std::size_t k = 0; k < mass.size(); ++k) {
      sum += mass[k] * v[3 * k];
      total += mass[k];
    }
    return sum / total;
  }
};

TEST(FiniteElementBar, VibratesInItsFirstMode) {
  const VibratingBar b(50);
  Specimen solid;
  solid.add(b.bar, &b.law);
  solid.handle = clamped_at_zero();
  const double start = kinetic_energy(b.mass, b.bar.velocity);
  const int steps = int(3 * b.period / solid.stable_step()) + 1;
  const double step = 3 * b.period / steps;
  double off = 0;
  for (int n = 1; n <= steps; ++n) {
    solid.step(step);
    off = std::max(off, std::abs(b.velocity(solid) - b.amplitude * std::cos(b.omega * (n - 0.5) * step)));
  }
  RecordProperty("velocity", std::to_string(off / b.amplitude));
  EXPECT_LT(off, 0.005 * b.amplitude) << "over three periods";
  const double end = kinetic_energy(b.mass, solid.vertex_velocity()) + solid.elastic_energy();
  RecordProperty("energy", std::to_string(end / start - 1));
  EXPECT_NEAR(end / start, 1, 0.001);
}

TEST(FiniteElementBar, IsDampedByBackwardEulerAsItShouldBe) {
  // 1/(1 - i omega dt) per step: smaller by (1 + (omega dt)^2)^(-1/2), and behind by arctan(omega dt).
  const VibratingBar b(25);
  Specimen solid(Texts{{"integrator", "implicit"}});
  solid.add(b.bar, &b.law);
  solid.handle = clamped_at_zero();
  const int steps = 60;
  const double step = b.period / steps, x = b.omega * step;
  for (int n = 1; n <= steps; ++n) {
    solid.step(step);
    EXPECT_NEAR(b.velocity(solid) / b.amplitude, std::pow(1 + x * x, -0.5 * n) * std::cos(n * std::atan(x)), 0.005) << n;
  }
}

double tip(const Specimen& solid, const Tets& body, std::size_t axis) {
  const auto x = solid.vertices();
  double far = 0, sum = 0;
  int count = 0;
  for (std::size_t v = 0; v < body.size(); ++v) far = std::max(far, body.at(v)[0]);
  for (std::size_t v = 0; v < body.size(); ++v)
    if (body.at(v)[0] > far - 1e-9) {
      sum += x[3 * v + axis] - body.at(v)[axis];
      ++count;
    }
  return sum / count;
}

TEST(FiniteElementBar, HangsByItsWeight) {
  // Longer by rho g L^2/(2 E).
  const NeoHookean law(1e6, 0);
  const Tets bar = Tets::box(20, 1, 1, {0.05, 0.05, 0.05});
  Specimen solid(Texts{{"integrator", "quasi-static"}});
  solid.add(bar, &law);
  solid.gravity = {0.1, 0, 0};
  solid.handle = clamped_at_zero();
  solid.step(1);
  EXPECT_NEAR(tip(solid, bar, 0) / (1000 * 0.1 / 2e6), 1, 2e-3);
}

/// The line of a beam clamped level, loaded downwards: EI theta'' = -(P + w (L - s)) cos theta, theta(0) = theta'(L) = 0.
/// Drop and shortening of its end over L, by shooting from the end with Runge and Kutta's method. Loads are P L^2/EI, w L^3/EI.
struct Elastica {
  double drop, shortening;
  Elastica(double P, double w) {
    const auto at_clamp = [&](double end) {
      constexpr int n = 2000;
      const double h = 1.0 / n;
      double theta = end, slope = 0;
      drop = shortening = 0;
      const auto bend = [&](double from_end, double angle) { return (P + w * from_end) * std::cos(angle); };
      for (int k = 0; k < n; ++k) {  // along t = L - s: theta'' = -(P + w t) cos theta
        const double t = k * h, k1 = -bend(t, theta), k2 = -bend(t + h / 2, theta + h / 2 * slope);
        const double k3 = -bend(t + h / 2, theta + h / 2 * slope + h * h / 4 * k1);
        const double k4 = -bend(t + h, theta + h * slope + h * h / 2 * k2);
        const double middle = theta + h / 2 * slope + h * h / 8 * k1, next = theta + h * slope + h * h / 6 * (k1 + k2 + k3);
        drop += h / 6 * (std::sin(theta) + 4 * std::sin(middle) + std::sin(next));
        shortening += h / 6 * (6 - std::cos(theta) - 4 * std::cos(middle) - std::cos(next));
        theta = next;
        slope += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
      }
      return theta;
    };
    double low = 0, high = pi / 2;
    for (int n = 0; n < 60; ++n) (at_clamp((low + high) / 2) < 0 ? low : high) = (low + high) / 2;
  }
};

TEST(Elastica, HasThePublishedDropAndShortening) {
  const double published[4][3] = {{1, 0.3017, 0.0564}, {2, 0.4935, 0.1606}, {3, 0.6033, 0.2544}, {10, 0.8106, 0.5550}};
  for (const auto& [load, drop, shortening] : published) {
    const Elastica line(load, 0);
    const std::string problem = "elastica by shooting, P L^2/EI = " + std::to_string(int(load));
    report({.row = 6, .problem = problem, .quantity = "drop / L", .reference = drop, .measured = line.drop, .tolerance = 1e-4});
    report({.row = 6,
            .problem = problem,
            .quantity = "shortening / L",
            .reference = shortening,
            .measured = line.shortening,
            .tolerance = 1e-4});
  }
}

/// A beam 20 times as long as high under its weight w L^3/EI, `across` cells high.
std::array<double, 2> cantilever(double load, int across) {
  const double length = 1, height = 0.05, modulus = 1e6;
  const SaintVenantKirchhoff law(modulus, 0);
  Tets beam = Tets::box(20 * across, 2, across, {length / (20 * across), height / 2, height / across});
  const double inertia = height * height * height * height / 12, weight = load * modulus * inertia / (length * length * length);
  Specimen solid(Texts{{"integrator", "quasi-static"}});
  solid.add(beam, &law);
  solid.handle = clamped_at_zero();
  solid.gravity = {0, 0, -weight / (height * height * beam.density)};
  solid.step(1);
  return {-tip(solid, beam, 2), -tip(solid, beam, 0)};
}

TEST(FiniteElementCantilever, ConvergesToTheElastica) {
  // Linear tetrahedra are too stiff in bending, by an error that falls with the square of their size.
  for (const double load : {0.1, 4.0}) {
    const Elastica line(0, load);
    double errors[3];
    for (int k = 0; k < 3; ++k) {
      const auto [drop, shortening] = cantilever(load, 2 << k);
      errors[k] = drop / line.drop - 1;
      RecordProperty("drop_" + std::to_string(int(10 * load)) + "_" + std::to_string(2 << k), std::to_string(errors[k]));
      if (k == 2) {
        EXPECT_NEAR(shortening / line.shortening, 1, 0.15);
      }
    }
    EXPECT_LT(errors[0], errors[1]);
    EXPECT_LT(errors[1], errors[2]);
    report({.row = 6,
            .problem =
                load < 1 ? "finite elements, w L^3/EI = 0.1, 8 cells across" : "finite elements, w L^3/EI = 4, 8 cells across",
            .quantity = "drop / that of the elastica",
            .reference = 1,
            .measured = 1 + errors[2],
            .tolerance = 0.08,
            .order = order_of(errors[1], errors[2])});
    EXPECT_NEAR(errors[2] + (errors[2] - errors[1]) / 3, 0, 0.03) << "extrapolated, " << load;
  }
}

}  // namespace
}  // namespace cleave::test
