#include <cleave/damage.h>
#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/gtest.hpp>

namespace {
namespace kit = cleave::testkit;

/// Every check that `cleave check` makes, as a test of its own.
CLEAVE_CONFORMANCE_TESTS({{Type}}, PLUGIN);

constexpr double critical_energy = 50;  // J/m^3

struct Driven {
  double force, history;
};

Driven driven(double tensile_energy, double history, double toughness = 1) {
  const kit::Plugin plugin(PLUGIN);
  const kit::Instance law(plugin, {{"critical_energy", critical_energy}, {"length_scale", 0.01}});
  kit::Request request;
  request.count = 1;
  request.inputs[CLEAVE_FIELD_TENSILE_ENERGY_IN] = {{tensile_energy}};
  request.inputs[CLEAVE_FIELD_TOUGHNESS] = {{toughness}};
  request.inputs[CLEAVE_FIELD_STATE] = {{history}};
  request.outputs[CLEAVE_FIELD_DRIVING_FORCE] = 1;
  request.outputs[CLEAVE_FIELD_STATE_OUT] = 1;
  const auto answer = kit::evaluated(law, kit::Precision::double_precision, request);
  return {answer.outputs.at(CLEAVE_FIELD_DRIVING_FORCE)[0][0], answer.outputs.at(CLEAVE_FIELD_STATE_OUT)[0][0]};
}

TEST({{Type}}Drive, NothingBelowTheThreshold) {
  EXPECT_EQ(driven(0.99 * critical_energy, 0).force, 0);
  EXPECT_EQ(driven(3.99 * critical_energy, 0, 4).force, 0);
}

TEST({{Type}}Drive, AboveItIsTheExcessOfTheLargestEnergySoFar) {
  EXPECT_DOUBLE_EQ(driven(3 * critical_energy, 0).force, 2);
  const Driven unloaded = driven(0, 3 * critical_energy);
  EXPECT_DOUBLE_EQ(unloaded.force, 2);
  EXPECT_DOUBLE_EQ(unloaded.history, 3 * critical_energy);
}

}  // namespace
