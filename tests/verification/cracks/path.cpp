// Where a crack runs and when it gets there, against the size of the cells, with the length of the law fixed in metres.

#include "crack_scenes.hpp"

#include "figure.hpp"

#include <functional>
#include <iostream>

namespace cleave::test {
namespace {

const Solid solid{.E = 1e6, .nu = 0.2, .density = 1000};
constexpr double G = 20, l0 = 0.02, viscosity = 5e-4;

constexpr double notch_tip = 0.35, notch_radius = 0.05;

/// A square plate of one metre, [0,1] x [-1/2,1/2] in its own frame, with a notch from its left edge, pulled up and down. Its
/// frame is turned by `angle` against the grid.
struct Plate : Sheet {
  std::vector<Vector3> place;  ///< of the particles in the plate's frame

  using Inside = std::function<bool(const Vector3&)>;
  Plate(int cells, double angle, const Inside& hole)
      : Sheet(1.0 / cells, cut(cells, angle, hole), "elasticity/split-neo-hookean", solid.moduli(), solid.density,
              use("damage/phase-field", {{"energy_release_rate", G}, {"length_scale", l0}, {"mobility", 1 / viscosity}})) {
    for (const auto& p : points) place.push_back(in_plate(p.x, angle));
    for (double side : {-1.0, 1.0})
      hold(Vector3(0.5, side * 0.5, 0), Vector3(1.2, 0.15, 1), side * speed * turn(angle) * Vector3::UnitY(), angle);
  }

 private:
  static constexpr double speed = 0.04;
  static Matrix3 turn(double angle) { return Eigen::AngleAxisd(angle, Vector3::UnitZ()).toRotationMatrix(); }
  static Vector3 in_plate(const Vector3& x, double angle) { return turn(angle).transpose() * x; }
  static std::vector<Point> cut(int cells, double angle, const Inside& hole) {
    auto points = lattice(2, 1.0 / cells, 2, Vector3(-1, -1, 0), Vector3(2, 2, 0));
    std::erase_if(points, [&](const Point& p) {
      const Vector3 x = in_plate(p.x, angle);
      const double along = std::max(0.0, x.x() - (notch_tip - notch_radius));
      return x.x() < 0 || x.x() > 1 || std::abs(x.y()) > 0.5 || std::hypot(along, x.y()) < notch_radius || hole(x);
    });
    for (auto& p : points) p.v = 2 * speed * in_plate(p.x, angle).y() * (turn(angle) * Vector3::UnitY());
    return points;
  }
};

struct Stations {
  double first, spacing;
  int count;
  double width;  ///< the crack is looked for at |y| below
  double x(int i) const { return first + i * spacing; }
};

struct Crack {
  std::vector<double> arrival;  ///< s, when d = 1/2 comes to a station
  std::vector<double> y;        ///< m, mean of the particles with d > 1/2, within l0/2 of a station
};

/// Until the crack has passed the last station.
Crack grow(const Plate& plate, const Stations& stations) {
  const auto simulation = plate.start();
  Crack crack{std::vector<double>(std::size_t(stations.count), 0.0), {}};
  std::vector<mpm::ParticleState> state;
  const auto advance = [&](double end) {
    while (simulation->time() < end) simulation->step(end);
    state = simulation->state();
  };
  const auto for_broken = [&](int station, auto&& f) {
    for (std::size_t i = 0; i < state.size(); i++) {
      const Vector3& x = plate.place[i];
      if (state[i].damage > 0.5 && std::abs(x.x() - stations.x(station)) < l0 / 2 && std::abs(x.y()) < stations.width) f(x);
    }
  };
  advance(0.06);
  while (crack.arrival.back() == 0 && simulation->time() < 0.3) {
    advance(simulation->time() + 2.5e-4);
    for (int s = 0; s < stations.count; s++)
      if (double& arrival = crack.arrival[std::size_t(s)]; arrival == 0)
        for_broken(s, [&](const Vector3&) { arrival = simulation->time(); });
  }
  advance(simulation->time() + 5e-3);  // behind its tip a crack is several cells wide
  for (int s = 0; s < stations.count; s++) {
    double sum = 0, n = 0;
    for_broken(s, [&](const Vector3& x) {
      sum += x.y();
      n++;
    });
    crack.y.push_back(sum / n);
  }
  return crack;
}

using Values = std::vector<double>;
double largest_difference(const Values& a, const Values& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); i++) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

std::vector<Crack> at_all_resolutions(double angle, const Plate::Inside& hole, const Stations& stations) {
  std::vector<Crack> cracks;
  for (int cells : {32, 64, 128}) {
    cracks.push_back(grow(Plate(cells, angle, hole), stations));
    std::cout << "dx = 1/" << cells << " m\n";
    for (int s = 0; s < stations.count; s++)
      std::cout << "  x = " << stations.x(s) << " m: y = " << cracks.back().y[std::size_t(s)] << " m, reached at "
                << cracks.back().arrival[std::size_t(s)] << " s\n";
  }
  return cracks;
}

/// By symmetry the crack runs straight on from the notch, here 20 degrees off the grid, where the particles make steps of its
/// edges.
TEST(CrackPath, IsStraightAcrossTheGrid) {
  const Stations stations{.first = 0.4, .spacing = 0.1, .count = 6, .width = 0.3};
  const auto cracks = at_all_resolutions(
      20 * M_PI / 180, [](const Vector3&) { return false; }, stations);
  const double bound[] = {l0, l0, 0.25 * l0};
  for (std::size_t c = 0; c < cracks.size(); c++)
    for (double y : cracks[c].y) EXPECT_LT(std::abs(y), bound[c]);
  const double coarse = largest_difference(cracks[0].arrival, cracks[1].arrival),
               fine = largest_difference(cracks[1].arrival, cracks[2].arrival);
  const double growth = cracks[2].arrival.back() - cracks[2].arrival.front();
  std::cout << "arrival differs by " << coarse << " and " << fine << " s in " << growth << " s\n";
  EXPECT_LT(fine, 0.5 * coarse);
  const char* problem = "straight crack 20 degrees off the grid, l0 = 0.02 m";
  report({.row = 19,
          .problem = problem,
          .quantity = "arrival, dx = 1/64 to 1/128 m, of the time it takes",
          .measured = fine / growth,
          .tolerance = 0.025,
          .order = order_of(coarse, fine),
          .scatter = 0.3});
  report({.row = 19,
          .problem = problem,
          .quantity = "off its straight way, of l0",
          .measured = *std::max_element(cracks[2].y.begin(), cracks[2].y.end(),
                                        [](double a, double b) { return std::abs(a) < std::abs(b); }) /
                      l0,
          .tolerance = 0.25,
          .scatter = 0.5});

  double fastest = 0;  // between stations
  for (std::size_t s = 1; s < cracks[2].arrival.size(); s++)
    fastest = std::max(fastest, stations.spacing / (cracks[2].arrival[s] - cracks[2].arrival[s - 1]));
  std::cout << "fastest " << fastest << " m/s, " << fastest / solid.rayleigh_speed() << " of the Rayleigh speed\n";
  report({.row = 19,
          .problem = problem,
          .quantity = "fastest, of the Rayleigh speed",
          .reference = 0.65,
          .measured = fastest / solid.rayleigh_speed(),
          .judged = Judged::at_most,
          .scatter = 0.05});
}

/// A hole beside the way draws the crack to itself.
TEST(CrackPath, ConvergesWhereItCurves) {
  const Stations stations{.first = 0.38, .spacing = 0.02, .count = 5, .width = 0.14};
  const auto cracks = at_all_resolutions(
      0, [](const Vector3& x) { return std::hypot(x.x() - 0.6, x.y() - 0.25) < 0.12; }, stations);
  const double coarse = largest_difference(cracks[0].y, cracks[1].y), fine = largest_difference(cracks[1].y, cracks[2].y);
  std::cout << "path differs by " << coarse << " and " << fine << " m\n";
  const char* problem = "crack drawn by a hole, l0 = 0.02 m";
  EXPECT_LT(coarse, l0);
  report({.row = 19,
          .problem = problem,
          .quantity = "path, dx = 1/64 to 1/128 m, of l0",
          .measured = fine / l0,
          .tolerance = 0.25,
          .order = order_of(coarse, fine),
          .scatter = 0.5});
  report({.row = 19,
          .problem = problem,
          .quantity = "arrival, dx = 1/64 to 1/128 m, of the last",
          .measured = largest_difference(cracks[1].arrival, cracks[2].arrival) / cracks[2].arrival.back(),
          .tolerance = 0.02,
          .scatter = 0.5});
  for (std::size_t s = 1; s < cracks[2].y.size(); s++) EXPECT_GT(cracks[2].y[s], cracks[2].y[s - 1]) << "towards the hole";
}

}  // namespace
}  // namespace cleave::test
