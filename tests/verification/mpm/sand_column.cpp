// Columns of dry sand that collapse (problem 8): the run-out dr of a column of the radius (half width) r and the height a r.
// Lube et al. 2004, 2005 find it to depend on a alone, for sands of all kinds, on floors of all kinds:
//
//   round   dr/r = 1.24 a (a < 1.7), 1.6 sqrt(a)       plane   dr/r = 1.2 a (a < 1.8), 1.9 a^(2/3) (a > 2.8)

#include "scenes.hpp"

#include "figure.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace cleave::test {
namespace {

/// A half of a plane column, or a quarter of a round one, between walls of symmetry.
struct Column : PointScene {
  static constexpr double r = 0.2, density = 1500;
  /// Degrees. The cone is as strong in plane strain, q = sqrt(3) sin(31) p, as sand that stands at 31 degrees.
  static constexpr double friction_angle = 22.8;
  Column(int dimension, double a, int cells)
      : PointScene(dimension, r / cells, points(dimension, a, cells), law(), moduli(), density) {
    auto& s = scene.simulation;
    s.gravity = Vector3(0, -9.81, 0);
    s.precision = config::Precision::single_precision;
    config::PluginUse sand;
    sand.id = "plasticity/drucker-prager";
    sand.parameters = {{"friction_angle", friction_angle}};
    scene.materials[0].plasticity = sand;
    config::Collider floor = half_space(config::Contact::sticky, Vector3(0, 1, 0));
    floor.name = "floor";
    scene.colliders.push_back(floor);
    for (int axis = 0; axis < dimension; axis += 2) {
      config::Collider wall = half_space(config::Contact::slip, axis == 0 ? Vector3::UnitX() : Vector3::UnitZ());
      wall.name = axis == 0 ? "left" : "back";
      scene.colliders.push_back(wall);
    }
  }

 private:
  static std::string law() { return "elasticity/split-neo-hookean"; }
  static plugins::GivenParameters moduli() { return {{"youngs_modulus", 1e6}, {"poissons_ratio", 0.3}}; }
  static std::vector<Point> points(int dimension, double a, int cells) {
    auto points = lattice(dimension, r / cells, 2, Vector3(0, 0, 0), Vector3(r, a * r, r));
    if (dimension == 3) std::erase_if(points, [](const Point& p) { return std::hypot(p.x.x(), p.x.z()) > r; });
    return points;
  }
};

/// Where the deposit is thinner than half a layer of particles, over r, less 1.
double run_out(int dimension, double a, int cells) {
  const Column s(dimension, a, cells);
  const auto simulation = s.start();
  const double end = 6 * std::sqrt(a * Column::r / 9.81);  // three times that of the fall and the spread
  while (simulation->time() < end) simulation->step(end);
  const double dx = Column::r / cells;
  std::vector<double> volume;  // by distance, in cells
  for (const auto& p : simulation->state()) {
    const double from = dimension == 3 ? std::hypot(p.position.x(), p.position.z()) : p.position.x();
    const auto i = std::size_t(std::max(0.0, from / dx));
    if (i >= volume.size()) volume.resize(i + 1);
    volume[i] += p.volume;
  }
  for (std::size_t i = 0; i < volume.size(); i++) {
    const double area = dimension == 3 ? M_PI / 4 * (2 * double(i) + 1) * dx * dx : dx;
    if (volume[i] / area < dx / 4) return (double(i) * dx) / Column::r - 1;
  }
  return double(volume.size()) * dx / Column::r - 1;
}

TEST(SandColumn, RunsOutAsSandsDo) {
  struct Case {
    int dimension, cells;
    double a, expected;
  };
  for (const Case& c : {Case{2, 20, 1, 1.2}, Case{2, 20, 3, 1.9 * std::pow(3., 2. / 3)}, Case{3, 10, 1, 1.24},
                        Case{3, 10, 3, 1.6 * std::sqrt(3.)}})
    report({.row = 8,
            .problem = fmt::format("{} column, a = {:g}, dx = r/{}", c.dimension == 2 ? "plane" : "round", c.a, c.cells),
            .quantity = "run-out / r",
            .reference = c.expected,
            .measured = run_out(c.dimension, c.a, c.cells),
            .tolerance = 0.4 * c.expected,
            .scatter = 0.1});
}

}  // namespace
}  // namespace cleave::test
