#include "app/bench_command.hpp"

#include "bench/gnuplot.hpp"
#include "bench/halo.hpp"
#include "bench/report.hpp"
#include "bench/step_report.hpp"
#include "common/error.hpp"
#include "output/atomic_file.hpp"

#include <fmt/format.h>
#include <tbb/info.h>
#include <toml++/toml.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cstdio>
#include <functional>

namespace cleave::app {
namespace {

[[noreturn]] void refuse(const std::string& option, const std::string& what) { throw InputError(option + ": error: " + what); }

/// A number, truth value, list of numbers, or else text.
plugins::Value parse_value(const std::string& option, const std::string& text) {
  toml::table table;
  try {
    table = toml::parse("value = " + text);
  } catch (const toml::parse_error&) {
    return text;
  }
  const toml::node& value = *table.get("value");
  if (const auto* flag = value.as_boolean()) return flag->get();
  if (const auto* integer = value.as_integer()) return integer->get();
  if (const auto* number = value.as_floating_point()) return number->get();
  if (const auto* word = value.as_string()) return word->get();
  if (const auto* list = value.as_array()) {
    std::vector<double> numbers;
    for (const auto& element : *list) {
      const auto number = element.value<double>();
      if (!number) refuse(option, "a list holds numbers");
      numbers.push_back(*number);
    }
    return numbers;
  }
  refuse(option, "must be a number, true, false, text or a list of numbers");
}

/// A number of the type that the schema wants: 1 may stand for 1.0.
plugins::Value as_declared(const plugins::Description& law, const std::string& key, plugins::Value value) {
  for (const auto& parameter : law.parameters)
    if (parameter.key == key && parameter.type == CLEAVE_TYPE_NUMBER)
      if (const auto* integer = std::get_if<std::int64_t>(&value)) return double(*integer);
  return value;
}

std::map<std::string, plugins::GivenParameters> parse_sets(const std::vector<std::string>& sets,
                                                           const plugins::Registry& registry) {
  std::map<std::string, plugins::GivenParameters> parameters;
  for (const auto& set : sets) {
    const std::string option = "--set " + set;
    const auto equals = set.find('='), dot = set.find('.');
    if (equals == std::string::npos || dot == 0 || dot > equals || dot + 1 == equals)
      refuse(option, "expected ID.PARAMETER=VALUE, for example elasticity/split-neo-hookean.youngs_modulus=1e6");
    const std::string id = set.substr(0, dot), key = set.substr(dot + 1, equals - dot - 1);
    const auto* law = registry.find(id);
    if (!law) refuse(option, registry.unknown_id(id));
    parameters[id][key] = as_declared(*law, key, parse_value(option, set.substr(equals + 1)));
  }
  return parameters;
}

void check_chart(const std::optional<std::filesystem::path>& chart) {
  if (!chart) return;
  if (chart->extension() != ".svg") refuse("--chart", "the chart is an .svg file");
  if (!bench::gnuplot_is_installed())
    refuse("--chart", "gnuplot is not installed; install it (Debian: gnuplot-nox), or leave out --chart");
}

config::Precision precision_named(const std::string& name) {
  return name == "single" ? config::Precision::single_precision : config::Precision::double_precision;
}

bench::StepSampling to_sampling(const BenchStepsOptions& options, config::Precision precision) {
  bench::StepSampling sampling{
      .threads = options.threads, .precisions = {}, .steps = options.steps, .repeats = options.repeats};
  if (sampling.threads.empty()) {
    sampling.threads = {1};
    if (const int all = tbb::info::default_concurrency(); all > 1) sampling.threads.push_back(all);
  }
  for (const auto& name : options.precisions) sampling.precisions.push_back(precision_named(name));
  if (sampling.precisions.empty()) sampling.precisions.push_back(precision);
  return sampling;
}

/// Whether a list holds different values, and so makes an axis of a chart.
template <class T>
bool varies(const std::vector<T>& values) {
  return std::adjacent_find(values.begin(), values.end(), std::not_equal_to<T>()) != values.end();
}

config::Scene read_scene(const std::filesystem::path& file, const std::vector<std::string>& sets, plugins::Registry& registry) {
  std::vector<config::Override> overrides;
  for (const auto& set : sets) overrides.push_back(config::parse_override(set));
  std::vector<std::string> warnings;
  config::Scene scene = config::load_scene(file, overrides, registry, &warnings);
  for (const auto& warning : warnings) fmt::print(stderr, "{}\n", warning);
  return scene;
}

bench::StepResults measure(const BenchStepsOptions& options, plugins::Registry& registry) {
  constexpr const char* wanted = "needs several --threads, or several --particles of a block";
  if (!options.scene.empty()) {
    const auto only_blocks = [](const char* option, bool given) {
      if (given) refuse(option, "is for blocks; a scene says so itself");
    };
    only_blocks("--particles", !options.particles.empty());
    only_blocks("--materials", !options.materials.empty());
    only_blocks("--dimension", options.dimension.has_value());
    const config::Scene scene = read_scene(options.scene, options.sets, registry);
    const auto sampling = to_sampling(options, scene.simulation.precision);
    if (options.chart && !varies(sampling.threads)) refuse("--chart", wanted);
    return bench::measure_steps(scene, sampling, registry);
  }
  const auto sampling = to_sampling(options, config::Precision::single_precision);
  if (options.chart && !varies(sampling.threads) && !varies(options.particles)) refuse("--chart", wanted);
  bench::BlockOptions blocks{.materials = options.materials,
                             .particles = options.particles,
                             .dimension = options.dimension.value_or(3),
                             .parameters = parse_sets(options.sets, registry)};
  if (blocks.materials == std::vector<std::string>{"all"}) blocks.materials.clear();
  return bench::measure_steps(blocks, sampling, registry);
}

void write(const std::filesystem::path& target, const std::string& text) {
  output::AtomicFile file(target);
  file.stream() << text;
  file.commit();
}

}  // namespace

void add_bench_options(CLI::App& cli, BenchOptions& options) {
  cli.add_option("--points", options.points, "Points per call (a simulation calls with 32)")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  cli.add_option("--repeats", options.repeats, "Samples of which the median is taken")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  auto* named = cli.add_option("plugins", options.plugins, "Measure these plugins, and compare them with the first of them")
                    ->type_name("PLUGIN");
  cli.add_option("--plugin", options.plugins, "The same, one at a time (repeatable; default: all)")
      ->allow_extra_args(false)
      ->excludes(named);
  cli.add_option("--elasticity", options.elasticity, "Elastic law that return mappings and damage laws are paired with");
  cli.add_option("--set", options.sets, "Parameter of a law: ID.PARAMETER=VALUE (repeatable)")->allow_extra_args(false);
  cli.add_option("--json", options.json, "Also write the numbers to this file");
  cli.add_option("--chart", options.chart, "Also draw them, as SVG (needs gnuplot)");
}

int bench_command(const BenchOptions& options, plugins::Registry& registry) {
  check_chart(options.chart);
  const bench::KernelOptions kernels{.points = options.points,
                                     .repeats = options.repeats,
                                     .plugins = options.plugins,
                                     .elasticity = options.elasticity,
                                     .parameters = parse_sets(options.sets, registry)};
  const auto results = bench::measure_kernels(kernels, registry);
  std::fputs(bench::table_text(kernels, results).c_str(), stdout);
  if (options.json) write(*options.json, bench::json_text(kernels, results));
  if (options.chart) write(*options.chart, bench::chart_svg(results));
  return 0;
}

void add_bench_steps_options(CLI::App& cli, BenchStepsOptions& options) {
  cli.add_option("scene", options.scene, "Scene file (TOML) to measure in place of blocks");
  const auto list = [](CLI::Option* option) { return option->delimiter(',')->allow_extra_args(false); };
  list(cli.add_option("--particles", options.particles,
                      "Sizes of the blocks, separated by commas (default: 1000000, 40960 of a constraint)"))
      ->check(CLI::Range(std::int64_t(100), std::int64_t(1000000000)));
  list(cli.add_option("--materials", options.materials,
                      "IDs of laws, separated by commas; ID+ID for laws together; all: every law, with an elastic law that "
                      "suits it (default: all)"));
  cli.add_option("--dimension", options.dimension, "3, or 2 for plane strain (default: 3)")->check(CLI::IsMember({2, 3}));
  list(cli.add_option("--threads", options.threads, "Numbers of threads, separated by commas (default: one, and all)"))
      ->check(CLI::Range(1, 1024));
  list(cli.add_option("--precision", options.precisions, "single, double, or both (default: single, or the scene's)"))
      ->check(CLI::IsMember({"single", "double"}));
  cli.add_option("--steps", options.steps, "Steps of a sample")->check(CLI::Range(1, 1000000))->capture_default_str();
  cli.add_option("--repeats", options.repeats, "Samples of which the median is taken")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  cli.add_option("--set", options.sets, "Parameter of a law: ID.PARAMETER=VALUE; with a scene: path=value (repeatable)")
      ->allow_extra_args(false);
  cli.add_flag("--markdown", options.markdown, "Print a Markdown table");
  cli.add_option("--json", options.json, "Also write the numbers to this file");
  cli.add_option("--chart", options.chart, "Also draw speed over particles and over threads, as SVG (needs gnuplot)");
}

int bench_steps_command(const BenchStepsOptions& options, plugins::Registry& registry) {
  check_chart(options.chart);
  const auto results = measure(options, registry);
  std::fputs((options.markdown ? bench::markdown_text(results) : bench::table_text(results)).c_str(), stdout);
  if (options.json) write(*options.json, bench::json_text(results));
  if (options.chart) write(*options.chart, bench::chart_svg(results));
  return 0;
}

void add_bench_halo_options(CLI::App& cli, BenchHaloOptions& options) {
  cli.add_option("scene", options.scene, "Scene file (TOML)")->required();
  cli.add_option("--parts", options.parts, "Numbers of parts, separated by commas (default: 2,4,8,16,32,64)")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(2, 4096));
  cli.add_option("--samples", options.samples, "Instants that are looked at")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  cli.add_option("--steps", options.steps, "Steps between a division and the look at what has left its part")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  cli.add_option("--set", options.sets, "Change a value: path=value (repeatable)")->allow_extra_args(false);
  cli.add_flag("--markdown", options.markdown, "Print a Markdown table");
}

int bench_halo_command(const BenchHaloOptions& options, plugins::Registry& registry) {
  bench::HaloOptions halo{.samples = options.samples, .steps = options.steps};
  if (!options.parts.empty()) halo.parts = options.parts;
  const auto results = bench::measure_halo(read_scene(options.scene, options.sets, registry), halo, registry);
  std::fputs((options.markdown ? bench::halo_markdown(results) : bench::halo_text(results)).c_str(), stdout);
  return 0;
}

}  // namespace cleave::app
