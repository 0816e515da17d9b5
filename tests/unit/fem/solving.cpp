// Implicit and quasi-static steps.
#include "specimen.hpp"

namespace cleave::test {
namespace {

const NeoHookean rubber(1e5, 0.3);

/// Without an energy.
struct Energyless : NeoHookean {
  using NeoHookean::NeoHookean;
  double energy(const Tensor&) const override { return std::numeric_limits<double>::quiet_NaN(); }
};

/// -dE/dx of the elastic energy.
std::vector<double> forces(const Tets& rest, const std::vector<double>& x, const Law& law) {
  std::vector<double> f(x.size());
  for (std::size_t t = 0; t < rest.points(); ++t) {
    const std::uint32_t* c = &rest.tetrahedra[4 * t];
    Tensor X, Y;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        X(i, k) = rest.vertices[3 * c[k + 1] + unsigned(i)] - rest.vertices[3 * c[0] + unsigned(i)];
        Y(i, k) = x[3 * c[k + 1] + unsigned(i)] - x[3 * c[0] + unsigned(i)];
      }
    const Tensor B = inverse(X), H = rest.volume(t) * (law.stress(Y * B) * transpose(B));
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        f[3 * c[k + 1] + unsigned(i)] -= H(i, k);
        f[3 * c[0] + unsigned(i)] += H(i, k);
      }
  }
  return f;
}

/// What is left of m (v - v_n)/dt + alpha m v - f - m g, over the largest force.
double out_of_balance(const Tets& rest, const Specimen& solid, const std::vector<double>& before, double step, double damping,
                      const Law& law, const Point& gravity, const std::function<bool(const Point&)>& held) {
  const auto x = solid.vertices(), v = solid.vertex_velocity(), f = forces(rest, x, law), mass = rest.masses();
  double most = 0, left = 0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    most = std::max(most, std::abs(f[k]));
    if (held && held(rest.at(k / 3))) continue;
    left = std::max(left, std::abs(mass[k / 3] * ((v[k] - before[k]) / step + damping * v[k] - gravity[k % 3]) - f[k]));
  }
  return left / most;
}

TEST(ImplicitElements, SolveTheEquationsOfBackwardEuler) {
  Tets beam = Tets::box(8, 2, 2, {0.01, 0.01, 0.01});
  beam.shake(0.3);
  const auto held = [](const Point& x) { return x[0] < 1e-6; };
  const Energyless silent(1e5, 0.3);
  std::vector<double> reached[2];
  for (const Law* law : {static_cast<const Law*>(&rubber), static_cast<const Law*>(&silent)}) {
    Specimen solid(Texts{{"integrator", "implicit"}, {"mass_damping", "5"}, {"tolerance", "1e-9"}});
    solid.gravity = {0, 0, -10};
    solid.add(beam, law);
    solid.handle = [&](const Point& rest, Point&, Point&) { return held(rest); };
    const double step = 20 * Specimen().add(beam, &rubber).stable_step();
    for (int n = 0; n < 5; ++n) {
      const auto before = solid.vertex_velocity();
      solid.step(step);
      EXPECT_LT(out_of_balance(beam, solid, before, step, 5, rubber, {0, 0, -10}, held), 1e-7);
    }
    reached[law == &silent] = solid.vertices();
  }
  for (std::size_t k = 0; k < reached[0].size(); ++k) EXPECT_NEAR(reached[0][k], reached[1][k], 1e-8);
}

TEST(ImplicitElements, KeepMomentumAndLoseEnergy) {
  Tets cube = Tets::box(3, 3, 3, {0.01, 0.01, 0.01});
  const double step = 5 * Specimen().add(cube, &rubber).stable_step();
  cube.shake(0.2 * 0.01 / step);
  Specimen solid(Texts{{"integrator", "implicit"}, {"tolerance", "1e-9"}});
  solid.add(cube, &rubber);
  const auto mass = cube.masses();
  const Momentum before = momentum(mass, cube.vertices, cube.velocity);
  double energy = kinetic_energy(mass, cube.velocity);
  const double start = energy;
  for (int n = 0; n < 30; ++n) {
    solid.step(step);
    const double now = kinetic_energy(mass, solid.vertex_velocity()) + solid.elastic_energy();
    EXPECT_LT(now, energy * (1 + 1e-9));
    energy = now;
  }
  EXPECT_LT(energy, 0.5 * start);
  const Momentum after = momentum(mass, solid.vertices(), solid.vertex_velocity());
  for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(after.linear[a], before.linear[a], 1e-7 * before.size);
}

/// Both ends of a bar held, the right one stretched: without lateral strain (nu = 0) uniform.
TEST(QuasiStaticElements, PassThePatchTest) {
  const NeoHookean law(1e5, 0);
  const Tets bar = Tets::box(6, 2, 2, {0.01, 0.01, 0.01});
  Specimen solid(Texts{{"integrator", "quasi-static"}, {"tolerance", "1e-10"}});
  solid.add(bar, &law);
  solid.handle = [](const Point& rest, Point& x, Point&) {
    x[0] *= 1.4;
    return rest[0] < 1e-6 || rest[0] > 0.06 - 1e-6;
  };
  solid.step(1);
  // With lambda = 0 the sides feel nothing of the stretch.
  const auto F = solid.field("F");
  for (std::size_t k = 0; k < F.size(); ++k) EXPECT_NEAR(F[k], k % 9 == 0 ? 1.4 : k % 9 % 4 == 0 ? 1 : 0, 1e-8);
}

TEST(QuasiStaticElements, AreInEquilibriumWherePushedFarIntoThemselves) {
  // Compressed to 60 %: negative eigenvalues of the tangent on the way, and buckling to either side.
  const Tets bar = Tets::box(10, 2, 2, {0.01, 0.01, 0.01});
  const auto held = [](const Point& x) { return x[0] < 1e-6 || x[0] > 0.1 - 1e-6; };
  Specimen solid(Texts{{"integrator", "quasi-static"}});
  solid.add(bar, &rubber);
  double now = 1;
  solid.handle = [&](const Point& rest, Point& x, Point&) {
    x[0] *= now;
    return held(rest);
  };
  solid.gravity = {0, 0, -0.5};
  for (now = 0.9; now > 0.59; now -= 0.1) solid.step(1);
  EXPECT_LT(out_of_balance(bar, solid, solid.vertex_velocity(), 1e100, 0, rubber, {0, 0, -0.5}, held), 1e-4);
  double lowest = 0;
  for (std::size_t v = 0; v < bar.size(); ++v) lowest = std::min(lowest, solid.vertices()[3 * v + 2] - bar.at(v)[2]);
  EXPECT_LT(lowest, -0.02) << "it buckles downwards";
}

TEST(QuasiStaticElements, HaveToBeHeld) {
  const Tets cube = Tets::box(1, 1, 1, {0.01, 0.01, 0.01});
  const auto refused = [&](double up_to) {
    Specimen solid(Texts{{"integrator", "quasi-static"}});
    solid.add(cube, &rubber);
    solid.handle = [&](const Point& rest, Point&, Point&) { return rest[1] < 1e-6 && rest[2] < up_to && rest[0] < 1e-6; };
    try {
      solid.step(1);
      return false;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find("can move freely"), std::string::npos) << error.what();
      return true;
    }
  };
  EXPECT_TRUE(refused(-1));
  EXPECT_TRUE(refused(1)) << "two vertices";
  Specimen solid(Texts{{"integrator", "quasi-static"}});
  solid.add(cube, &rubber);
  solid.handle = [](const Point& rest, Point&, Point&) { return rest[0] < 1e-6; };
  EXPECT_NO_THROW(solid.step(1));
}

TEST(QuasiStaticElements, SayWhereTheLawEnds) {
  Specimen solid(Texts{{"integrator", "quasi-static"}});
  solid.add(Tets::box(2, 1, 1, {0.01, 0.01, 0.01}), &rubber);
  solid.handle = [](const Point& rest, Point& x, Point&) {
    x[0] = rest[0] > 0.015 ? -0.02 : rest[0];
    return true;
  };
  try {
    solid.step(1);
    ADD_FAILURE() << "solved";
  } catch (const std::runtime_error& error) {
    const std::string said = error.what();
    EXPECT_NE(said.find("body 'body': "), std::string::npos) << said;
    EXPECT_NE(said.find("is inside out; take smaller steps"), std::string::npos) << said;
  }
}

TEST(ImplicitElements, MeetColliders) {
  // Dropped from 5 mm onto an inclined plane, in steps in which it falls up to 4 mm.
  const double slope = 0.3;
  const Point n = {-std::sin(slope), 0, std::cos(slope)};
  const auto drop = [&](double friction, bool sticky) {
    Tets cube = Tets::box(2, 2, 2, {0.01, 0.01, 0.01}, {0, 0, 0});
    for (std::size_t v = 0; v < cube.size(); ++v) {  // stands on the plane
      const Point x = cube.at(v);
      for (std::size_t a = 0; a < 3; ++a)
        cube.vertices[3 * v + a] =
            x[0] * Point{std::cos(slope), 0, std::sin(slope)}[a] + (a == 1 ? x[1] : 0) + (x[2] + 0.005) * n[a];
    }
    Specimen solid(Texts{{"integrator", "implicit"}});
    solid.gravity = {0, 0, -10};
    solid.add(cube, &rubber);
    solid.collider = [&, friction, sticky](const Point& x, Point& v) {
      const double into = n[0] * v[0] + n[2] * v[2];
      if (n[0] * x[0] + n[2] * x[2] >= 0 || into >= 0) return;
      Point along = {v[0] - into * n[0], v[1], v[2] - into * n[2]};
      const double speed = std::hypot(along[0], along[1], along[2]);
      const double left = sticky || speed == 0 ? 0 : std::max(0.0, 1 + friction * into / speed);
      for (std::size_t a = 0; a < 3; ++a) v[a] = left * along[a];
    };
    solid.step(0.01, 60);
    const auto x = solid.vertices();
    double deepest = 1;
    Point centre{};
    for (std::size_t v = 0; v < cube.size(); ++v) {
      deepest = std::min(deepest, n[0] * x[3 * v] + n[2] * x[3 * v + 2]);
      for (std::size_t a = 0; a < 3; ++a) centre[a] += x[3 * v + a] / double(cube.size());
    }
    EXPECT_GT(deepest, -1e-6) << "none goes through";
    EXPECT_LT(deepest, 2e-3) << "it lands";
    const double down = (centre[0] - 0.01) * -std::cos(slope) - centre[2] * std::sin(slope) + 0.01 * std::sin(slope);
    return down;
  };
  // Free fall down the plane: g sin(slope) t^2/2 after it has landed.
  EXPECT_GT(drop(0, false), 0.3);
  EXPECT_LT(drop(1, false), 0.02);
  EXPECT_LT(drop(0, true), 0.01);
}

}  // namespace
}  // namespace cleave::test
