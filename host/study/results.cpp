#include "study/results.hpp"

#include "common/error.hpp"
#include "output/number.hpp"
#include "study/execute.hpp"
#include "study/expression.hpp"
#include "study/measure.hpp"
#include "study/pareto.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

namespace cleave::study {
namespace {

namespace fs = std::filesystem;

fs::path results_of(const fs::path& out, const Plan& plan, std::size_t run) {
  return directory_of(out, plan.runs[run]) / "run";
}

void measure(const Study& study, const Plan& plan, const fs::path& out, Results& results,
             const std::vector<std::optional<Record>>& records) {
  std::set<std::string> incomparable;
  for (Row& row : results.rows) {
    const Point& point = plan.points[row.point];
    if (!row.record || row.record->outcome != Outcome::done) continue;
    std::optional<fs::path> reference;
    if (point.reference) {
      row.is_reference = *point.reference == point.run;
      const auto& theirs = records[*point.reference];
      if (!row.is_reference && (!theirs || theirs->outcome != Outcome::done)) {
        incomparable.insert(fmt::format("the {} is {}, so that points have no error", plan.runs[*point.reference].what,
                                        theirs ? word_of(theirs->outcome) : "not run"));
        continue;
      }
      reference = results_of(out, plan, *point.reference);
    }
    if (row.is_reference) continue;
    row.error =
        measure_error(study, constants_of(study, numbers_at(study, point.at)), results_of(out, plan, point.run), reference);
  }
  results.remarks.insert(results.remarks.end(), incomparable.begin(), incomparable.end());
}

void find_front(const Study& study, Results& results) {
  std::vector<double> costs, errors;
  for (const Row& row : results.rows) {
    costs.push_back(row.error ? cost_of(study, *row.record) : std::numeric_limits<double>::quiet_NaN());
    errors.push_back(row.error.value_or(std::numeric_limits<double>::quiet_NaN()));
  }
  for (const std::size_t i : pareto_front(costs, errors)) results.rows[i].on_front = true;
}

bool is_number(const std::string& text) {
  double value;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  return problem == std::errc() && end == text.data() + text.size();
}

/// One for each combination of values of all axes but the one that lines follow.
void find_series(const Study& study, const Plan& plan, Results& results) {
  std::map<std::vector<std::size_t>, std::size_t> index;
  for (std::size_t i = 0; i < results.rows.size(); ++i) {
    auto at = plan.points[results.rows[i].point].at;
    std::string label;
    for (std::size_t a = 0; a < at.size(); ++a) {
      if (study.along == a) continue;
      const Axis& axis = study.axes[a];
      const std::string& value = axis.values[at[a]].label;
      label += (label.empty() ? "" : ", ") +
               (is_number(value) ? fmt::format("{} {}{}{}", axis.name, value, axis.unit.empty() ? "" : " ", axis.unit) : value);
    }
    if (study.along) at[*study.along] = 0;
    const auto [entry, is_new] = index.emplace(at, results.series.size());
    if (is_new) results.series.push_back({label.empty() ? "points" : label, {}, 0});
    results.series[entry->second].rows.push_back(i);
  }
  for (Series& series : results.series) {
    std::vector<double> x, y;
    for (const std::size_t i : series.rows)
      if (study.along && results.rows[i].error) {
        x.push_back(*study.axes[*study.along].values[plan.points[results.rows[i].point].at[*study.along]].number);
        y.push_back(*results.rows[i].error);
      }
    series.order = observed_order(x, y);
  }
}

void find_boundaries(const Study& study, const Plan& plan, const fs::path& out, Results& results,
                     const std::vector<std::optional<Record>>& records) {
  const Axis &first = study.axes[0], &second = study.axes[1];
  if (!second.numeric()) return;
  for (std::size_t i = 0; i < first.values.size(); ++i) {
    std::vector<std::pair<double, State>> column;
    std::vector<double> numbers;
    for (const Row& row : results.rows) {
      const auto& at = plan.points[row.point].at;
      if (at[0] != i) continue;
      column.emplace_back(*second.values[at[1]].number, row.judgement.state);
      numbers = numbers_at(study, at);
    }
    std::sort(column.begin(), column.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::optional<double> predicted;
    if (study.map->bound && !study.map->bound_of_runs) {
      const auto constants = constants_of(study, numbers);
      predicted = Expression(*study.map->bound, study.names())(constants);
    } else if (study.map->bound) {
      const std::size_t run = plan.bound_runs[i];
      if (records[run] && records[run]->outcome == Outcome::done)
        predicted = reported_bound(study, constants_of(study, numbers), results_of(out, plan, run));
      else
        results.remarks.push_back(
            fmt::format("{} is {}", plan.runs[run].what, records[run] ? word_of(records[run]->outcome) : "not run"));
    }
    if (predicted && !(std::isfinite(*predicted) && *predicted > 0)) predicted.reset();
    std::vector<double> values;
    std::vector<State> states;
    for (const auto& [value, state] : column) {
      values.push_back(value);
      states.push_back(state);
    }
    results.columns.push_back({i, boundary_of(values, states, predicted)});
  }
}

State state_of(const std::optional<Record>& record) {
  if (!record) return State::missing;
  constexpr State states[] = {State::stable, State::refused, State::failed, State::timed_out};
  return states[int(record->outcome)];
}

std::string outcome_word(const Study& study, const Row& row) {
  if (!row.record) return "not run";
  return study.stability ? word_of(row.judgement.state) : word_of(row.record->outcome);
}

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string cell = "\"";
  for (const char c : text) {
    if (c == '\n' || c == '\r') {
      cell += ' ';
    } else {
      if (c == '"') cell += '"';
      cell += c;
    }
  }
  return cell + '"';
}

}  // namespace

double cost_of(const Study& study, const Record& record) {
  switch (study.cost) {
    case Cost::wall:
      return record.wall();
    case Cost::particle_steps:
      return record.particle_steps();
    case Cost::memory:
      return record.peak_memory / 1048576;
    case Cost::instructions:
      return record.instructions.value_or(std::numeric_limits<double>::quiet_NaN());
  }
  return 0;
}

std::string cost_title(const Study& study) {
  constexpr const char* titles[] = {"wall time of the steps (s)", "particles times steps", "peak memory (MiB)",
                                    "instructions of the run"};
  return titles[int(study.cost)];
}

std::string error_title(const Study& study) {
  const ErrorMeasure& error = *study.error;
  constexpr const char* norms[] = {"L2 norm", "largest", "at the end"};
  return fmt::format("{} ({}, {})", error.title, norms[int(error.norm)],
                     error.relative       ? "relative"
                     : error.unit.empty() ? "absolute"
                                          : error.unit);
}

Results collect(const Study& study, const Plan& plan, const fs::path& out) {
  Results results;
  std::vector<std::optional<Record>> records;
  for (const Run& run : plan.runs) {
    records.push_back(read_record(record_of(out, run)));
    if (records.back() && !records.back()->machine.empty()) results.machines.insert(records.back()->machine);
  }
  std::size_t missing = 0;
  for (std::size_t i = 0; i < plan.points.size(); ++i) {
    Row row;
    row.point = i;
    row.record = records[plan.points[i].run];
    row.judgement.state = state_of(row.record);
    missing += !row.record;
    if (row.record && study.map)
      row.judgement = judge_stability(study, constants_of(study, numbers_at(study, plan.points[i].at)), *row.record,
                                      results_of(out, plan, plan.points[i].run));
    results.rows.push_back(std::move(row));
  }
  if (missing > 0) results.remarks.push_back(fmt::format("{} of {} points are not run", missing, plan.points.size()));
  if (study.instructions)
    for (const auto& record : records)
      if (record && record->outcome == Outcome::done) {
        results.remarks.push_back(record->instructions ? "instructions of whole runs, with start and output, counted by " +
                                                             record->instructions_by
                                                       : "instructions are " + record->instructions_by);
        break;
      }
  if (results.machines.size() > 1) results.remarks.push_back("times are of different machines");
  if (study.error) {
    measure(study, plan, out, results, records);
    find_front(study, results);
    find_series(study, plan, results);
  }
  if (study.map) find_boundaries(study, plan, out, results, records);
  return results;
}

std::string results_csv(const Study& study, const Plan& plan, const Results& results) {
  std::string text = "point";
  for (const Axis& axis : study.axes)
    text += "," + csv_cell(axis.unit.empty() ? axis.name : axis.name + " (" + axis.unit + ")");
  text +=
      ",outcome,error,wall_seconds,wall_seconds_least,wall_seconds_most,repetitions,particles,steps,particle_steps_per_second,"
      "peak_memory_bytes,instructions,pareto,reason\n";
  for (const Row& row : results.rows) {
    const Point& point = plan.points[row.point];
    text += std::to_string(row.point + 1);
    for (std::size_t a = 0; a < point.at.size(); ++a) text += "," + csv_cell(study.axes[a].values[point.at[a]].label);
    text += "," + outcome_word(study, row) + "," +
            (row.is_reference ? std::string("reference")
             : row.error      ? output::number(*row.error)
                              : "");
    const Record record = row.record.value_or(Record{});
    const bool timed = !record.wall_seconds.empty();
    const auto [least, most] = std::minmax_element(record.wall_seconds.begin(), record.wall_seconds.end());
    text += timed ? fmt::format(",{:.4g},{:.4g},{:.4g},{}", record.wall(), *least, *most, record.wall_seconds.size()) : ",,,,0";
    text +=
        fmt::format(",{},{},{},{},{},{},{}\n", record.particles, record.steps,
                    timed && record.wall() > 0 ? fmt::format("{:.4g}", record.particle_steps() / record.wall()) : "",
                    output::number(record.peak_memory), record.instructions ? fmt::format("{:.0f}", *record.instructions) : "",
                    int(row.on_front), csv_cell(row.judgement.reason.empty() ? record.reason : row.judgement.reason));
  }
  return text;
}

std::string results_json(const Study& study, const Plan& plan, const Results& results, const fs::path& out) {
  using nlohmann::ordered_json;
  ordered_json json{{"format", "cleave study 1"},   {"title", study.title},
                    {"study", study.file.string()}, {"kind", study.stability ? "stability" : "accuracy"},
                    {"version", CLEAVE_VERSION},    {"machines", results.machines},
                    {"threads", study.threads},     {"remarks", results.remarks}};
  if (study.error) {
    json["error"] = error_title(study);
    json["cost"] = cost_title(study);
  }
  json["points"] = ordered_json::array();
  for (const Row& row : results.rows) {
    const Point& point = plan.points[row.point];
    ordered_json entry{{"point", row.point + 1}, {"at", ordered_json::object()}, {"outcome", outcome_word(study, row)}};
    for (std::size_t a = 0; a < point.at.size(); ++a) {
      const AxisValue& value = study.axes[a].values[point.at[a]];
      entry["at"][study.axes[a].name] = value.number ? ordered_json(*value.number) : ordered_json(value.label);
    }
    if (!row.judgement.reason.empty() || (row.record && !row.record->reason.empty()))
      entry["reason"] = row.judgement.reason.empty() ? row.record->reason : row.judgement.reason;
    if (study.error) {
      entry["error"] = row.error ? ordered_json(*row.error) : ordered_json(nullptr);
      entry["pareto"] = row.on_front;
      entry["reference"] = row.is_reference;
    }
    if (row.record) {
      entry["wall_seconds"] = row.record->wall_seconds;
      entry["particles"] = row.record->particles;
      entry["steps"] = row.record->steps;
      entry["peak_memory_bytes"] = row.record->peak_memory;
      entry["instructions"] = row.record->instructions ? ordered_json(*row.record->instructions) : ordered_json(nullptr);
    }
    entry["command"] = command_of(study, out, plan.runs[point.run]);
    json["points"].push_back(std::move(entry));
  }
  if (study.error && study.along) {
    json["orders"] = ordered_json::object();
    for (const Series& series : results.series)
      json["orders"][series.label] = std::isfinite(series.order) ? ordered_json(series.order) : ordered_json(nullptr);
  }
  if (study.map) {
    json["boundaries"] = ordered_json::array();
    const auto number = [](const std::optional<double>& x) { return x ? ordered_json(*x) : ordered_json(nullptr); };
    for (const Column& column : results.columns)
      json["boundaries"].push_back({{study.axes[0].name, study.axes[0].values[column.value].label},
                                    {"predicted", number(column.boundary.predicted)},
                                    {"largest_stable", number(column.boundary.stable)},
                                    {"smallest_unstable", number(column.boundary.unstable)},
                                    {"ratio_at_least", number(column.boundary.low)},
                                    {"ratio_below", number(column.boundary.high)},
                                    {"verdict", column.boundary.verdict}});
  }
  return json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

std::string results_text(const Study& study, const Plan& plan, const Results& results) {
  std::vector<std::vector<std::string>> rows{{"point"}};
  for (const Axis& axis : study.axes) rows[0].push_back(axis.unit.empty() ? axis.name : axis.name + " (" + axis.unit + ")");
  rows[0].insert(rows[0].end(), {"outcome", "wall s", "MiB"});
  if (study.error) rows[0].push_back("error");
  for (const Row& row : results.rows) {
    const Point& point = plan.points[row.point];
    rows.push_back({std::to_string(row.point + 1)});
    auto& cells = rows.back();
    for (std::size_t a = 0; a < point.at.size(); ++a) cells.push_back(study.axes[a].values[point.at[a]].label);
    cells.push_back(outcome_word(study, row));
    const Record record = row.record.value_or(Record{});
    cells.push_back(record.wall_seconds.empty() ? "" : fmt::format("{:.3g}", record.wall()));
    cells.push_back(record.peak_memory > 0 ? fmt::format("{:.0f}", record.peak_memory / 1048576) : "");
    if (study.error)
      cells.push_back(row.is_reference ? "reference"
                      : row.error      ? fmt::format("{:.3e}{}", *row.error, row.on_front ? " *" : "")
                                       : "");
  }
  std::vector<std::size_t> widths(rows[0].size(), 0);
  for (const auto& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  std::string text;
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size(); ++i) line += fmt::format("{:<{}}  ", row[i], widths[i]);
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  }
  if (study.error) text += "* on the Pareto front: no other point costs less and is as accurate, within 1 %\n";
  for (const Column& column : results.columns) {
    const Boundary& b = column.boundary;
    const auto number = [](const std::optional<double>& x) { return x ? fmt::format("{:.3g}", *x) : std::string("-"); };
    text += fmt::format("{} {}: stable to {}, not at {}; predicted {}, ratio {} to {}: {}\n", study.axes[0].name,
                        study.axes[0].values[column.value].label, number(b.stable), number(b.unstable), number(b.predicted),
                        number(b.low), number(b.high), b.verdict);
  }
  for (const std::string& remark : results.remarks) text += remark + "\n";
  return text;
}

}  // namespace cleave::study
