#include "bench/step_report.hpp"

#include "bench/gnuplot.hpp"
#include "bench/json.hpp"
#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

namespace cleave::bench {
namespace {

const char* precision_name(config::Precision precision) {
  return precision == config::Precision::single_precision ? "single" : "double";
}

double stage_of(const StepResult& result, const std::string& name) {
  for (const auto& stage : result.stages)
    if (stage.first == name) return stage.second;
  return 0;
}

/// Stages that took time anywhere, in their order.
std::vector<std::string> stage_names(const StepResults& results) {
  std::vector<std::string> names;
  for (const StepResult& result : results.results)
    for (const auto& [name, nanoseconds] : result.stages)
      if (nanoseconds >= 0.005 && std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  return names;
}

/// What only some blocks have: a column where any of them has it.
struct Extra {
  const char *column, *key;
  std::optional<double> (*of)(const StepResult&);
  const char* format;
};
const Extra extras[] = {
    {"yielding", "yielding_fraction", [](const StepResult& r) { return r.yielding; }, "{:.2f}"},
    {"s/step", "seconds_per_step",
     [](const StepResult& r) {
       return r.constraint_iterations || r.newton_iterations ? std::optional(r.seconds_per_step()) : std::nullopt;
     },
     "{:.3g}"},
    {"iterations", "constraint_iterations", [](const StepResult& r) { return r.constraint_iterations; }, "{:.1f}"},
    {"residual", "constraint_residual", [](const StepResult& r) { return r.constraint_residual; }, "{:.1e}"},
    {"Newton", "newton_iterations", [](const StepResult& r) { return r.newton_iterations; }, "{:.1f}"},
    {"linear", "linear_iterations", [](const StepResult& r) { return r.linear_iterations; }, "{:.1f}"}};

bool occurs(const StepResults& results, const Extra& extra) {
  return std::any_of(results.results.begin(), results.results.end(), [&](const auto& r) { return bool(extra.of(r)); });
}

/// Header and rows of the table; the first column is text, the others are numbers or short words.
std::vector<std::vector<std::string>> cells(const StepResults& results) {
  const auto stages = stage_names(results);
  std::vector<std::vector<std::string>> rows{{"material", "particles", "precision", "threads", "Mp/s", "ns", "bytes"}};
  for (const Extra& extra : extras)
    if (occurs(results, extra)) rows[0].push_back(extra.column);
  rows[0].insert(rows[0].end(), stages.begin(), stages.end());
  for (const StepResult& result : results.results) {
    rows.push_back({result.material, std::to_string(result.particles), precision_name(result.precision),
                    std::to_string(result.threads), fmt::format("{:.1f}", 1e-6 * result.particle_steps_per_second()),
                    fmt::format("{:.2f}", result.median), fmt::format("{:g}", result.bytes_per_particle.back().second)});
    for (const Extra& extra : extras) {
      if (!occurs(results, extra)) continue;
      const auto value = extra.of(result);
      rows.back().push_back(value ? fmt::format(fmt::runtime(extra.format), *value) : "");
    }
    for (const auto& stage : stages) rows.back().push_back(fmt::format("{:.2f}", stage_of(result, stage)));
  }
  return rows;
}

std::string conditions(const StepResults& results) {
  return fmt::format(
      "whole steps in {}D, {} kernels, {} steps per sample, median of {}\n"
      "Mp/s: million particle-steps per second; ns: wall time per particle and step, stages last; bytes per particle",
      results.dimension, results.isa, results.sampling.steps, results.sampling.repeats);
}

std::string remarks(const StepResults& results) {
  std::string text;
  if (results.peak_memory)
    text += fmt::format("peak memory of the process: {:.1f} MiB\n", double(*results.peak_memory) / 1048576);
  if (!results.results.empty() && results.results.back().turn > 0)
    text += "not all were in memory at once: compare those of the same turn (see --json)\n";
  for (const auto& [material, reason] : results.skipped) text += fmt::format("not measured: {}: {}\n", material, reason);
  return text;
}

toml::table to_json(const std::vector<std::pair<std::string, double>>& values) {
  toml::table table;
  for (const auto& [name, value] : values) table.insert(name, value);
  return table;
}

/// One panel: a line of points for each material and precision among the results.
struct Panel {
  std::string label;
  bool logarithmic;
  std::vector<const StepResult*> results;
  double (*abscissa)(const StepResult&);
};

std::vector<Panel> panels(const StepResults& results) {
  std::set<std::int64_t> particles;
  std::set<int> threads;
  std::map<std::pair<std::string, config::Precision>, std::int64_t> most_particles;
  for (const StepResult& result : results.results) {
    particles.insert(result.particles);
    threads.insert(result.threads);
    auto& most = most_particles[{result.material, result.precision}];
    most = std::max(most, result.particles);
  }
  Panel over_particles{"particles", true, {}, [](const StepResult& r) { return double(r.particles); }};
  Panel over_threads{"threads", false, {}, [](const StepResult& r) { return double(r.threads); }};
  for (const StepResult& result : results.results) {
    if (particles.size() > 1 && result.threads == *threads.rbegin()) over_particles.results.push_back(&result);
    if (threads.size() > 1 && result.particles == most_particles[{result.material, result.precision}])
      over_threads.results.push_back(&result);
  }
  std::vector<Panel> drawn;
  for (auto* panel : {&over_particles, &over_threads})
    if (!panel->results.empty()) drawn.push_back(*panel);
  return drawn;
}

/// 99996 as "100k".
std::string short_number(double x) {
  if (x >= 999'500) return fmt::format("{:.3g}M", 1e-6 * x);
  return x >= 1000 ? fmt::format("{:.3g}k", 1e-3 * x) : fmt::format("{:g}", x);
}

std::string panel_script(const Panel& panel) {
  std::map<std::pair<std::string, config::Precision>, std::map<double, double>> lines;
  std::set<double> ticks;
  for (const StepResult* result : panel.results) {
    const double x = panel.abscissa(*result);
    lines[{result->material, result->precision}][x] = 1e-6 * result->particle_steps_per_second();
    ticks.insert(x);
  }
  std::string data, plots, tick_list;
  for (const double x : ticks) tick_list += fmt::format("{}'{}' {}", tick_list.empty() ? "" : ", ", short_number(x), x);
  std::map<std::string, int> colors;
  int line = 0;
  for (const auto& [key, points] : lines) {
    const auto& [material, precision] = key;
    const int color = colors.try_emplace(material, int(colors.size()) + 1).first->second;
    const std::string block = fmt::format("${}{}", panel.label, ++line);
    data += block + " << END\n";
    for (const auto& [x, y] : points) data += fmt::format("{} {}\n", x, y);
    data += "END\n";
    plots += fmt::format("{}{} using 1:2 with linespoints lc {} dt {} pt 7 ps 0.6 title {}", plots.empty() ? "" : ", ", block,
                         color, precision == config::Precision::single_precision ? 1 : 2,
                         gnuplot_text(material + ", " + precision_name(precision)));
  }
  return fmt::format(
      "{}{} logscale x\nset xlabel '{}'\nset xtics ({})\nset xrange [{}:{}]\nset yrange [0:*]\n"
      "set ylabel 'million particle-steps per second'\nplot {}\n",
      data, panel.logarithmic ? "set" : "unset", panel.label, tick_list, *ticks.begin() * 0.9, *ticks.rbegin() * 1.1, plots);
}

}  // namespace

std::string table_text(const StepResults& results) {
  const auto rows = cells(results);
  std::vector<std::size_t> widths(rows[0].size(), 0);
  for (const auto& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  std::string text = conditions(results) + "\n\n";
  for (const auto& row : rows) {
    text += fmt::format("{:<{}}", row[0], widths[0]);
    for (std::size_t i = 1; i < row.size(); ++i) text += fmt::format("  {:>{}}", row[i], widths[i]);
    text += '\n';
  }
  return text + remarks(results);
}

std::string markdown_text(const StepResults& results) {
  std::string text = conditions(results) + "\n\n";
  const auto rows = cells(results);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    text += '|';
    for (const auto& cell : rows[i]) text += ' ' + cell + " |";
    text += '\n';
    if (i > 0) continue;
    text += "|---|";
    for (std::size_t k = 1; k < rows[i].size(); ++k) text += "--:|";
    text += '\n';
  }
  const std::string further = remarks(results);
  return further.empty() ? text : text + '\n' + further;
}

std::string json_text(const StepResults& results) {
  toml::array measured, skipped;
  for (const StepResult& result : results.results) {
    toml::table laws;
    for (const auto& [id, parameters] : result.laws) laws.insert(id, to_json(parameters));
    measured.push_back(toml::table{{"material", result.material},
                                   {"laws", std::move(laws)},
                                   {"particles", result.particles},
                                   {"precision", precision_name(result.precision)},
                                   {"threads", result.threads},
                                   {"turn", result.turn},
                                   {"particle_steps_per_second", result.particle_steps_per_second()},
                                   {"median_ns", result.median},
                                   {"fastest_ns", result.fastest},
                                   {"stages_ns", to_json(result.stages)},
                                   {"bytes_per_particle", to_json(result.bytes_per_particle)}});
    for (const Extra& extra : extras)
      if (const auto value = extra.of(result)) measured.back().as_table()->insert(extra.key, *value);
  }
  for (const auto& [material, reason] : results.skipped)
    skipped.push_back(toml::table{{"material", material}, {"reason", reason}});
  toml::table table{{"dimension", results.dimension},  {"isa", results.isa},
                    {"steps", results.sampling.steps}, {"repeats", results.sampling.repeats},
                    {"results", std::move(measured)},  {"skipped", std::move(skipped)}};
  if (results.peak_memory) table.insert("peak_memory_bytes", *results.peak_memory);
  return json_text(table);
}

std::string chart_svg(const StepResults& results) {
  const auto drawn = panels(results);
  if (drawn.empty())
    throw InputError("there is nothing to draw: no material was measured in several sizes or with several threads");
  std::size_t lines = 0;
  for (const Panel& panel : drawn) lines = std::max(lines, panel.results.size());
  std::string script = fmt::format(
      "set terminal svg noenhanced size 1200,{} background 'white'\nset multiplot layout {},1\n"
      "set border 3\nset tics nomirror\nset grid\nset key outside right top\n",
      std::max<std::size_t>(420, 80 + 9 * lines) * drawn.size(), drawn.size());
  for (const Panel& panel : drawn) script += panel_script(panel);
  return draw_svg(script + "unset multiplot\n");
}

}  // namespace cleave::bench
