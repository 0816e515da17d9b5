#include "app/point_command.hpp"

#include "common/error.hpp"
#include "common/nearest.hpp"
#include "output/atomic_file.hpp"
#include "point/columns.hpp"
#include "point/csv_table.hpp"
#include "point/evaluator.hpp"
#include "point/json_stream.hpp"
#include "point/load_path.hpp"
#include "point/replay.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <limits>
#include <set>

namespace cleave::app {
namespace {

void warn(const std::string& text) {
  std::fflush(stdout);
  fmt::print(stderr, "{}\n", text);
}

[[noreturn]] void refuse(const std::string& option, const std::string& what) { throw InputError(option + ": error: " + what); }

void write(const std::filesystem::path& target, const std::string& text) {
  std::error_code status;
  if (target == "-") {
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0)
      throw InputError("cannot write the standard output");
    return;
  }
  if (std::filesystem::exists(target, status) && !std::filesystem::is_regular_file(target, status)) {
    // A pipe or device is written to, not replaced.
    std::ofstream stream(target, std::ios::binary);
    if (!(stream << text << std::flush)) throw InputError("cannot write " + target.string());
    return;
  }
  output::AtomicFile file(target);
  file.stream() << text;
  file.commit();
}

/// Counts the points that a reader of the numbers has to know about.
class Tally {
 public:
  void add(cleave_status status, const std::string& where) {
    if (status == CLEAVE_STATUS_OK) return;
    ++counts_[std::min<std::size_t>(status, CLEAVE_STATUS_FATAL)];
    if (first_.empty() || (status >= CLEAVE_STATUS_RETRY && !unusable_)) first_ = where;
    unusable_ = unusable_ || status >= CLEAVE_STATUS_RETRY;
  }
  void report(std::size_t points) const {
    std::string text;
    for (const cleave_status status : {CLEAVE_STATUS_FATAL, CLEAVE_STATUS_RETRY, CLEAVE_STATUS_UNRELIABLE})
      if (counts_[status] > 0) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", counts_[status], point::name(status));
    if (text.empty()) return;
    warn(fmt::format("warning: of {} point{}: {} (first at {}){}", points, points == 1 ? "" : "s", text, first_,
                     unusable_ ? "; the results of fatal and retry points are nan" : ""));
  }

 private:
  std::array<std::size_t, CLEAVE_STATUS_FATAL + 1> counts_{};
  std::string first_;
  bool unusable_ = false;
};

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const auto& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

/// Where the quantities of a point stand in a table.
struct InputColumns {
  std::vector<std::size_t> deformation;
  std::optional<std::size_t> damage, time;  ///< d; dt, where a damage law evolves in time
  std::vector<std::optional<std::size_t>> variables;

  InputColumns(const point::CsvTable& table, const point::Laws& laws) {
    std::vector<std::string> missing;
    for (const auto& name : point::matrix_columns("F")) {
      const auto column = table.column(name);
      if (column)
        deformation.push_back(*column);
      else
        missing.push_back(name);
    }
    if (!missing.empty())
      throw InputError(fmt::format("{}:{}: error: column{} {} {} missing; a point needs F00 to F22 (row-major). There are: {}",
                                   table.file(), table.header().line, missing.size() == 1 ? "" : "s", joined(missing),
                                   missing.size() == 1 ? "is" : "are", joined(table.names())));
    damage = table.column("d");
    if (laws.damage && !laws.damage_is_local) time = table.column("dt");
    for (const auto& name : point::variable_columns(laws)) variables.push_back(table.column(name));
  }

  double seconds(const point::CsvTable& table, const point::CsvTable::Row& row) const {
    const double dt = table.number(row, *time);
    if (!(dt >= 0)) throw InputError(table.error_at(row, *time, fmt::format("dt must be a time of at least 0 s, is {}", dt)));
    return dt;
  }

  point::State read(const point::CsvTable& table, const point::CsvTable::Row& row, const std::vector<double>& initial) const {
    point::State state;
    for (int i = 0; i < 9; ++i) state.deformation(i / 3, i % 3) = table.number(row, deformation[std::size_t(i)]);
    if (damage) {
      const double d = table.number(row, *damage);
      if (d < 0 || d > 1) throw InputError(table.error_at(row, *damage, fmt::format("d must be in [0, 1], is {}", d)));
      state.damage = state.degrading_damage = d;
    }
    state.variables = initial;
    for (std::size_t i = 0; i < variables.size(); ++i)
      if (variables[i]) state.variables[i] = table.number(row, *variables[i]);
    return state;
  }
};

/// The header of the input, with "_in" behind the names of columns that are written as results.
std::string header_of(const point::CsvTable& table, const std::vector<std::string>& results) {
  std::set<std::string> taken(results.begin(), results.end());
  taken.insert(table.names().begin(), table.names().end());
  const auto is_result = [&](const std::string& name) {
    return std::find(results.begin(), results.end(), name) != results.end();
  };
  std::string header;
  std::vector<std::string> renamed;
  for (std::size_t i = 0; i < table.names().size(); ++i) {
    std::string name(table.header().cells[i]);
    if (is_result(table.names()[i])) {
      name = table.names()[i];
      while (taken.contains(name)) name += "_in";
      taken.insert(name);
      renamed.push_back(table.names()[i]);
    }
    header += (i == 0 ? "" : ",") + name;
  }
  if (!renamed.empty())
    warn(fmt::format("{}: warning: column{} {} {} also a result; written as ..._in", table.file(),
                     renamed.size() == 1 ? "" : "s", joined(renamed), renamed.size() == 1 ? "is" : "are"));
  return header;
}

int evaluate_points(const PointOptions& options, const point::Laws& laws) {
  const auto table = point::CsvTable::read(*options.input);
  const InputColumns columns(table, laws);
  const auto initial = point::initial_variables(laws);
  const point::ResponseColumns results(laws, columns.time.has_value());
  const auto evaluator = point::make_evaluator(laws);

  std::string text = header_of(table, results.names());
  for (const auto& name : results.names()) text += "," + name;
  text += '\n';
  Tally tally;
  std::vector<point::State> states;
  std::vector<point::Response> responses(point::Evaluator::batch_size);
  const auto& rows = table.rows();
  for (std::size_t first = 0; first < rows.size(); first += states.size()) {
    states.clear();
    for (std::size_t i = first; i < std::min(rows.size(), first + point::Evaluator::batch_size); ++i)
      states.push_back(columns.read(table, rows[i], initial));
    evaluator->evaluate(states, std::span(responses).first(states.size()));
    for (std::size_t k = 0; k < states.size(); ++k) {
      const auto& row = rows[first + k];
      if (columns.time)
        responses[k].damage = laws.damage_after(columns.seconds(table, row), states[k].damage, responses[k].driving_force);
      for (std::size_t i = 0; i < row.cells.size(); ++i) text.append(i == 0 ? "" : ",").append(row.cells[i]);
      results.append(text, responses[k]);
      text += '\n';
      tally.add(responses[k].status, table.file() + ":" + std::to_string(row.line));
    }
  }
  write(options.output, text);
  tally.report(rows.size());
  return 0;
}

point::LoadPath read_path(const PointOptions& options) {
  const auto& names = point::path_names();
  const auto known = std::find(names.begin(), names.end(), *options.path);
  if (known == names.end()) {
    const auto near = nearest(*options.path, names);
    refuse("--path " + *options.path,
           near ? "no such path, did you mean '" + *near + "'?" : "no such path; there are: " + joined(names));
  }
  point::LoadPath path;
  path.kind = point::PathKind(known - names.begin());
  if (!options.amplitude)
    refuse("--path " + *options.path, "needs --amplitude, the engineering strain at its end (gamma in simple shear)");
  if (!std::isfinite(*options.amplitude)) refuse("--amplitude", "must be finite");
  path.amplitude = *options.amplitude;
  if (options.steps) path.steps = *options.steps;
  if (path.steps < 1) refuse("--steps", "must be at least 1, is " + std::to_string(path.steps));
  const bool triaxial = path.kind == point::PathKind::triaxial;
  if (triaxial && !options.confinement) refuse("--path triaxial", "needs --confinement, the pressure in Pa");
  if (!triaxial && options.confinement) refuse("--confinement", "belongs to --path triaxial");
  if (triaxial) path.confinement = *options.confinement;
  if (!(path.confinement >= 0) || !std::isfinite(path.confinement))
    refuse("--confinement", "must be a pressure of at least 0 Pa, is " + fmt::format("{}", path.confinement));
  return path;
}

int follow_path(const PointOptions& options, const point::LoadPath& path, const point::Laws& laws) {
  const point::ResponseColumns results(laws);
  std::string text = "step";
  for (const auto& name : point::matrix_columns("F")) text += "," + name;
  text += ",d";
  for (const auto& name : results.names()) text += "," + name;
  text += '\n';

  Tally tally;
  int last = 0;
  const auto evaluator = point::make_evaluator(laws);
  const bool complete = point::drive(laws, *evaluator, path, [&](const point::PathPoint& at) {
    text += std::to_string(at.step);
    for (int i = 0; i < 9; ++i) results.append(text, at.deformation(i / 3, i % 3));
    results.append(text, at.damage);
    results.append(text, at.response);
    text += '\n';
    tally.add(at.response.status, "step " + std::to_string(at.step));
    last = at.step;
  });
  write(options.output, text);
  tally.report(std::size_t(last) + 1);
  if (complete) return 0;
  warn(fmt::format("error: the path ended at step {} of {}: no usable state was found there", last, path.steps));
  return 3;
}

int replay_batch(const PointOptions& options, plugins::Registry& registry) {
  if (!options.laws.elasticity.empty() || options.laws.plasticity || options.laws.damage || !options.laws.sets.empty())
    refuse("--replay", "brings its own laws; leave out --elasticity, --plasticity, --damage and --set");
  const point::Replay replay = point::replay(*options.replay, registry);
  write(options.output, replay.table);
  for (const auto& warning : replay.warnings) warn(warning);
  warn(replay.summary);
  return replay.fails ? 3 : 0;
}

}  // namespace

void add_point_options(CLI::App& cli, PointOptions& options) {
  cli.add_option("--elasticity", options.laws.elasticity, "Elasticity law, for example split-neo-hookean");
  cli.add_option("--plasticity", options.laws.plasticity, "Return mapping that is applied first");
  cli.add_option("--damage", options.laws.damage, "Damage law; its residual enters the degradation by d");
  cli.add_option("--set", options.laws.sets, "Parameter of a law: elasticity.youngs_modulus=1000 (repeatable)");
  cli.add_option("--fiber", options.laws.fiber, "First fiber direction x,y,z in the reference frame");
  cli.add_option("--fiber2", options.laws.second_fiber, "Second one, orthogonal to the first (default: completes the frame)");
  cli.add_option("--precision", options.laws.precision, "Precision of the laws: double or single")->capture_default_str();
  cli.add_option("--cell-size", options.laws.cell_size, "Cell size in m, for laws with lengths given in cells");
  cli.add_option("--input", options.input, "CSV with columns F00..F22 and optionally d and state variables; - is stdin");
  cli.add_option("--path", options.path, "Drive one point instead: " + joined(point::path_names()));
  cli.add_option("--amplitude", options.amplitude, "Strain at the end of the path: stretch - 1 along axis 0, or gamma");
  cli.add_option("--steps", options.steps, "Increments of the path (default: 100)");
  cli.add_option("--confinement", options.confinement, "Pressure in Pa around a triaxial path");
  cli.add_flag("--json", options.json, "Answer points in JSON, a line each, from the standard input to the standard output");
  cli.add_option("--replay", options.replay, "Call a law again with the points it failed on: failed_batch.json of a run");
  cli.add_option("--output", options.output, "CSV to write (default: standard output)");
}

int point_command(const PointOptions& options, plugins::Registry& registry) {
  std::vector<const char*> tasks;
  if (options.input) tasks.push_back("--input");
  if (options.path) tasks.push_back("--path");
  if (options.json) tasks.push_back("--json");
  if (options.replay) tasks.push_back("--replay");
  if (tasks.empty()) throw InputError("error: give --input FILE.csv, --path NAME, --json or --replay FILE");
  if (tasks.size() > 1) refuse(tasks[1], std::string("cannot be given together with ") + tasks[0]);
  if (!options.path && (options.amplitude || options.steps || options.confinement))
    refuse(options.amplitude ? "--amplitude" : options.steps ? "--steps" : "--confinement", "belongs to --path");
  if (options.json && options.output != "-")
    refuse("--output", "does not go with --json, which answers on the standard output");
  if (options.replay) return replay_batch(options, registry);
  std::optional<point::LoadPath> path;
  if (options.path) path = read_path(options);

  std::vector<std::string> warnings;
  const point::Laws laws = point::make_laws(options.laws, registry, warnings);
  for (const auto& warning : warnings) warn(warning);
  if (options.json) {
    point::serve_json(laws, std::cin, std::cout);
    return 0;
  }
  return path ? follow_path(options, *path, laws) : evaluate_points(options, laws);
}

}  // namespace cleave::app
