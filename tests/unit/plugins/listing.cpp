#include "app/plugins_command.hpp"
#include "common/error.hpp"
#include "law_driver.hpp"

#include <gmock/gmock.h>

#include <filesystem>

namespace cleave::app {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

plugins::Registry sound_and_broken() { return plugins::Registry({CLEAVE_FIXTURE_DIR "/sound", CLEAVE_FIXTURE_DIR "/broken"}); }

TEST(PluginsCommand, ListsUsablePluginsByKindAndCountsRefusals) {
  const std::string text = describe_plugins(sound_and_broken(), {});
  EXPECT_THAT(
      text, AllOf(HasSubstr("elasticity/energy-only"), HasSubstr("plasticity/radial-return"), HasSubstr("refused; --explain")));
  EXPECT_LT(text.find("elasticity/fibrous"), text.find("plasticity/radial-return"));
}

TEST(PluginsCommand, ExplainsSearchPathFilesAndReasons) {
  PluginsOptions options;
  options.explain = true;
  const plugins::Registry registry({CLEAVE_FIXTURE_DIR "/broken", "/no/such/directory"});
  EXPECT_THAT(describe_plugins(registry, options),
              AllOf(HasSubstr("/no/such/directory  (does not exist)"), HasSubstr("wrong_major.so"),
                    HasSubstr("refused: speaks plugin ABI 2.0")));
}

TEST(PluginsCommand, SaysWhatAParameterBringsWithIt) {
  PluginsOptions options;
  options.id = "elasticity/qr";
  EXPECT_THAT(describe_plugins(plugins::test::built_plugins(), options),
              AllOf(Not(HasSubstr("capabilities: accepts F, needs a fiber")), HasSubstr("where it is not 0: needs a fiber\n"),
                    HasSubstr("where it is not 0: needs a fiber, needs a second fiber\n")));
  options.json = true;
  EXPECT_THAT(describe_plugins(plugins::test::built_plugins(), options), HasSubstr("capabilities_if_not_zero"));
}

TEST(PluginsCommand, DescribesOnePluginCompletely) {
  PluginsOptions options;
  options.id = "plasticity/radial-return";
  const std::string text = describe_plugins(sound_and_broken(), options);
  EXPECT_THAT(
      text, AllOf(HasSubstr("limit [Pa], number, required"), HasSubstr("greater than 0 Pa; usually in [1, 1e+09] Pa"),
                  HasSubstr("flavour, text: plain | other, default plain"), HasSubstr("default [-1, -0.5]"),
                  HasSubstr("at most one of: slope, or angle"), HasSubstr("accumulated, scalar, starts at 0, never decreases"),
                  HasSubstr("marker [m], vector, starts at [1, 2, 3]"), HasSubstr("needs the isochoric response")));
}

TEST(PluginsCommand, JsonHoldsTheSame) {
  PluginsOptions options;
  options.json = true;
  const std::string all = describe_plugins(sound_and_broken(), options);
  EXPECT_THAT(all, AllOf(HasSubstr("\"search_path\""), HasSubstr("\"refused\""), HasSubstr("\"elasticity/energy-only\""),
                         Not(HasSubstr("inf"))));
  options.id = "elasticity/energy-only";
  EXPECT_THAT(describe_plugins(sound_and_broken(), options),
              AllOf(HasSubstr("\"poissons_ratio\""), HasSubstr("\"maximum_open\" : true")));
}

TEST(PluginsCommand, MarkdownIsAReferenceOfEverythingDeclared) {
  PluginsOptions options;
  options.markdown = true;
  options.id = "plasticity/radial-return";
  EXPECT_THAT(describe_plugins(sound_and_broken(), options),
              AllOf(HasSubstr("# `plasticity/radial-return` "),
                    HasSubstr("| `limit` | number | Pa | required | greater than 0; usually in [1, 1e+09] | "),
                    HasSubstr("| `flavour` | `plain`, `other` |  | `plain` |  | "), HasSubstr("| `[-1, -0.5]` |"),
                    HasSubstr("\nAt most one of: `slope`, or `angle`.\n"),
                    HasSubstr("| `accumulated` | scalar | 1 | 0 | never decreases | "),
                    HasSubstr("| `marker` | vector | m | [1, 2, 3] | free | ")));
  options.id = "elasticity/qr";
  EXPECT_THAT(describe_plugins(plugins::test::built_plugins(), options),
              AllOf(HasSubstr("; where it is not 0: needs a fiber, needs a second fiber |\n"),
                    HasSubstr("One of: `youngs_modulus` and `poissons_ratio`, or `shear_modulus` and `bulk_modulus`.\n")));
  options.id = "";
  const std::string page = describe_plugins(sound_and_broken(), options);
  EXPECT_LT(page.find("\n## Elasticity\n"), page.find("\n### `elasticity/fibrous` "));
  EXPECT_LT(page.find("\n### `elasticity/fibrous` "), page.find("\n## Plasticity\n"));
  options.json = true;
  EXPECT_THROW(describe_plugins(sound_and_broken(), options), InputError);
}

TEST(PluginsCommand, UnknownIdIsAnInputErrorWithASuggestion) {
  PluginsOptions options;
  options.id = "elasticity/energy-onyl";
  EXPECT_THROW(describe_plugins(sound_and_broken(), options), InputError);
}

}  // namespace
}  // namespace cleave::app
