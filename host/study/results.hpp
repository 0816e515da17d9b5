#pragma once

#include "study/plan.hpp"
#include "study/record.hpp"
#include "study/stability.hpp"

#include <optional>
#include <set>
#include <string>
#include <vector>

namespace cleave::study {

/// A point of a study with what came of it.
struct Row {
  std::size_t point = 0;         ///< index into Plan::points
  std::optional<Record> record;  ///< empty: not run
  Judgement judgement;           ///< of a stability map; else stable stands for done
  std::optional<double> error;   ///< of a run that is done, unless it is its own reference
  bool is_reference = false;
  bool on_front = false;
};

/// Points that one line of the chart joins.
struct Series {
  std::string label;
  std::vector<std::size_t> rows;  ///< along the axis of the chart
  double order = 0;               ///< slope of the error between the two smallest values of that axis; NaN: none
};

struct Column {
  std::size_t value;  ///< of the first axis
  Boundary boundary;
};

struct Results {
  std::vector<Row> rows;  ///< of the points, in their order
  std::vector<Series> series;
  std::vector<Column> columns;     ///< of a stability map
  std::set<std::string> machines;  ///< that anything was measured on
  std::vector<std::string> remarks;
};

/// What costs are, in the unit of cost_title().
double cost_of(const Study&, const Record&);
std::string cost_title(const Study&);  ///< "wall time of the steps (s)"
std::string error_title(const Study&);

/// Everything that is known of a study's runs. Throws InputError where the measure of the study does not fit what runs write.
Results collect(const Study&, const Plan&, const std::filesystem::path& out);

std::string results_csv(const Study&, const Plan&, const Results&);
std::string results_json(const Study&, const Plan&, const Results&, const std::filesystem::path& out);
/// For a terminal: a line for each point.
std::string results_text(const Study&, const Plan&, const Results&);

/// A picture as gnuplot draws it, without the line that says of what kind.
struct Chart {
  std::string name;  ///< "speed_accuracy"
  std::string script;
};
std::vector<Chart> charts(const Study&, const Plan&, const Results&);

/// One page that needs nothing else: description, charts as SVG, tables, machine, commands.
std::string report_html(const Study&, const Plan&, const Results&, const std::vector<std::pair<Chart, std::string>>& drawn,
                        const std::filesystem::path& out);

}  // namespace cleave::study
