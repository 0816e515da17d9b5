#include "law_driver.hpp"
#include "strains.hpp"

#include <cleave/constraint.h>
#include <cleave/discretization.h>
#include <cleave/isochoric_response.hpp>

#include <limits>

namespace cleave::plugins::test {
namespace {

// ---------------------------------------------------------------- return mappings

constexpr cleave_isochoric_response elastic{sizeof(cleave_isochoric_response), CLEAVE_PRESSURE_QUADRATIC, 100, 200};

Instance radial_return(double limit) {
  Context context;
  context.isochoric = elastic;
  return Instance(sound_fixtures().load("plasticity/radial-return"), {{"limit", limit}}, context);
}

/// Half of the points are nearly at rest, half strongly sheared.
std::vector<Tensor> mixed_trials() {
  std::vector<Tensor> all = deformations(32, 0.4);
  for (std::size_t k = 0; k < all.size(); k += 2) all[k] = Tensor::Identity() + 1e-3 * all[k];
  return all;
}

Field states(std::size_t count) { return Field(count, {0.5, 1, 2, 3}); }

TEST(ReturnMapping, LeavesElasticTrialsAloneToTheBit) {
  const Instance law = radial_return(20);
  const auto trials = mixed_trials();
  for (cleave_field_id measure : {CLEAVE_FIELD_B, CLEAVE_FIELD_F}) {
    const cleave_field_id out = measure == CLEAVE_FIELD_B ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT;
    Field strain;
    for (const auto& F : trials) strain.push_back(measure == CLEAVE_FIELD_B ? left_cauchy_green(F) : row_major(F));
    LawDriver<double> driver(Placement::scattered);
    driver.input(measure, strain).input(CLEAVE_FIELD_STATE, states(32));
    driver.output(out, unsigned(strain[0].size())).output(CLEAVE_FIELD_STATE_OUT, 4).output(CLEAVE_FIELD_YIELDED, 1);
    ASSERT_EQ(driver.run(return_map<double>(law), law.handle(), 32), CLEAVE_OK);
    for (std::uint32_t k = 0; k < 32; ++k) {
      const bool yielded = driver.value(CLEAVE_FIELD_YIELDED, k)[0] == 1;
      EXPECT_EQ(yielded, k % 2 == 1) << k;
      EXPECT_EQ(driver.status(k), CLEAVE_STATUS_OK);
      if (!yielded) {
        EXPECT_EQ(driver.value(out, k), strain[k]);
        EXPECT_EQ(driver.value(CLEAVE_FIELD_STATE_OUT, k), states(1)[0]);
      } else {
        EXPECT_NE(driver.value(out, k), strain[k]);
        EXPECT_GT(driver.value(CLEAVE_FIELD_STATE_OUT, k)[0], 0.5);
      }
    }
  }
}

TEST(ReturnMapping, OnFGivesTheSameStrainAsOnBAndKeepsTheRotation) {
  const Instance law = radial_return(20);
  const auto trials = deformations(32, 0.4);
  Field b, F;
  for (const auto& trial : trials) {
    b.push_back(left_cauchy_green(trial));
    F.push_back(row_major(trial));
  }
  LawDriver<double> on_b, on_F;
  on_b.input(CLEAVE_FIELD_B, b).input(CLEAVE_FIELD_STATE, states(32)).output(CLEAVE_FIELD_B_OUT, 6);
  on_F.input(CLEAVE_FIELD_F, F).input(CLEAVE_FIELD_STATE, states(32)).output(CLEAVE_FIELD_F_OUT, 9);
  on_b.run(return_map<double>(law), law.handle(), 32);
  on_F.run(return_map<double>(law), law.handle(), 32);
  for (std::uint32_t k = 0; k < 32; ++k) {
    const Tensor returned = tensor(on_F.value(CLEAVE_FIELD_F_OUT, k));
    EXPECT_LT((returned * returned.transpose() - tensor(on_b.value(CLEAVE_FIELD_B_OUT, k))).norm(), 1e-12) << k;
    // F_new = V F_trial with V symmetric: the flow adds no rotation.
    const Tensor V = returned * trials[k].inverse();
    EXPECT_LT((V - V.transpose()).norm(), 1e-12) << k;
  }
}

TEST(ReturnMapping, InPlaceIsTheSameBitwise) {
  const Instance law = radial_return(20);
  Field b;
  for (const auto& F : mixed_trials()) b.push_back(left_cauchy_green(F));
  LawDriver<float> apart, in_place;
  apart.input(CLEAVE_FIELD_B, b)
      .input(CLEAVE_FIELD_STATE, states(32))
      .output(CLEAVE_FIELD_B_OUT, 6)
      .output(CLEAVE_FIELD_STATE_OUT, 4);
  in_place.input(CLEAVE_FIELD_B, b).input(CLEAVE_FIELD_STATE, states(32));
  in_place.output_over(CLEAVE_FIELD_B_OUT, CLEAVE_FIELD_B).output_over(CLEAVE_FIELD_STATE_OUT, CLEAVE_FIELD_STATE);
  apart.run(return_map<float>(law), law.handle(), 29);
  in_place.run(return_map<float>(law), law.handle(), 29);
  for (std::uint32_t k = 0; k < 29; ++k) {
    EXPECT_EQ(in_place.value(CLEAVE_FIELD_B_OUT, k), apart.value(CLEAVE_FIELD_B_OUT, k));
    EXPECT_EQ(in_place.value(CLEAVE_FIELD_STATE_OUT, k), apart.value(CLEAVE_FIELD_STATE_OUT, k));
  }
}

TEST(ReturnMapping, UndefinedTrialIsFatal) {
  const Instance law = radial_return(20);
  Field b(4, {1, 1, 1, 0, 0, 0});
  b[1][0] = std::numeric_limits<double>::quiet_NaN();
  b[2][0] = -1;
  LawDriver<double> driver;
  driver.input(CLEAVE_FIELD_B, b).input(CLEAVE_FIELD_STATE, states(4)).output(CLEAVE_FIELD_B_OUT, 6);
  driver.run(return_map<double>(law), law.handle(), 4);
  EXPECT_EQ(driver.status(0), CLEAVE_STATUS_OK);
  EXPECT_EQ(driver.status(1), CLEAVE_STATUS_FATAL);
  EXPECT_EQ(driver.status(2), CLEAVE_STATUS_FATAL);
  EXPECT_EQ(driver.status(3), CLEAVE_STATUS_OK);
}

TEST(IsochoricResponse, JacobianInvertsPressure) {
  for (PressureLaw law : {PressureLaw::quadratic, PressureLaw::linear, PressureLaw::logarithmic}) {
    const cleave::IsochoricResponse response{.deviatoric_modulus = 1, .bulk_modulus = 50, .pressure_law = law};
    EXPECT_EQ(response.pressure(1.0), 0);
    EXPECT_GT(response.pressure(0.9), 0);
    for (double J : {0.7, 0.95, 1.0, 1.3, 2.0}) EXPECT_NEAR(response.jacobian(response.pressure(J)), J, 1e-14) << int(law);
  }
}

// ---------------------------------------------------------------- damage

TEST(DrivingForce, FollowsItsInputsAndKeepsTheHistory) {
  const Instance law(sound_fixtures().load("damage/energy-threshold"), {{"threshold", 10.0}}, {});
  LawDriver<float> driver(Placement::scattered);
  driver.input(CLEAVE_FIELD_TENSILE_ENERGY_IN, {{5}, {20}, {30}}).input(CLEAVE_FIELD_STATE, {{0}, {0}, {7}});
  driver.output(CLEAVE_FIELD_DRIVING_FORCE, 1).output(CLEAVE_FIELD_STATE_OUT, 1);
  ASSERT_EQ(driver.run(law.damage().drive_f32, law.handle(), 3), CLEAVE_OK);
  EXPECT_EQ(driver.value(CLEAVE_FIELD_DRIVING_FORCE, 0)[0], 0);
  EXPECT_EQ(driver.value(CLEAVE_FIELD_DRIVING_FORCE, 1)[0], 1);
  EXPECT_EQ(driver.value(CLEAVE_FIELD_DRIVING_FORCE, 2)[0], 7);
  EXPECT_EQ(driver.value(CLEAVE_FIELD_STATE_OUT, 2)[0], 7);

  LawDriver<float> tough;
  tough.input(CLEAVE_FIELD_TENSILE_ENERGY_IN, {{40}}).input(CLEAVE_FIELD_STATE, {{0}}).constant(CLEAVE_FIELD_TOUGHNESS, {2});
  tough.output(CLEAVE_FIELD_DRIVING_FORCE, 1);
  tough.run(law.damage().drive_f32, law.handle(), 1);
  EXPECT_EQ(tough.value(CLEAVE_FIELD_DRIVING_FORCE, 0)[0], 1);
}

TEST(DrivingForce, MissingTensileEnergyIsAnError) {
  const Instance law(sound_fixtures().load("damage/energy-threshold"), {{"threshold", 10.0}}, {});
  EXPECT_TRUE(law.description().can(CLEAVE_NEEDS_TENSILE_ENERGY));
  LawDriver<double> driver;
  driver.input(CLEAVE_FIELD_STATE, {{0}}).output(CLEAVE_FIELD_DRIVING_FORCE, 1);
  EXPECT_EQ(driver.run(law.damage().drive_f64, law.handle(), 1), CLEAVE_ERROR_UNSUPPORTED);
}

TEST(DamageModel, ReachesTheHost) {
  const Instance law(sound_fixtures().load("damage/energy-threshold"), {{"threshold", 10.0}}, {});
  cleave_damage_model model{};
  model.struct_size = sizeof model;
  law.damage().model(law.handle(), &model);
  EXPECT_EQ(model.viscosity, 0.5);
  EXPECT_EQ(model.length, 2);
  EXPECT_EQ(model.residual, 0.01);
  EXPECT_EQ(model.integration, std::uint32_t(CLEAVE_INTEGRATION_IMPLICIT));
}

// ---------------------------------------------------------------- classes behind C tables

struct Message {
  char text[128] = "", subject[32] = "";
  cleave_message abi{sizeof(cleave_message), sizeof text, text, sizeof subject, 0, subject};
};

TEST(Constraint, ProjectsReportsAndTurnsExceptionsIntoMessages) {
  const Instance solver(sound_fixtures().load("constraint/halving"), {}, {});
  const auto& table = *static_cast<const cleave_constraint*>(solver.plugin().kind_table());
  double velocity[4] = {2, 4, 6, 8};
  cleave_constraint_system system{};
  system.struct_size = sizeof system;
  system.dimension = 2;
  system.node_count = 2;
  system.velocity = velocity;
  cleave_constraint_report report{};
  report.struct_size = sizeof report;
  Message message;
  ASSERT_EQ(table.project(solver.handle(), &system, &report, &message.abi), CLEAVE_OK);
  ASSERT_EQ(table.project(solver.handle(), &system, &report, &message.abi), CLEAVE_OK);
  EXPECT_EQ(velocity[3], 2);
  EXPECT_EQ(report.iterations, 2u) << "the solver keeps its state from call to call";
  EXPECT_EQ(report.rows, 2u);
  system.node_count = 0;
  EXPECT_EQ(table.project(solver.handle(), &system, &report, &message.abi), CLEAVE_ERROR_INTERNAL);
  EXPECT_STREQ(message.text, "there are no nodes");
}

TEST(Discretization, StepsSavesAndRestoresThroughItsTable) {
  const Instance method(sound_fixtures().load("discretization/drifting"), {}, {});
  const auto& table = *static_cast<const cleave_discretization*>(method.plugin().kind_table());
  const double position[3] = {0, 1, 0}, velocity[3] = {1, 0, 0};
  cleave_body body{};
  body.struct_size = sizeof body;
  body.dimension = 3;
  Message message;
  EXPECT_EQ(table.add_body(method.handle(), &body, &message.abi), CLEAVE_ERROR_INTERNAL);
  EXPECT_STREQ(message.text, "the body has no points");
  body.point_count = 1;
  body.position = position;
  body.velocity = velocity;
  ASSERT_EQ(table.add_body(method.handle(), &body, &message.abi), CLEAVE_OK);
  EXPECT_EQ(table.stable_step(method.handle()), 0.5);

  cleave_surroundings world{};
  world.struct_size = sizeof world;
  world.gravity[1] = -10;
  world.collide = [](void*, std::uint64_t count, const double*, double* v) {
    for (std::uint64_t i = 0; i < count; ++i) v[3 * i + 2] = 0.25;
  };
  world.handle = [](void*, std::uint64_t, std::uint32_t, std::uint64_t, double*, double*) { return 0; };

  std::vector<char> start(table.save(method.handle(), nullptr, 0));
  ASSERT_EQ(table.save(method.handle(), start.data(), start.size()), start.size());
  const auto point = [&](std::uint32_t index) {
    cleave_point_field field{};
    field.struct_size = sizeof field;
    EXPECT_EQ(table.point_field(method.handle(), 0, index, &field), 2u);
    return std::vector<double>(field.values, field.values + 3);
  };
  ASSERT_EQ(table.step(method.handle(), 0.5, &world, &message.abi), CLEAVE_OK);
  EXPECT_EQ(point(0), (std::vector<double>{0.5, -1.5, 0.125}));
  EXPECT_EQ(point(1), (std::vector<double>{1, -5, 0.25}));
  ASSERT_EQ(table.restore(method.handle(), start.data(), start.size(), &message.abi), CLEAVE_OK);
  EXPECT_EQ(point(0), (std::vector<double>{0, 1, 0}));

  cleave_surface surface{};
  surface.struct_size = sizeof surface;
  EXPECT_EQ(table.surface(method.handle(), 0, &surface), CLEAVE_ERROR_UNSUPPORTED);
}

}  // namespace
}  // namespace cleave::plugins::test
