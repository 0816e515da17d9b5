#include "common/error.hpp"
#include "law_driver.hpp"

#include <gmock/gmock.h>

#include <limits>

namespace cleave::plugins {
namespace {

using test::sound_fixtures;
using test::stiff;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr cleave_isochoric_response soft{sizeof(cleave_isochoric_response), CLEAVE_PRESSURE_QUADRATIC, 10, 20};

Instance radial_return(GivenParameters given, bool with_response = true) {
  given.try_emplace("limit", 3.0);
  Context context;
  if (with_response) context.isochoric = soft;
  return Instance(sound_fixtures().load("plasticity/radial-return"), given, context);
}

std::string refusal_of(const GivenParameters& given) {
  try {
    radial_return(given);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

/// What the plugin itself says to values the host would have stopped: create() is called directly.
std::string plugins_own_refusal(const char* id, const std::vector<cleave_parameter>& values) {
  const auto plugin = sound_fixtures().load(id);
  cleave_context context{sizeof context, 3, 0, 0, &soft, nullptr};
  const cleave_parameters parameters{sizeof parameters, std::uint32_t(values.size()), values.data()};
  char text[256] = "", subject[64] = "";
  cleave_message message{sizeof message, sizeof text, text, sizeof subject, 0, subject};
  cleave_instance* instance = nullptr;
  const cleave_result result = plugin->table().create(&parameters, &context, &instance, &message);
  if (result == CLEAVE_OK) {
    plugin->table().destroy(instance);
    return "accepted";
  }
  EXPECT_EQ(result, CLEAVE_ERROR_PARAMETER);
  EXPECT_EQ(instance, nullptr);
  return std::string(subject) + ": " + text;
}

cleave_parameter number(const char* key, double value, bool given = true) {
  cleave_parameter p{};
  p.struct_size = sizeof p;
  p.type = CLEAVE_TYPE_NUMBER;
  p.key = key;
  p.given = given;
  p.number = value;
  return p;
}

TEST(Parameters, AlternativeModuliDescribeTheSameSolid) {
  auto registry = test::built_plugins();
  const auto plugin = registry.load("elasticity/split-neo-hookean");
  const Instance by_youngs(plugin, stiff(1000, 0.25), {});
  const Instance by_shear(plugin, {{"shear_modulus", 400.0}, {"bulk_modulus", 2000.0 / 3}}, {});
  EXPECT_NEAR(by_youngs.isochoric_response()->deviatoric_modulus, by_shear.isochoric_response()->deviatoric_modulus, 1e-9);
  EXPECT_NEAR(by_youngs.isochoric_response()->bulk_modulus, by_shear.isochoric_response()->bulk_modulus, 1e-9);
}

TEST(Parameters, HostRefusesWithTheName) {
  EXPECT_THAT(refusal_of({{"limt", 1.0}}), HasSubstr("unknown parameter \"limt\", did you mean \"limit\"?"));
  EXPECT_THAT(refusal_of({{"limit", -3.0}}), HasSubstr("limit must be greater than 0 Pa, is -3"));
  EXPECT_THAT(refusal_of({{"limit", std::string("high")}}), HasSubstr("limit must be a number"));
  EXPECT_THAT(refusal_of({{"repetitions", 2.5}}), HasSubstr("repetitions must be an integer"));
  EXPECT_THAT(refusal_of({{"repetitions", std::int64_t(11)}}), HasSubstr("repetitions must be in [1, 10], is 11"));
  EXPECT_THAT(refusal_of({{"flavour", std::string("sweet")}}), HasSubstr("must be one of \"plain\", \"other\", is \"sweet\""));
  EXPECT_THAT(refusal_of({{"weights", std::vector<double>{1, 1, 1}}}), HasSubstr("must have 0 to 2 elements, has 3"));
  EXPECT_THAT(refusal_of({{"weights", std::vector<double>{0, 2}}}), HasSubstr("every element must be in [-1, 1], is 2"));
  EXPECT_THAT(refusal_of({{"limit", std::numeric_limits<double>::quiet_NaN()}}), HasSubstr("limit must be"));
}

TEST(Parameters, MissingRequiredOneIsNamed) {
  const auto plugin = sound_fixtures().load("plasticity/radial-return");
  try {
    Instance(plugin, {}, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("limit is required"));
  }
}

TEST(Parameters, LawsOwnRefusalReachesTheUser) {
  EXPECT_THAT(refusal_of({{"slope", 13.0}}), HasSubstr("plasticity/radial-return: slope must not be unlucky"));
}

TEST(Parameters, AlternativeSetsMustNotBeMixed) {
  EXPECT_THAT(refusal_of({{"slope", 1.0}, {"angle", 2.0}}),
              HasSubstr("angle does not go with the others: give slope, or angle"));
  EXPECT_EQ(refusal_of({{"slope", 1.0}}), "accepted");
  EXPECT_EQ(refusal_of({}), "accepted");
}

TEST(Parameters, IncompleteAlternativeSetNamesWhatIsMissing) {
  const auto plugin = sound_fixtures().load("elasticity/energy-only");
  const auto refusal = [&](const GivenParameters& given) -> std::string {
    try {
      Instance(plugin, given, {});
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_THAT(refusal({{"youngs_modulus", 1.0}}),
              HasSubstr("poissons_ratio is missing: give youngs_modulus and poissons_ratio, or "
                        "shear_modulus and bulk_modulus"));
  EXPECT_THAT(refusal({}), HasSubstr("youngs_modulus is missing"));
  EXPECT_THAT(refusal({{"youngs_modulus", 1.0}, {"bulk_modulus", 1.0}}), HasSubstr("bulk_modulus does not go with the others"));
}

TEST(Parameters, PluginChecksForItselfWhatItIsGiven) {
  const char* id = "elasticity/energy-only";
  const auto rest = [](std::vector<cleave_parameter> values) {
    values.push_back(number("shear_modulus", 0, false));
    values.push_back(number("bulk_modulus", 0, false));
    return values;
  };
  EXPECT_EQ(plugins_own_refusal(id, rest({number("youngs_modulus", 10), number("poissons_ratio", 0.2)})), "accepted");
  EXPECT_THAT(plugins_own_refusal(id, rest({number("youngs_modulus", 10), number("poissons_ratio", 0.5)})),
              HasSubstr("poissons_ratio: must be less than 0.5, is 0.5"));
  EXPECT_THAT(plugins_own_refusal(id, rest({number("youngs_modulus", NAN), number("poissons_ratio", 0.2)})),
              HasSubstr("youngs_modulus: must be finite"));
  EXPECT_THAT(plugins_own_refusal(id, rest({number("youngs_modulus", 10), number("poissons_ratio", 0.2), number("colour", 1)})),
              HasSubstr("colour: is not a parameter of this plugin"));
  EXPECT_THAT(plugins_own_refusal(id, {number("youngs_modulus", 10)}), HasSubstr("poissons_ratio: is"));
  auto wrong = number("youngs_modulus", 10);
  wrong.type = CLEAVE_TYPE_TEXT;
  EXPECT_THAT(plugins_own_refusal(id, rest({wrong, number("poissons_ratio", 0.2)})),
              HasSubstr("youngs_modulus: is of the wrong type"));
}

TEST(Parameters, InstancesDoNotShareThem) {
  const auto plugin = test::built_plugins().load("elasticity/split-neo-hookean");
  const Instance soft_solid(plugin, stiff(10), {}), stiff_solid(plugin, stiff(1000), {});
  EXPECT_NEAR(stiff_solid.isochoric_response()->bulk_modulus, 100 * soft_solid.isochoric_response()->bulk_modulus, 1e-9);
}

TEST(State, StartsAsTheInstanceWants) {
  EXPECT_EQ(radial_return({{"start", 0.75}}).initial_state(), (std::vector<double>{0.75, 1, 2, 3}));
}

TEST(State, IsDescribedWithTensorUnitAndMonotonicity) {
  const Instance law = radial_return({});
  const auto& description = law.description();
  ASSERT_EQ(description.states.size(), 2u);
  EXPECT_EQ(description.states[0].monotonicity, CLEAVE_NEVER_DECREASES);
  EXPECT_EQ(description.states[1].tensor, CLEAVE_VECTOR);
  EXPECT_EQ(description.states[1].unit, "m");
  EXPECT_EQ(description.states[1].initial[2], 3);
}

TEST(Plasticity, NeedsTheIsochoricResponseOfTheElasticLaw) {
  try {
    radial_return({}, false);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("needs an elastic law that offers the isochoric response"));
  }
}

TEST(Tables, UnknownKindsAndExtensionsAreNull) {
  const auto plugin = sound_fixtures().load("elasticity/energy-only");
  EXPECT_EQ(plugin->table().kind("cleave.elasticity/2"), nullptr);
  EXPECT_EQ(plugin->table().kind("cleave.damage/1"), nullptr);
  EXPECT_EQ(plugin->table().extension("org.nobody/1"), nullptr);
  EXPECT_EQ(plugin->table().extension(CLEAVE_EXTENSION_ISOCHORIC_RESPONSE), nullptr);
  EXPECT_EQ(Instance(plugin, stiff(), {}).isochoric_response(), std::nullopt);
  plugin->table().destroy(nullptr);
}

TEST(Tables, LongMessagesAreCutToTheirBuffers) {
  const auto plugin = sound_fixtures().load("elasticity/energy-only");
  char text[8], subject[5];
  std::memset(text, 'x', sizeof text);
  std::memset(subject, 'x', sizeof subject);
  cleave_message message{sizeof message, 7, text, 4, 0, subject};
  cleave_instance* instance = nullptr;
  EXPECT_EQ(plugin->table().create(nullptr, nullptr, &instance, &message), CLEAVE_ERROR_PARAMETER);
  EXPECT_EQ(std::strlen(text), 6u);
  EXPECT_EQ(text[7], 'x');
  EXPECT_STREQ(subject, "you");
  EXPECT_EQ(subject[4], 'x');
}

}  // namespace
}  // namespace cleave::plugins
