// Cracks in sheets with straight fibers at angles from 0 to 90 degrees.

#include "crack_scenes.hpp"

#include "figure.hpp"

#include <iostream>

namespace cleave::test {
namespace {

constexpr double cell_size = 1. / 48, l0 = 0.02, critical_stress = 1e4;

/// Without lateral contraction there is no tension out of the plane, which no fiber in the plane would hold.
plugins::GivenParameters matrix(double fiber_scale) {
  return {{"youngs_modulus", 1e6},
          {"poissons_ratio", 0.0},
          {"calibration", std::string("small-strain")},
          {"fiber_scale", fiber_scale}};
}

struct FiberSheet : Sheet {
  FiberSheet(const std::vector<Point>& points, double degrees, double fiber_scale)
      : Sheet(cell_size, points, "elasticity/qr", matrix(fiber_scale), 1000,
              use("damage/anisotropic", {{"critical_stress", critical_stress},
                                         {"structural_alpha", std::vector<double>{-1}},
                                         {"length_scale", l0},
                                         {"viscosity", 1e-4},
                                         {"integration", std::string("implicit")}})) {
    const double angle = degrees * M_PI / 180;
    scene.materials[0].fibers.emplace();
    scene.materials[0].fibers->direction = Vector3(std::cos(angle), std::sin(angle), 0);
  }
};

struct Line {
  double degrees = 0, length = 0, width = 0;  ///< m
};

/// Principal axes of the broken particles (d > 1/2) that `counts`, in material coordinates. A rectangle has the length and
/// width sqrt(12) times the standard deviations.
template <class Counts>
Line fit(const Sheet& sheet, const std::vector<mpm::ParticleState>& state, Counts&& counts) {
  double n = 0, xx = 0, yy = 0, xy = 0;
  Vector3 mean = Vector3::Zero();
  for (std::size_t i = 0; i < state.size(); i++) {
    const Vector3& x = sheet.points[i].x;
    if (state[i].damage <= 0.5 || !counts(x)) continue;
    n++;
    mean += x;
    xx += x.x() * x.x();
    yy += x.y() * x.y();
    xy += x.x() * x.y();
  }
  if (n < 3) return {};
  mean /= n;
  xx = xx / n - mean.x() * mean.x();
  yy = yy / n - mean.y() * mean.y();
  xy = xy / n - mean.x() * mean.y();
  const double half = std::hypot((xx - yy) / 2, xy), middle = (xx + yy) / 2;
  return {std::atan2(2 * xy, xx - yy) / 2 * 180 / M_PI, std::sqrt(12 * (middle + half)),
          std::sqrt(12 * std::max(0.0, middle - half))};
}

/// A disc with a small hole, pulled outwards all round: the tension across the fibers is the same at any angle.
struct Disc : FiberSheet {
  static constexpr double radius = 0.5, hole = 0.06, strain_rate = 0.2;
  explicit Disc(double degrees) : FiberSheet(ring(), degrees, 0) {
    constexpr int handles = 48;
    for (int k = 0; k < handles; k++) {
      const double angle = 2 * M_PI * (k + 0.5) / handles;
      hold(Vector3(radius, 0, 0), Vector3(0.1, 2 * M_PI * radius / handles, 1),
           0.47 * strain_rate * Vector3(std::cos(angle), std::sin(angle), 0), angle);
    }
  }

 private:
  static std::vector<Point> ring() {
    auto points = lattice(2, cell_size, 2, Vector3(-0.5, -0.5, 0), Vector3(0.5, 0.5, 0));
    std::erase_if(points, [](const Point& p) { return p.x.norm() > radius || p.x.norm() < hole; });
    for (auto& p : points) p.v = strain_rate * p.x;
    return points;
  }
};

class FiberTear : public testing::TestWithParam<int> {};

TEST_P(FiberTear, FollowsTheFibersOfADiscPulledAllRound) {
  const Disc disc(GetParam());
  const auto simulation = disc.start();
  Line crack;
  while (crack.length < 0.6 && simulation->time() < 0.08) {
    for (int i = 0; i < 10; i++) simulation->step(1);
    crack = fit(disc, simulation->state(), [](const Vector3& x) { return x.norm() < 0.4; });
  }
  std::cout << "fibers at " << GetParam() << ": crack at " << crack.degrees << " degrees, " << crack.length << " m long, "
            << crack.width << " m wide\n";
  EXPECT_GE(crack.length, 0.6);
  EXPECT_LT(crack.width, 0.2 * crack.length) << "one straight crack";
  report({.row = 20,
          .problem = "disc pulled all round, fibers at " + std::to_string(GetParam()) + " degrees",
          .quantity = "crack off the fibers, degrees",
          .measured = std::remainder(crack.degrees - GetParam(), 180),
          .tolerance = 5,
          .scatter = 0.3});
}

INSTANTIATE_TEST_SUITE_P(Degrees, FiberTear, testing::Values(0, 15, 30, 45, 60, 75, 90), testing::PrintToStringParamName());

/// A plate with a notch from its left edge, pulled up and down.
struct NotchedPlate : FiberSheet {
  static constexpr double notch_tip = 0.35, notch_radius = 0.05, strain_rate = 0.1;
  NotchedPlate(double degrees, double fiber_scale) : FiberSheet(cut(), degrees, fiber_scale) {
    for (double side : {-1.0, 1.0})
      hold(Vector3(0.5, side * 0.5, 0), Vector3(1.2, 0.2, 1), Vector3(0, side * strain_rate * 0.45, 0));
  }

 private:
  static std::vector<Point> cut() {
    auto points = lattice(2, cell_size, 2, Vector3(0, -0.5, 0), Vector3(1, 0.5, 0));
    std::erase_if(points, [](const Point& p) {
      return std::hypot(std::max(0.0, p.x.x() - (notch_tip - notch_radius)), p.x.y()) < notch_radius;
    });
    for (auto& p : points) p.v.y() = strain_rate * p.x.y();
    return points;
  }
};

Line grow(const NotchedPlate& plate) {
  const auto simulation = plate.start();
  Line crack;
  while (crack.length < 0.2 && simulation->time() < 0.1) {
    for (int i = 0; i < 10; i++) simulation->step(1);
    crack = fit(plate, simulation->state(),
                [](const Vector3& x) { return std::hypot(x.x() - NotchedPlate::notch_tip, x.y()) < 0.25; });
  }
  EXPECT_GE(crack.length, 0.2);
  return crack;
}

/// The driving force of the law knows the tension across the fibers, not the direction of a crack. A crack whose normal N is at
/// an angle b from the pull e is opened by (e . N)^2 of it, of which (n . N)^2 lies across the fibers, n their normal at the
/// angle phi: cos^2 b cos^2 (phi - b) is largest at b = phi/2. The crack halves the angle between the fibers and the normal of
/// the pull. (Where the tension is the same all round, e does not enter: b = phi, as in the disc.)
TEST(FiberTearOfANotchedPlate, TurnsHalfWayToTheFibersByTheLawAlone) {
  for (int degrees : {15, 30, 45, 60}) {
    const Line crack = grow(NotchedPlate(degrees, 0));
    std::cout << "soft fibers at " << degrees << ": crack at " << crack.degrees << " degrees\n";
    report({.row = 20,
            .problem = "notched plate, soft fibers at " + std::to_string(degrees) + " degrees",
            .quantity = "angle of the crack, half of the fibers', degrees",
            .reference = 0.5 * degrees,
            .measured = crack.degrees,
            .tolerance = 3,
            .scatter = 0.1});
  }
}

/// Fibers along the pull that are stiff and never degrade split from each other.
TEST(FiberTearOfANotchedPlate, SplitsAlongStiffFibers) {
  const Line crack = grow(NotchedPlate(90, 30));
  std::cout << "stiff fibers at 90: crack at " << crack.degrees << " degrees\n";
  report({.row = 20,
          .problem = "notched plate, stiff fibers along the pull",
          .quantity = "crack off the fibers, degrees",
          .measured = std::remainder(crack.degrees - 90, 180),
          .tolerance = 5,
          .scatter = 0.3});
}

}  // namespace
}  // namespace cleave::test
