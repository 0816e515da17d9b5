#include "app/check_command.hpp"

#include "common/error.hpp"
#include "plugins/isa.hpp"
#include "plugins/registry.hpp"

#include <cleave/testkit/runner.hpp>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <stdexcept>

namespace cleave::app {
namespace {

/// A file, or the library of the plugin of this ID: its build for an instruction set if one is forced.
std::filesystem::path library_of(const std::string& plugin) {
  if (std::filesystem::is_regular_file(plugin)) return plugin;
  const plugins::Registry registry(plugins::Registry::default_search_path());
  for (const auto& found : registry.found())
    if (found.description && found.description->id == plugin && found.refusal.empty())
      return plugins::forced_variant(found.path);
  if (plugin.ends_with(".so")) throw InputError("there is no plugin library \"" + plugin + "\"");
  throw InputError(registry.unknown_id(plugin));
}

std::vector<std::filesystem::path> all_libraries() {
  std::vector<std::filesystem::path> libraries;
  const plugins::Registry registry(plugins::Registry::default_search_path());
  for (const auto& found : registry.found())
    libraries.push_back(plugins::forced_variant(found.path));  // those that are refused, too: they fail abi.loads
  if (libraries.empty()) throw InputError("no plugin found; cleave plugins --explain says where they were looked for");
  return libraries;
}

}  // namespace

void add_check_options(CLI::App& cli, CheckOptions& options) {
  cli.add_option("plugins", options.plugins, "Plugin libraries (files), or IDs of plugins")->type_name("PLUGIN");
  cli.add_flag("--all", options.all, "Check every plugin that is found");
  cli.add_flag("--list", options.list, "Print the checks, each with what it asks for");
  cli.add_option("--only", options.only, "Run this check only (repeatable)")->allow_extra_args(false);
  cli.add_option("--set", options.sets, "Fix a parameter of the law: key=value (repeatable)")->allow_extra_args(false);
  cli.add_option("--seed", options.seed, "Seed of the random cases");
  cli.add_option("--reproduce", options.reproduce, "Run only this random case, as a failure named it");
  cli.add_option("--time-limit", options.time_limit, "Seconds one check may take")->check(CLI::PositiveNumber);
  cli.add_flag("--json", options.json, "Machine-readable output");
  cli.add_option("--junit", options.junit, "Write the results to this file as JUnit XML");
}

int check_command(const CheckOptions& options) {
  if (options.list) {
    fmt::print("{}", testkit::list_checks());
    return 0;
  }
  if (options.all ? !options.plugins.empty() : options.plugins.empty())
    throw InputError("name the plugins to check, for example elasticity/qr or plugins/my_law.so, or ask for --all");
  std::vector<std::filesystem::path> libraries;
  if (options.all) libraries = all_libraries();
  for (const auto& plugin : options.plugins) libraries.push_back(library_of(plugin));
  testkit::Options kit;
  kit.seed = options.seed;
  kit.reproduce = options.reproduce;
  kit.time_limit = options.time_limit;
  for (const auto& set : options.sets) {
    const auto equals = set.find('=');
    if (equals == 0 || equals == std::string::npos) throw InputError("--set " + set + ": write key=value");
    kit.set[set.substr(0, equals)] = set.substr(equals + 1);
  }
  if (options.reproduce && options.only.size() != 1) throw InputError("--reproduce needs the one check it is about: --only ID");

  std::vector<testkit::Report> reports;
  for (const auto& library : libraries) {
    kit.library = library;
    try {
      reports.push_back(testkit::run_checks(kit, options.only));
    } catch (const std::invalid_argument& error) {
      throw InputError(error.what());
    }
    if (!options.json) fmt::print("{}", testkit::to_table(reports.back()));
  }
  if (options.json) fmt::print("{}", testkit::to_json(reports));
  if (!options.junit.empty()) {
    std::ofstream file(options.junit);
    file << testkit::to_junit(reports);
    if (!file.flush()) throw InputError("cannot write " + options.junit.string());
  }
  return std::all_of(reports.begin(), reports.end(), [](const auto& report) { return report.passed(); }) ? 0 : 1;
}

}  // namespace cleave::app
