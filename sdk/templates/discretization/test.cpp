#include <cleave/testkit/body.hpp>
#include <cleave/testkit/gtest.hpp>

#include <algorithm>
#include <string>

namespace {
namespace kit = cleave::testkit;

/// Every check that `cleave check` makes, as a test of its own.
CLEAVE_CONFORMANCE_TESTS({{Type}}, PLUGIN);

constexpr double kappa = 1e6, critical_stretch = 0.01;

/// Energy [J/m^3] and damage in the middle of a cube of points that was blown up by `stretch` in one step.
struct Middle {
  double energy, damage;
};

Middle blown_up(double stretch) {
  const kit::Plugin plugin(PLUGIN);
  const kit::Instance solid(plugin, {{"bulk_modulus", kappa}, {"critical_stretch", critical_stretch}});
  const auto& method = *static_cast<const cleave_discretization*>(plugin.kind_table());

  // At rest there are no forces: with v = stretch/dt (x - x_0) one step leads to (1 + stretch) (x - x_0).
  constexpr int cells = 11;
  const double time_step = 1e-6;
  kit::Body body = kit::lattice(cells);
  const auto centre = body.centre();
  std::size_t middle = 0;
  for (std::size_t i = 0; i < body.points(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) body.velocity[3 * i + k] = stretch / time_step * (body.position[3 * i + k] - centre[k]);
    if (body.depth[i] > body.depth[middle]) middle = i;
  }
  kit::Words words;
  const cleave_body abi = body.abi();
  EXPECT_EQ(method.add_body(solid.handle(), &abi, &words.message), CLEAVE_OK) << words.said();
  cleave_surroundings empty_space{};
  empty_space.struct_size = sizeof empty_space;
  empty_space.collide = [](void*, std::uint64_t, const double*, double*) {};
  empty_space.handle = [](void*, std::uint64_t, std::uint32_t, std::uint64_t, double*, double*) { return 0; };
  EXPECT_EQ(method.step(solid.handle(), time_step, &empty_space, &words.message), CLEAVE_OK) << words.said();

  Middle values{-1, -1};
  cleave_point_field field{};
  field.struct_size = sizeof field;
  for (std::uint32_t f = 0; f < method.point_field(solid.handle(), 0, f, &field); ++f) {
    if (std::string(field.name) == "energy") values.energy = field.values[middle];
    if (std::string(field.name) == "damage") values.damage = field.values[middle];
  }
  return values;
}

TEST({{Type}}Solid, HasTheEnergyOfItsBulkModulus) {
  // psi = kappa/2 (3 s)^2 for a ball full of bonds; the sum over the points of a lattice is 6 % more.
  const double stretch = 0.5 * critical_stretch;
  const Middle middle = blown_up(stretch);
  EXPECT_NEAR(middle.energy / (4.5 * kappa * stretch * stretch), 1.06, 0.01);
  EXPECT_EQ(middle.damage, 0);
}

TEST({{Type}}Solid, BreaksBeyondItsCriticalStretch) {
  const Middle middle = blown_up(1.5 * critical_stretch);
  EXPECT_EQ(middle.energy, 0);
  EXPECT_EQ(middle.damage, 1);
}

}  // namespace
