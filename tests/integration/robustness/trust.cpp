#include "plugins/trust.hpp"

#include "plugins/registry.hpp"
#include "robust.hpp"

#include <sys/stat.h>

#include <chrono>

namespace cleave::test {
namespace {

class Trust : public Robust {
 protected:
  void SetUp() override {
    fs::create_directory(directory / "laws");
    fs::create_directory(directory / "elsewhere");
    write("scene.toml", sound_scene);
  }
  /// A sound law of this name, and its manifest.
  fs::path add(const std::string& folder, const std::string& name = "energy_only", bool manifest = true) const {
    const fs::path from = fs::path(CLEAVE_FIXTURE_DIR) / "sound", to = directory / folder / (name + ".so");
    fs::copy_file(from / (name + ".so"), to);
    if (manifest) fs::copy_file(from / (name + ".cleave.toml"), directory / folder / (name + ".cleave.toml"));
    return to;
  }
  fs::path add_bad_start(const std::string& name) const {
    fs::copy_file(fs::path(CLEAVE_BAD_STARTS) / (name + ".so"), directory / "laws" / (name + ".so"));
    return directory / "laws" / (name + ".so");
  }
  std::string refusal(const std::string& name) const {
    const plugins::Registry registry({directory / "laws"});
    for (const auto& found : registry.found())
      if (found.path.stem() == name) return found.refusal.empty() ? "usable" : found.refusal;
    return "not found";
  }
};

TEST_F(Trust, PluginsOfOtherDirectoriesAreNotLoaded) {
  add("elsewhere");
  expect_command("plugins elasticity/energy-only", 2, "there is no plugin \"elasticity/energy-only\"");
  expect_command("plugins elasticity/energy-only --allow-plugins-from elsewhere", 0, "");
  expect_command("--allow-plugins-from laws --allow-plugins-from elsewhere plugins elasticity/energy-only", 0, "");
  expect_command("run scene.toml --allow-plugins-from nowhere", 2, "--allow-plugins-from nowhere: there is no such directory");
  expect_command("run scene.toml --allow-plugins-from scene.toml", 2, "there is no such directory");
}

TEST_F(Trust, LinkOutOfTheDirectoryIsRefused) {
  const auto outside = add("elsewhere");
  for (const bool manifest : {false, true}) {
    fs::create_symlink(outside, directory / "laws/energy_only.so");
    if (manifest) fs::copy_file(directory / "elsewhere/energy_only.cleave.toml", directory / "laws/energy_only.cleave.toml");
    EXPECT_EQ(refusal("energy_only"), "is a link to " + fs::canonical(outside).string() +
                                          ", outside of the directories of plugins; allow it with --allow-plugins-from " +
                                          fs::canonical(outside).parent_path().string());
    fs::remove(directory / "laws/energy_only.so");
  }
  fs::create_symlink("../elsewhere/energy_only.so", directory / "laws/energy_only.so");
  EXPECT_NE(refusal("energy_only").find("is a link to"), std::string::npos);
  // Both directories are allowed: the link is as good as its target.
  EXPECT_NE(plugins::Registry({directory / "laws", directory / "elsewhere"}).find("elasticity/energy-only"), nullptr);
}

TEST_F(Trust, LinkThatTurnsOutwardsAfterTheScanIsRefusedOnLoading) {
  const auto inside = add("laws");
  plugins::Registry registry({directory / "laws"});
  ASSERT_NE(registry.find("elasticity/energy-only"), nullptr);
  fs::rename(inside, directory / "elsewhere/energy_only.so");
  fs::create_symlink(directory / "elsewhere/energy_only.so", inside);
  EXPECT_THROW(registry.load("elasticity/energy-only"), std::runtime_error);
}

TEST_F(Trust, VariantForTheProcessorThatLeadsOutIsNotUsed) {
  const auto inside = add("laws");
  for (const char* isa : {"x86-64-v3", "x86-64-v4"}) {
    fs::create_directory(directory / "laws" / isa);
    fs::create_symlink(add("elsewhere", "energy_only", false).string(), directory / "laws" / isa / "energy_only.so");
    fs::rename(directory / "elsewhere/energy_only.so", directory / "elsewhere" / isa);
    fs::remove(directory / "laws" / isa / "energy_only.so");
    fs::create_symlink(directory / "elsewhere" / isa, directory / "laws" / isa / "energy_only.so");
  }
  plugins::Registry registry({directory / "laws"});
  EXPECT_EQ(registry.load("elasticity/energy-only")->path(), inside);
}

TEST_F(Trust, LinkWithinTheDirectoryAndDirectoryThatIsALinkAreUsed) {
  fs::rename(add("laws"), directory / "laws/renamed.bin");
  fs::create_symlink("renamed.bin", directory / "laws/energy_only.so");
  fs::create_symlink(directory / "laws", directory / "link");
  EXPECT_NE(plugins::Registry({directory / "link"}).find("elasticity/energy-only"), nullptr);
}

TEST_F(Trust, FilesThatAreNoLibraries) {
  ASSERT_EQ(::mkfifo((directory / "laws/pipe.so").c_str(), 0600), 0);
  fs::create_symlink("nothing.so", directory / "laws/dangling.so");
  fs::create_symlink("circle.so", directory / "laws/circle.so");
  fs::create_symlink("/dev/zero", directory / "laws/endless.so");
  EXPECT_EQ(refusal("pipe"), "is no regular file");
  EXPECT_EQ(refusal("endless"), "is no regular file");
  EXPECT_EQ(refusal("dangling"), "cannot be read");
  EXPECT_EQ(refusal("circle"), "cannot be read");
}

TEST_F(Trust, ManifestThatIsEndlessOrDeepIsIgnored) {
  const auto library = add("laws", "energy_only", false);
  fs::create_symlink("/dev/zero", directory / "laws/energy_only.cleave.toml");
  EXPECT_EQ(refusal("energy_only"), "usable");
  fs::remove(directory / "laws/energy_only.cleave.toml");
  std::string deep = "a";
  for (int i = 0; i < 100000; ++i) deep += ".a";
  write("laws/energy_only.cleave.toml", deep + " = 1\n");
  EXPECT_EQ(refusal("energy_only"), "usable");
  std::ofstream(directory / "laws/energy_only.cleave.toml") << std::string(2 << 20, '#');
  EXPECT_EQ(refusal("energy_only"), "usable");
}

TEST_F(Trust, WritersAreWarnedOf) {
  const auto library = add("laws");
  fs::permissions(directory / "laws", fs::perms(0755));
  fs::permissions(library, fs::perms(0755));
  EXPECT_TRUE(plugins::world_writable(library).empty()) << "a directory with the sticky bit above is none";
  fs::permissions(library, fs::perms(0757));
  EXPECT_EQ(plugins::world_writable(library), std::vector<fs::path>{fs::canonical(library)});
  fs::permissions(library, fs::perms(0755));
  fs::permissions(directory / "laws", fs::perms(01777));
  EXPECT_EQ(plugins::world_writable(library), std::vector<fs::path>{fs::canonical(directory / "laws")});
  fs::permissions(directory / "laws", fs::perms(0755));
  fs::permissions(directory, fs::perms(0777));
  EXPECT_EQ(plugins::world_writable(library), std::vector<fs::path>{fs::canonical(directory)});

  fs::permissions(directory, fs::perms(0755));
  fs::permissions(library, fs::perms(0666));
  auto scene = sound_scene;
  scene.replace(scene.find("split-neo-hookean"), 17, "energy-only");
  write("scene.toml", scene);
  const Outcome run = cleave("run scene.toml --out run --allow-plugins-from laws");
  EXPECT_NE(run.err.find("warning: "), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("any user can change this plugin"), std::string::npos) << run.err;
}

TEST_F(Trust, SummaryHasTheDigestOfEveryPlugin) {
  ASSERT_EQ(cleave("run scene.toml --out run").status, 0);
  int plugins = 0;
  const auto summary = json(directory / "run/summary.json");
  for (const auto& [key, plugin] : summary.get_child("plugins")) {
    const std::string command =
        "sha256sum '" + plugin.get<std::string>("path") + "' | cut -d' ' -f1 > '" + directory.string() + "/digest'";
    ASSERT_EQ(std::system(command.c_str()), 0);
    EXPECT_EQ(plugin.get<std::string>("sha256") + "\n", contents(directory / "digest"));
    ++plugins;
  }
  EXPECT_EQ(plugins, 1);
}

TEST_F(Trust, ChildProcessTellsWhatALibraryDoes) {
  EXPECT_EQ(plugins::problem_in_child(add("laws")), std::nullopt);
  EXPECT_EQ(plugins::problem_in_child(add_bad_start("exits")).value(),
            "ends the process when it is opened, with exit status 0");
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(plugins::problem_in_child(add_bad_start("hangs"), 0.5).value(), "hangs when it is opened: no answer after 0.5 s");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(8));
  const auto no_plugin = directory / "laws/no_entry.so";
  fs::copy_file(fs::path(CLEAVE_FIXTURE_DIR) / "broken/no_entry.so", no_plugin);
  EXPECT_NE(plugins::problem_in_child(no_plugin).value().find("exports no cleave_plugin_entry"), std::string::npos);
}

TEST_F(Trust, IsolationNamesThePluginAndTheProgramLives) {
  add_bad_start("crashes");
  add_bad_start("aborts_in_entry");
  add("laws");
  EXPECT_GE(cleave("plugins --explain --allow-plugins-from laws").status, 128) << "without isolation";
  const Outcome listed = cleave("plugins --explain --isolate --allow-plugins-from laws");
  EXPECT_EQ(listed.status, 0) << listed.err;
  EXPECT_NE(listed.out.find("crashes when it is opened: signal 11"), std::string::npos) << listed.out;
  EXPECT_NE(listed.out.find("crashes when it is opened: signal 6"), std::string::npos) << listed.out;
  EXPECT_NE(listed.out.find("elasticity/energy-only"), std::string::npos) << listed.out;
  expect_command("run scene.toml --quiet --out run --isolate --allow-plugins-from laws", 0, "");
  auto scene = sound_scene;
  scene.replace(scene.find("split-neo-hookean"), 17, "crashes");
  write("scene.toml", scene);
  expect_command("run scene.toml --isolate --allow-plugins-from laws", 2, "crashes when it is opened: signal 11");
}

TEST_F(Trust, EveryCommandThatLoadsPluginsIsolatesThem) {
  const auto law = add("laws");
  auto scene = sound_scene;
  scene.replace(scene.find("split-neo-hookean"), 17, "energy-only");
  write("scene.toml", scene);
  write("study.toml",
        "title = \"Stiffness\"\nscene = \"scene.toml\"\n[[axis]]\nname = \"E\"\nunit = \"Pa\"\n"
        "paths = [\"material.rubber.elasticity.youngs_modulus\"]\nvalues = [1e5, 2e5]\n[error]\ntitle = \"speed\"\n"
        "value = \"momentum_y / mass\"\nformula = \"0\"\n");
  ASSERT_EQ(cleave("run scene.toml --quiet --out run --frames 1 --allow-plugins-from laws").status, 0);
  add_bad_start("crashes");
  const std::string commands[] = {
      "validate scene.toml",
      "plugins elasticity/energy-only",
      "point --elasticity energy-only --set elasticity.youngs_modulus=1e5 --set elasticity.poissons_ratio=0.3 --path "
      "simple-shear --amplitude 0.1",
      "bench kernels elasticity/energy-only --repeats 1",
      "bench steps scene.toml --steps 1 --repeats 1 --threads 1",
      "check elasticity/energy-only --only abi.loads",
      "study study.toml --dry-run",
      "render run --frames 1 --size 64x64 --samples 1 --quiet",
  };
  for (const auto& command : commands) {
    const std::string trusting = command + " --allow-plugins-from laws";
    EXPECT_GE(cleave(trusting).status, sanitized ? 1 : 128) << trusting << " does not open plugins: it needs no isolation";
    expect_command(trusting + " --isolate", 0, "");
  }
  // a check runs in a process of its own, whether it is told to or not
  expect_command("check laws/crashes.so --isolate", 1, "");
}

}  // namespace
}  // namespace cleave::test
