// How bodies of bonds move: what is kept, what is exact, and what meets.
#include "specimen.hpp"

namespace cleave::test {
namespace {

const Texts all_laws = {{"critical_stretch", "0.02"}, {"yield", "1e24"}, {"toughening", "1"}};

Texts with(Texts texts, const Texts& more) {
  texts.insert(more.begin(), more.end());
  return texts;
}

class InPrecision : public testing::TestWithParam<const char*> {
 protected:
  Texts precision() const { return {{"precision", GetParam()}}; }
  bool single() const { return std::string(GetParam()) == "single"; }
};
INSTANTIATE_TEST_SUITE_P(Peridynamics, InPrecision, testing::Values("single", "double"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(InPrecision, KeepsMomentumWhileItFlowsAndBreaks) {
  // Forces are equal and opposite to the bit, and summed in double: what is lost are the last bits of double.
  Points cube = Points::box(8, 8, 8, {-0.035, -0.035, -0.035});
  Specimen solid(with(precision(), all_laws));
  const double step = Specimen(with(precision(), all_laws)).add(cube).stable_step();
  cube.shake(0.05 * cube.spacing / step);
  solid.add(cube);
  const Momentum before = momentum(cube.position, cube.velocity);
  solid.step(0.25 * step, 100);
  const auto x = solid.field("position"), v = solid.field("velocity");
  ASSERT_GT(largest(solid.field("damage")), 0.05);
  ASSERT_GT(largest(solid.field("plastic_stretch")), 1e-4);
  const Momentum after = momentum(x, v);
  for (std::size_t a = 0; a < 3; ++a) {
    EXPECT_NEAR(after.linear[a], before.linear[a], 1e-14 * before.size);
    EXPECT_NEAR(after.angular[a], before.angular[a], (single() ? 1e-7 : 1e-13) * before.angular_size);
  }
}

TEST_P(InPrecision, RestsWhenTurned) {
  // 40 degrees about (1, 2, 3), far from the origin, in one step; then only what rounding leaves acts.
  Points cube = Points::box(7, 7, 7, {5, -3, 2});
  const double step = 1e-9;
  const auto turned = [](const Point& x) {
    const double angle = 0.7, norm = std::sqrt(14.0);
    const Point n = {1 / norm, 2 / norm, 3 / norm}, r = {x[0] - 5, x[1] + 3, x[2] - 2};
    const double along = n[0] * r[0] + n[1] * r[1] + n[2] * r[2];
    Point y;
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t b = (a + 1) % 3, c = (a + 2) % 3;
      y[a] = x[a] - r[a] + std::cos(angle) * r[a] + std::sin(angle) * (n[b] * r[c] - n[c] * r[b]) +
             (1 - std::cos(angle)) * along * n[a];
    }
    return y;
  };
  const auto stretched = [](const Point& x) { return Point{5 + 1.0001 * (x[0] - 5), x[1], x[2]}; };
  const auto energy = [&](const std::function<Point(const Point&)>& map) {
    Points moved = cube;
    return largest(Specimen(precision()).add(moved.towards(map, step)).step(step).field("energy"));
  };
  // Noise of 1e-7 in the stretch is one of 1e-6 in the energy of a strain of 1e-4.
  EXPECT_LT(energy(turned), (single() ? 1e-5 : 1e-15) * energy(stretched));
}

TEST_P(InPrecision, DoesNotCareHowFarFromTheOriginItIs) {
  const auto damage = [&](double away) {
    Points cube = Points::box(7, 7, 7, {away, -away, 0});
    const double step = Specimen(with(precision(), all_laws)).add(cube).stable_step();
    cube.shake(0.1 * cube.spacing / step);
    return Specimen(with(precision(), all_laws)).add(cube).step(0.3 * step, 20).field("energy");
  };
  const auto here = damage(0), there = damage(100);  // 1e4 spacings
  for (std::size_t i = 0; i < here.size(); ++i) EXPECT_NEAR(there[i], here[i], 1e-4 * largest(here)) << i;
}

TEST_P(InPrecision, ComputesTheSameBitsWithAnyNumberOfThreads) {
  const auto state = [&](unsigned threads) {
    Points cube = Points::box(11, 11, 11);
    Specimen solid(with(precision(), with(all_laws, {{"laplacian_damping", "0.1"}})));
    const double step = Specimen(precision()).add(cube).stable_step();
    solid.threads = threads;
    solid.add(cube.shake(0.05 * cube.spacing / step)).add(Points::box(4, 4, 4, {0.112, 0, 0}));
    return solid.step(0.3 * step, 20).save();
  };
  EXPECT_EQ(state(1), state(2));
}

TEST_P(InPrecision, GoesOnFromASavedStateWithTheSameBits) {
  const auto begin = [&] {
    Points cube = Points::box(6, 6, 6);
    Specimen solid(with(precision(), with(all_laws, {{"integrator", "velocity-verlet"}})));
    const double step = Specimen(precision()).add(cube).stable_step();
    Points other = Points::box(4, 4, 4, {0.061, 0.005, 0.005});
    for (std::size_t i = 0; i < other.velocity.size(); i += 3) other.velocity[i] = -0.05 * cube.spacing / step;
    solid.add(cube.shake(0.05 * cube.spacing / step)).add(other);
    return std::pair(std::move(solid), 0.3 * step);
  };
  auto [solid, step] = begin();
  const auto state = solid.step(step, 30).save();
  const auto expected = solid.step(step, 30).save();
  auto [fresh, same_step] = begin();
  fresh.restore(state);
  EXPECT_EQ(fresh.stable_step(), (solid.restore(state), solid.stable_step()));
  EXPECT_EQ(fresh.step(same_step, 30).save(), expected);
  auto broken = state;
  broken[broken.size() / 2] ^= 1;
  EXPECT_THROW(fresh.restore(broken), std::runtime_error);
}

TEST_P(InPrecision, BreaksNothingAtRest) {
  // Whatever the weights of the bonds are, none has a force in a body that moves as a whole.
  for (const char* correction : {"true", "false"})
    for (const char* split : {"corrected", "published"}) {
      Texts parameters =
          with(precision(), {{"critical_stretch", "1e-6"}, {"surface_correction", correction}, {"deviatoric", split}});
      Points body = Points::mesh(4, 4, 4, {3, 1, -2});
      for (std::size_t i = 0; i < body.size(); ++i) body.velocity[3 * i] = 1;
      Specimen solid(parameters);
      solid.add(body);
      EXPECT_EQ(largest(solid.step(0.5 * solid.stable_step(), 60).field("damage")), 0);
    }
}

TEST(Peridynamics, VelocityVerletCanBeReversed) {
  Points cube = Points::box(5, 5, 5);
  const Texts verlet = {{"integrator", "velocity-verlet"}, {"contact_distance", "0"}};
  const double step = 0.5 * Specimen().add(cube).stable_step();
  cube.shake(0.05 * cube.spacing / step);
  Specimen there(verlet);
  there.add(cube).step(step, 30);
  Points back = cube;
  back.position = cube.position;
  // The bonds are those at rest, so the way back starts from a state of the first solid with velocities turned around.
  const auto reversed = [&](const Texts& parameters) {
    Specimen solid(parameters);
    solid.add(cube).step(step, 30);
    const auto v = solid.field("velocity");
    solid.handle = [&](std::size_t, std::size_t i, Point& x, Point& u) {
      const auto at = solid.field("position");
      for (std::size_t a = 0; a < 3; ++a) {
        x[a] = at[3 * i + a];
        u[a] = -v[3 * i + a];
      }
      return true;
    };
    solid.step(step);
    solid.handle = nullptr;
    const auto x = solid.step(step, 30).field("position");
    double off = 0;
    for (std::size_t k = 0; k < x.size(); ++k) off = std::max(off, std::abs(x[k] - cube.position[k]));
    return off / cube.spacing;
  };
  EXPECT_LT(reversed(verlet), 1e-10);
  EXPECT_GT(reversed({{"contact_distance", "0"}}), 1e-3);
}

TEST(Peridynamics, BodiesBounceOffEachOther) {
  // Two equal cubes: momentum is kept to rounding, they never overlap, and most of the energy of the motion comes back.
  Points left = Points::box(5, 5, 5), right = Points::box(5, 5, 5, {0.055, 0.002, 0.003});
  Specimen solid;
  const double step = 0.3 * Specimen().add(left).stable_step(), speed = 0.003 * left.spacing / step;
  for (std::size_t i = 0; i < left.velocity.size(); i += 3) left.velocity[i] = speed;
  for (std::size_t i = 0; i < right.velocity.size(); i += 3) right.velocity[i] = -speed;
  solid.add(left).add(right);
  double closest = 1;
  Point mean{};
  for (int n = 0; n < 700; ++n) {
    solid.step(step);
    const auto a = solid.field("position", 0), b = solid.field("position", 1);
    double front = -1, back = 1;
    for (std::size_t i = 0; i < a.size(); i += 3) front = std::max(front, a[i]);
    for (std::size_t i = 0; i < b.size(); i += 3) back = std::min(back, b[i]);
    closest = std::min(closest, back - front);
  }
  EXPECT_LT(closest, 0.9 * left.spacing) << "they met";
  EXPECT_GT(closest, 0.3 * left.spacing);
  Momentum all[2];
  for (std::size_t b = 0; b < 2; ++b) {
    all[b] = momentum(solid.field("position", b), solid.field("velocity", b));
    mean[b] = all[b].linear[0] / 125;
  }
  for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(all[0].linear[a] + all[1].linear[a], 0, 1e-13 * 250 * speed);
  EXPECT_LT(mean[0], -0.6 * speed);
  EXPECT_GT(mean[1], 0.6 * speed);
}

TEST(Peridynamics, FacesOfACrackDoNotPassThroughEachOther) {
  // Torn apart along x until all bonds across the middle are broken, then pushed together again.
  Points bar = Points::box(8, 4, 4);
  const auto closest = [&](const char* contact_distance) {
    Specimen solid(Texts{{"critical_stretch", "0.05"}, {"contact_distance", contact_distance}});
    solid.add(bar);
    const double step = 0.3 * solid.stable_step();
    double gap = 0;
    solid.handle = [&](std::size_t, std::size_t i, Point& x, Point& v) {
      x = bar.at(i);
      x[0] += x[0] > 0.035 ? gap : 0;
      v = {};
      return true;
    };
    for (gap = 0; gap < 2 * bar.spacing; gap += 0.02 * bar.spacing) solid.step(step);
    for (const double phi : {solid.field("damage")[3 * 16], solid.field("damage")[4 * 16]}) EXPECT_GT(phi, 0.2);
    for (; gap > -0.2 * bar.spacing; gap -= 0.02 * bar.spacing) solid.step(step);
    solid.handle = nullptr;
    solid.step(step, 30);
    const auto x = solid.field("position");
    double left = 0, right = 0;
    for (std::size_t i = 3 * 16; i < 4 * 16; ++i) left += x[3 * i] / 16;
    for (std::size_t i = 4 * 16; i < 5 * 16; ++i) right += x[3 * i] / 16;
    return (right - left) / bar.spacing;
  };
  EXPECT_GT(closest("0.9"), 0.85);
  EXPECT_NEAR(closest("0"), 0.8, 0.03);
}

TEST(Peridynamics, DampsWhatItIsToldTo) {
  Points cube = Points::box(5, 5, 5);
  const double step = 0.2 * Specimen().add(cube).stable_step();
  Points drifting = cube;
  for (double& v : drifting.velocity) v = 1e-3;
  const auto slowed = Specimen(Texts{{"air_damping", "0.1"}}).add(drifting).step(step, 10).field("velocity");
  for (const double v : slowed) EXPECT_NEAR(v, 1e-3 * std::pow(0.9, 10), 1e-12);

  // Laplacian damping takes differences of neighbours and leaves the sum.
  cube.shake(0.01 * cube.spacing / step);
  const Momentum before = momentum(cube.position, cube.velocity);
  const auto size_after = [&](const char* damping) {
    Specimen solid(Texts{{"laplacian_damping", damping}});
    solid.add(cube).step(step, 10);
    const Momentum after = momentum(solid.field("position"), solid.field("velocity"));
    for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(after.linear[a], before.linear[a], 1e-13 * before.size);
    return after.size;
  };
  EXPECT_LT(size_after("0.3"), 0.5 * size_after("0"));
}

TEST(Peridynamics, SaysWhatIsWrongWithItsParameters) {
  const auto refused = [](const Texts& parameters, const std::string& reason) {
    try {
      Specimen solid(parameters);
      ADD_FAILURE() << "taken; should say: " << reason;
    } catch (const testkit::Failed& failed) {
      EXPECT_NE(failed.reason.find(reason), std::string::npos) << failed.reason;
    }
  };
  refused({{"anisotropy", "[1, 0, 0, 1]"}}, "has 4 numbers, must have 9 or none");
  refused({{"anisotropy", "[1, 0, 0, 0, 1, 0, 1, 1, 0]"}}, "must be invertible");
  refused({{"horizon", "0.5"}}, "horizon");
  Points twins = Points::box(2, 1, 1);
  twins.add(twins.at(1));
  EXPECT_THROW(
      {
        try {
          Specimen().add(twins);
        } catch (const std::runtime_error& error) {
          EXPECT_NE(std::string(error.what()).find("points 1 and 2 are at the same place"), std::string::npos) << error.what();
          throw;
        }
      },
      std::runtime_error);
}

}  // namespace
}  // namespace cleave::test
