#include "app/bench_command.hpp"

#include "bench/report.hpp"
#include "common/error.hpp"
#include "output/atomic_file.hpp"

#include <toml++/toml.h>
#include <CLI/CLI.hpp>

#include <cstdio>

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

bench::KernelOptions to_kernel_options(const BenchOptions& options, const plugins::Registry& registry) {
  bench::KernelOptions kernels{.points = options.points,
                               .repeats = options.repeats,
                               .plugins = options.plugins,
                               .elasticity = options.elasticity,
                               .parameters = {}};
  for (const auto& set : options.sets) {
    const std::string option = "--set " + set;
    const auto equals = set.find('='), dot = set.find('.');
    if (equals == std::string::npos || dot == 0 || dot > equals || dot + 1 == equals)
      refuse(option, "expected ID.PARAMETER=VALUE, for example elasticity/split-neo-hookean.youngs_modulus=1e6");
    const std::string id = set.substr(0, dot), key = set.substr(dot + 1, equals - dot - 1);
    const auto* law = registry.find(id);
    if (!law) refuse(option, registry.unknown_id(id));
    kernels.parameters[id][key] = as_declared(*law, key, parse_value(option, set.substr(equals + 1)));
  }
  return kernels;
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
  auto* named = cli.add_option("plugins", options.plugins, "Measure these plugins, and compare them with the first of them");
  cli.add_option("--plugin", options.plugins, "The same, one at a time (repeatable; default: all)")
      ->allow_extra_args(false)
      ->excludes(named);
  cli.add_option("--elasticity", options.elasticity, "Elastic law that return mappings and damage laws are paired with");
  cli.add_option("--set", options.sets, "Parameter of a law: ID.PARAMETER=VALUE (repeatable)")->allow_extra_args(false);
  cli.add_option("--json", options.json, "Also write the numbers to this file");
  cli.add_option("--chart", options.chart, "Also draw them, as SVG (needs gnuplot)");
}

int bench_command(const BenchOptions& options, plugins::Registry& registry) {
  if (options.chart && options.chart->extension() != ".svg") refuse("--chart", "the chart is an .svg file");
  if (options.chart && !bench::gnuplot_is_installed())
    refuse("--chart", "gnuplot is not installed; install it (Debian: gnuplot-nox), or leave out --chart");
  const auto kernels = to_kernel_options(options, registry);
  const auto results = bench::measure_kernels(kernels, registry);
  std::fputs(bench::table_text(kernels, results).c_str(), stdout);
  if (options.json) write(*options.json, bench::json_text(kernels, results));
  if (options.chart) write(*options.chart, bench::chart_svg(results));
  return 0;
}

}  // namespace cleave::app
