#include "plugins/registry.hpp"

#include "common/error.hpp"
#include "law_driver.hpp"
#include "plugins/isa.hpp"
#include "plugins/manifest.hpp"

#include <gmock/gmock.h>

#include <fstream>

namespace cleave::plugins {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// A directory of this test alone.
class PluginDirectory : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    directory_ = fs::temp_directory_path() / ("cleave-" + std::string(info->name()) + "-" + std::to_string(getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override {
    unsetenv("CLEAVE_ISA");
    fs::remove_all(directory_);
  }

  fs::path add_sound(const std::string& name, const std::string& as = {}) {
    return add(fs::path(CLEAVE_FIXTURE_DIR "/sound") / (name + ".so"), as.empty() ? name : as);
  }
  fs::path add_broken(const std::string& name) { return add(fs::path(CLEAVE_FIXTURE_DIR "/broken") / (name + ".so"), name); }
  fs::path add(const fs::path& library, const std::string& as) {
    const fs::path copy = directory_ / (as + ".so");
    fs::copy_file(library, copy);
    if (fs::exists(manifest_path(library))) fs::copy_file(manifest_path(library), manifest_path(copy));
    return copy;
  }

  std::string refusal(const Registry& registry, const std::string& name) {
    for (const Found& found : registry.found())
      if (found.path.stem() == name) return found.refusal;
    return "not found";
  }
  /// Why the only library in the directory is refused. A sound one beside it stays usable.
  std::string refusal_of(const std::string& broken) {
    add_broken(broken);
    add_sound("energy_only");
    const Registry registry({directory_});
    EXPECT_NE(registry.find("elasticity/energy-only"), nullptr);
    return refusal(registry, broken);
  }

  fs::path directory_;
};

template <class Action>
std::string error_of(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST_F(PluginDirectory, ListsWhatTheManifestSaysWithoutOpeningTheLibrary) {
  const fs::path library = add_sound("energy_only");
  const auto size = fs::file_size(library);
  // A file of the same size that is no library at all: only the manifest can have been read.
  std::ofstream(library, std::ios::binary) << std::string(size, 'x');
  const Registry registry({directory_});
  ASSERT_EQ(registry.found().size(), 1u);
  EXPECT_TRUE(registry.found()[0].from_manifest);
  EXPECT_NE(registry.find("elasticity/energy-only"), nullptr);
}

TEST_F(PluginDirectory, ManifestAndLibraryDescribeThePluginAlike) {
  for (const char* name :
       {"energy_only", "fibrous", "radial_return", "energy_threshold", "counting_constraint", "drifting_points"})
    add_sound(name);
  const Registry with_manifests({directory_});
  std::vector<Description> from_manifest;
  for (const Found& found : with_manifests.found()) {
    EXPECT_TRUE(found.from_manifest) << found.path;
    from_manifest.push_back(found.description.value());
    fs::remove(manifest_path(found.path));
  }
  const Registry without({directory_});
  ASSERT_EQ(without.found().size(), from_manifest.size());
  for (std::size_t i = 0; i < from_manifest.size(); ++i) {
    EXPECT_FALSE(without.found()[i].from_manifest);
    Description loaded = without.found()[i].description.value();
    EXPECT_EQ(from_manifest[i].abi_minor, 0u) << "the least it works with";
    EXPECT_EQ(loaded.abi_minor, CLEAVE_ABI_MINOR) << "what was agreed on";
    loaded.abi_minor = 0;
    EXPECT_EQ(loaded, from_manifest[i]) << from_manifest[i].id;
  }
}

TEST_F(PluginDirectory, ManifestOfAnotherBuildIsIgnored) {
  const fs::path library = add_sound("energy_only");
  std::ofstream(library, std::ios::binary | std::ios::app) << "longer";
  const Registry registry({directory_});
  ASSERT_EQ(registry.found().size(), 1u);
  EXPECT_FALSE(registry.found()[0].from_manifest);
  EXPECT_NE(registry.find("elasticity/energy-only"), nullptr);
}

TEST_F(PluginDirectory, ManifestThatIsNoTomlIsIgnored) {
  const fs::path library = add_sound("energy_only");
  std::ofstream(manifest_path(library)) << "id = [unfinished";
  const Registry registry({directory_});
  EXPECT_NE(registry.find("elasticity/energy-only"), nullptr);
}

TEST_F(PluginDirectory, ManifestThatContradictsTheLibraryIsRefusedOnLoading) {
  const fs::path library = add_sound("energy_only");
  std::ifstream in(manifest_path(library));
  std::string text(std::istreambuf_iterator<char>(in), {});
  text.replace(text.find("1.0.0"), 5, "9.0.0");
  std::ofstream(manifest_path(library)) << text;
  Registry registry({directory_});
  EXPECT_EQ(registry.find("elasticity/energy-only")->version, "9.0.0");
  EXPECT_THAT(error_of([&] { registry.load("elasticity/energy-only"); }),
              HasSubstr("energy_only.cleave.toml describes another"));
}

TEST_F(PluginDirectory, RemovingTheLibraryRemovesTheLawThoughManifestAndVariantsRemain) {
  const fs::path library = add_sound("energy_only");
  fs::create_directories(directory_ / "x86-64-v3");
  fs::copy_file(library, directory_ / "x86-64-v3/energy_only.so");
  add_sound("fibrous");
  fs::remove(library);
  const Registry registry({directory_});
  EXPECT_EQ(registry.find("elasticity/energy-only"), nullptr);
  EXPECT_EQ(registry.ids(Kind::elasticity), std::vector<std::string>{"elasticity/fibrous"});
}

TEST_F(PluginDirectory, WrongAbiMajorIsRefusedBeforeAnythingElseIsLookedAt) {
  EXPECT_THAT(refusal_of("wrong_major"), AllOf(HasSubstr("ABI 2.0"), HasSubstr("this host speaks 1.1")));
}
TEST_F(PluginDirectory, NewerMinorThanTheHostSpeaksIsRefused) { EXPECT_THAT(refusal_of("newer_minor"), HasSubstr("ABI 1.2")); }
TEST_F(PluginDirectory, PluginThatRefusesTheHostIsNamed) {
  EXPECT_THAT(refusal_of("refuses_abi"), HasSubstr("refuses this host's plugin ABI 1.1"));
}
TEST_F(PluginDirectory, LibraryWithoutTheEntrySymbolIsNoPlugin) {
  EXPECT_THAT(refusal_of("no_entry"), HasSubstr("exports no cleave_plugin_entry"));
}
TEST_F(PluginDirectory, EntryThatGivesNoTableIsRefused) { EXPECT_THAT(refusal_of("no_table"), HasSubstr("no plugin table")); }
TEST_F(PluginDirectory, NullAboutIsRefused) { EXPECT_THAT(refusal_of("null_about"), HasSubstr("\"about\" is null")); }
TEST_F(PluginDirectory, NullParameterArrayIsRefused) { EXPECT_THAT(refusal_of("null_parameters"), HasSubstr("array is null")); }
TEST_F(PluginDirectory, DuplicateParameterKeysAreRefused) {
  EXPECT_THAT(refusal_of("duplicate_keys"), HasSubstr("\"stiffness\" is declared twice"));
}
TEST_F(PluginDirectory, MalformedIdIsRefused) { EXPECT_THAT(refusal_of("bad_id"), HasSubstr("Not An Id")); }
TEST_F(PluginDirectory, TableShorterThanItsMajorVersionIsRefused) {
  EXPECT_THAT(refusal_of("short_table"), HasSubstr("plugin table is too small"));
}
TEST_F(PluginDirectory, MissingFunctionOfADeclaredPrecisionIsRefused) {
  EXPECT_THAT(refusal_of("no_evaluate"), HasSubstr("evaluate_f64"));
}
TEST_F(PluginDirectory, PluginWithoutTheTableOfItsKindIsRefused) {
  EXPECT_THAT(refusal_of("no_kind"), HasSubstr("offers no \"cleave.elasticity/1\""));
}
TEST_F(PluginDirectory, DefaultOutsideItsBoundsIsRefused) {
  EXPECT_THAT(refusal_of("bad_default"), AllOf(HasSubstr("\"stiffness\": its default"), HasSubstr("greater than 0 Pa, is -1")));
}
TEST_F(PluginDirectory, PluginWrittenInCIsAsGoodAsAny) {
  EXPECT_EQ(refusal_of("whole"), "");
  Registry registry({directory_});
  EXPECT_EQ(std::get<double>(registry.find("elasticity/by-hand")->parameters.at(0).default_value), 7.5);
  const Instance instance(registry.load("elasticity/by-hand"), {}, {});
  EXPECT_TRUE(instance);
}
TEST_F(PluginDirectory, CreateThatGivesNothingIsAnError) {
  add_broken("null_instance");
  Registry registry({directory_});
  const auto plugin = registry.load("elasticity/by-hand");
  EXPECT_THAT(error_of([&] { Instance(plugin, {}, {}); }), HasSubstr("gave no instance"));
}

TEST_F(PluginDirectory, TextFileNamedLikeALibraryIsRefused) {
  std::ofstream(directory_ / "notes.so") << "these are not the symbols you are looking for\n";
  add_sound("energy_only");
  const Registry registry({directory_});
  EXPECT_THAT(refusal(registry, "notes"), HasSubstr("is not a shared library"));
  EXPECT_NE(registry.find("elasticity/energy-only"), nullptr);
}

TEST_F(PluginDirectory, TruncatedLibraryIsRefusedWhereverItWasCut) {
  const fs::path whole = fs::path(CLEAVE_FIXTURE_DIR "/sound/energy_only.so");
  const auto size = fs::file_size(whole);
  add_sound("fibrous");
  for (const auto bytes :
       {std::uintmax_t(0), std::uintmax_t(3), std::uintmax_t(40), std::uintmax_t(200), size / 4, size / 2, size - 1}) {
    const fs::path cut = directory_ / "cut.so";
    fs::remove(cut);
    fs::copy_file(whole, cut);
    fs::copy_file(manifest_path(whole), manifest_path(cut), fs::copy_options::overwrite_existing);
    fs::resize_file(cut, bytes);
    const Registry registry({directory_});
    EXPECT_NE(refusal(registry, "cut"), "") << bytes;
    EXPECT_EQ(registry.ids(Kind::elasticity), std::vector<std::string>{"elasticity/fibrous"}) << bytes;
  }
}

TEST_F(PluginDirectory, SecondLibraryWithAnIdIsRefusedAsDuplicate) {
  add_sound("energy_only", "a_first");
  add_sound("energy_only", "b_second");
  const Registry registry({directory_});
  EXPECT_EQ(refusal(registry, "a_first"), "");
  EXPECT_THAT(refusal(registry, "b_second"), AllOf(HasSubstr("elasticity/energy-only"), HasSubstr("a_first.so")));
}

TEST_F(PluginDirectory, EarlierDirectoryOfTheSearchPathWins) {
  fs::create_directories(directory_ / "one");
  fs::create_directories(directory_ / "two");
  fs::copy_file(CLEAVE_FIXTURE_DIR "/sound/energy_only.so", directory_ / "one/x.so");
  fs::copy_file(CLEAVE_FIXTURE_DIR "/sound/energy_only.so", directory_ / "two/x.so");
  Registry registry({directory_ / "missing", directory_ / "two", directory_ / "one"});
  setenv("CLEAVE_ISA", "x86-64-v2", 1);
  EXPECT_EQ(registry.load("elasticity/energy-only")->path(), directory_ / "two/x.so");
}

TEST_F(PluginDirectory, UnknownIdSuggestsTheNearest) {
  add_sound("energy_only");
  Registry registry({directory_});
  EXPECT_THAT(error_of([&] { registry.load("elasticity/enrgy-only"); }), HasSubstr("did you mean \"elasticity/energy-only\"?"));
}

TEST_F(PluginDirectory, IdWithoutItsKindSuggestsTheWholeId) {
  add_sound("energy_only");
  Registry registry({directory_});
  EXPECT_THAT(error_of([&] { registry.load("energy-only"); }), HasSubstr("did you mean \"elasticity/energy-only\"?"));
}

TEST_F(PluginDirectory, UnknownIdNamesTheRefusedFileOfThatName) {
  add_broken("wrong_major");
  Registry registry({directory_});
  EXPECT_THAT(error_of([&] { registry.load("elasticity/wrong-major"); }),
              AllOf(HasSubstr("wrong_major.so"), HasSubstr("ABI 2.0")));
}

TEST_F(PluginDirectory, LibraryStaysLoadedWhileAnInstanceLives) {
  const fs::path library = add_sound("energy_only");
  std::optional<Instance> instance;
  {
    Registry registry({directory_});
    instance.emplace(registry.load("elasticity/energy-only"), test::stiff(), Context{});
  }
  const auto is_mapped = [&] {
    std::ifstream maps("/proc/self/maps");
    std::string text(std::istreambuf_iterator<char>(maps), {});
    return text.find(directory_.string()) != std::string::npos;
  };
  EXPECT_TRUE(is_mapped());
  Instance moved = std::move(*instance);
  instance.reset();
  EXPECT_EQ(moved.elasticity().struct_size, sizeof(cleave_elasticity));
  EXPECT_TRUE(is_mapped());
  moved = Instance();
  EXPECT_FALSE(is_mapped());
}

TEST_F(PluginDirectory, LoadingTwiceGivesTheSamePlugin) {
  add_sound("energy_only");
  Registry registry({directory_});
  EXPECT_EQ(registry.load("elasticity/energy-only"), registry.load("elasticity/energy-only"));
}

TEST_F(PluginDirectory, ForcedBaselineLoadsTheLibraryItself) {
  setenv("CLEAVE_ISA", "x86-64-v2", 1);
  Registry registry({CLEAVE_FIXTURE_DIR "/sound"});
  EXPECT_EQ(registry.load("elasticity/energy-only")->path(), fs::path(CLEAVE_FIXTURE_DIR "/sound/energy_only.so"));
}

TEST_F(PluginDirectory, BestVariantTheProcessorRunsIsLoaded) {
  const fs::path variant = CLEAVE_FIXTURE_DIR "/sound/x86-64-v3/energy_only.so";
  if (!fs::exists(variant)) GTEST_SKIP() << "this build has no variants";
  if (preferred_isa_directories().empty()) GTEST_SKIP() << "this processor runs no variant";
  Registry registry({CLEAVE_FIXTURE_DIR "/sound"});
  EXPECT_EQ(registry.load("elasticity/energy-only")->path(), variant);
}

TEST_F(PluginDirectory, VariantThatIsAnotherPluginIsNotUsed) {
  if (preferred_isa_directories().empty()) GTEST_SKIP() << "this processor runs no variant";
  const fs::path library = add_sound("energy_only");
  for (const auto& isa : preferred_isa_directories()) {
    fs::create_directories(directory_ / isa);
    fs::copy_file(CLEAVE_FIXTURE_DIR "/sound/fibrous.so", directory_ / isa / "energy_only.so");
  }
  Registry registry({directory_});
  EXPECT_EQ(registry.load("elasticity/energy-only")->path(), library);
}

TEST_F(PluginDirectory, BrokenVariantIsNotUsed) {
  if (preferred_isa_directories().empty()) GTEST_SKIP() << "this processor runs no variant";
  const fs::path library = add_sound("energy_only");
  for (const auto& isa : preferred_isa_directories()) {
    fs::create_directories(directory_ / isa);
    std::ofstream(directory_ / isa / "energy_only.so") << "no library";
  }
  Registry registry({directory_});
  EXPECT_EQ(registry.load("elasticity/energy-only")->path(), library);
}

TEST_F(PluginDirectory, UnknownInstructionSetIsAnError) {
  setenv("CLEAVE_ISA", "avx512", 1);
  EXPECT_THAT(error_of([] { preferred_isa_directories(); }), HasSubstr("must be x86-64-v2, x86-64-v3 or x86-64-v4"));
}

TEST(SearchPath, StartsWithTheEnvironmentAndEndsBesideTheProgram) {
  setenv("CLEAVE_PLUGIN_PATH", "/somewhere::/elsewhere", 1);
  const auto path = Registry::default_search_path();
  unsetenv("CLEAVE_PLUGIN_PATH");
  ASSERT_EQ(path.size(), 3u);
  EXPECT_EQ(path[0], "/somewhere");
  EXPECT_EQ(path[1], "/elsewhere");
  EXPECT_EQ(path[2], fs::path(CLEAVE_BINARY_DIR "/lib/cleave/plugins"));
}

}  // namespace
}  // namespace cleave::plugins
