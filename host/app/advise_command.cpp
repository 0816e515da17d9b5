#include "app/advise_command.hpp"

#include "advise/advise.hpp"
#include "bench/json.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdio>

namespace cleave::app {
namespace {

toml::array texts(const std::vector<std::string>& list) {
  toml::array array;
  for (const std::string& text : list) array.push_back(text);
  return array;
}

void print_json(const advise::Advised& advised) {
  toml::table table;
  if (const auto& f = advised.forecast) {
    toml::table forecast{{"particles", f->particles}, {"frames", f->frames}, {"time_step", f->time_step},
                         {"bound", f->bound},         {"steps", f->steps},   {"memory_bytes", f->memory}};
    if (f->thread_seconds) forecast.insert("thread_seconds", *f->thread_seconds);
    table.insert("forecast", std::move(forecast));
  }
  toml::array list;
  for (const advise::Advice& advice : advised.advice) {
    toml::table entry{{"what", advice.what},
                      {"reason", advice.reason},
                      {"effect", advice.effect},
                      {"set", texts(advice.set)},
                      {"remove", texts(advice.remove)}};
    if (advice.speedup) entry.insert("speedup", *advice.speedup);
    list.push_back(std::move(entry));
  }
  table.insert("advice", std::move(list));
  fmt::print("{}\n", bench::json_text(table));
}

void print_text(const advise::Advised& advised) {
  if (const auto& f = advised.forecast) {
    fmt::print("{} particles, about {:.3g} steps of {:.3g} s ({}), {} frames, {:.3g} MB of particles", f->particles, f->steps,
               f->time_step, f->bound, f->frames, f->memory / 1e6);
    if (f->thread_seconds) fmt::print(", about {:.2g} s of one thread", *f->thread_seconds);
    fmt::print("\n");
  }
  if (advised.advice.empty()) fmt::print("nothing to advise\n");
  for (const advise::Advice& advice : advised.advice) {
    fmt::print("\n{}\n  because {}\n  then    {}\n", advice.what, advice.reason, advice.effect);
    for (const std::string& set : advice.set) fmt::print("  --set '{}'\n", set);
    for (const std::string& path : advice.remove) fmt::print("  remove  {}\n", path);
  }
}

}  // namespace

void add_advise_options(CLI::App& cli, AdviseOptions& options) {
  cli.add_option("scene", options.scene, "Scene file (TOML)")->required();
  cli.add_option("--set", options.sets, "Change a value: path=value (repeatable)")->allow_extra_args(false);
  cli.add_option("--costs", options.costs,
                 "Also recorded costs, of your plugins or your machine: a file of `cleave bench steps --json` (repeatable)")
      ->allow_extra_args(false);
  cli.add_flag("--json", options.json, "Machine-readable output");
}

int advise_command(const AdviseOptions& options, plugins::Registry registry) {
  advise::Costs costs = advise::Costs::shipped();
  for (const auto& file : options.costs) costs.add(advise::Costs::read(file));
  std::vector<config::Override> given;
  for (const std::string& set : options.sets) given.push_back(config::parse_override(set));
  std::vector<std::string> warnings;
  const config::Scene scene = config::load_scene(options.scene, given, registry, &warnings);
  for (const std::string& warning : warnings) fmt::print(stderr, "{}\n", warning);
  const auto advised = advise::advise(scene, given, registry, costs, advise::this_machine());
  options.json ? print_json(advised) : print_text(advised);
  return 0;
}

}  // namespace cleave::app
