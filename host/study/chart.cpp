#include "bench/gnuplot.hpp"
#include "study/results.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace cleave::study {
namespace {

using bench::gnuplot_text;

/// Colours that people who see few of them tell apart (Okabe & Ito 2008), and shapes.
constexpr const char* colors[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#7f7f7f"};
constexpr int shapes[] = {7, 5, 9, 13, 11, 6, 4, 8};

std::string axis_title(const Axis& axis) {
  return axis.unit.empty() ? axis.name : fmt::format("{} ({})", axis.name, axis.unit);
}

/// Room around numbers on an axis.
struct Extent {
  double least = std::numeric_limits<double>::infinity(), most = -std::numeric_limits<double>::infinity();

  void add(double x) {
    least = std::min(least, x);
    most = std::max(most, x);
  }
  bool positive() const { return least > 0; }
  bool empty() const { return !(least <= most); }
  std::string range(bool logarithmic, double room = 0.08) const {
    if (logarithmic) {
      const double factor = std::max(1.25, std::pow(most / least, room));
      return fmt::format("[{}:{}]", least / factor, most * factor);
    }
    const double margin = most > least ? room * (most - least) : std::max(0.1 * std::abs(most), 1e-12);
    return fmt::format("[{}:{}]", least - margin, most + margin);
  }
};

std::string common(const std::string& title, const std::string& subtitle) {
  return fmt::format(
      "set border 3 lc '#444444'\nset tics nomirror\nset grid lc '#dddddd' lw 1\nset title {}\n"
      "set key outside right top Left reverse width 1 spacing 1.25\n",
      gnuplot_text(title) + (subtitle.empty() ? "" : R"(."\n".)" + gnuplot_text(subtitle)));
}

/// Logarithmic axes have a tick at each power of ten, or further numbers where there are few of these.
std::string logarithmic(const char* axis, const Extent& extent) {
  std::string text = fmt::format("set logscale {0}\nset format {0} '%g'\n", axis);
  if (extent.most / extent.least > 50) return text;
  std::string ticks;
  for (double power = std::pow(10, std::floor(std::log10(extent.least)) - 1); power <= 10 * extent.most; power *= 10)
    for (const double digit : {1., 2., 5.}) ticks += fmt::format("{}{:g}", ticks.empty() ? "" : ",", digit * power);
  return text + fmt::format("set {}tics ({})\n", axis, ticks);
}

std::string left_out(const Results& results) {
  std::map<std::string, int> counts;
  int zero = 0;
  for (const Row& row : results.rows) {
    if (!row.record)
      counts["not run"]++;
    else if (row.record->outcome != Outcome::done)
      counts[word_of(row.record->outcome)]++;
    else if (row.error && !(*row.error > 0))
      zero++;
  }
  std::string text;
  for (const auto& [word, count] : counts) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, word);
  if (zero > 0) text += fmt::format("{}{} without any error", text.empty() ? "" : ", ", zero);
  return text.empty() ? "" : "not drawn: " + text;
}

struct Place {
  double x, y;
  std::string label;
};

/// A line for each series. `abscissa` of a row; NaN leaves it out.
template <class Abscissa>
std::string lines_of(const Study& study, const Plan& plan, const Results& results, const Abscissa& abscissa, bool labels,
                     std::string& data, Extent& xs, Extent& ys) {
  std::string plots;
  int number = 0;
  for (const Series& series : results.series) {
    std::vector<Place> places;
    for (const std::size_t i : series.rows) {
      const Row& row = results.rows[i];
      if (!row.error || !(*row.error > 0) || !std::isfinite(*row.error)) continue;
      const double x = abscissa(row);
      if (!(x > 0)) continue;
      const std::string label =
          study.along ? study.axes[*study.along].values[plan.points[row.point].at[*study.along]].label : "";
      places.push_back({x, *row.error, label});
      xs.add(x);
      ys.add(*row.error);
    }
    if (places.empty()) continue;
    const std::string block = fmt::format("$series{}", ++number);
    data += block + " << END\n";
    for (const Place& p : places) data += fmt::format("{} {} {}\n", p.x, p.y, gnuplot_text(p.label));
    data += "END\n";
    const std::size_t color = std::size_t(number - 1) % std::size(colors);
    // the second time round the colours have other shapes and broken lines
    const std::size_t turn = std::size_t(number - 1) / std::size(colors);
    plots += fmt::format(", {} using 1:2 with linespoints lc rgb '{}' lw 1.6 dt {} pt {} ps 0.9 title {}", block, colors[color],
                         turn % 5 + 1, shapes[(color + 3 * turn) % std::size(shapes)], gnuplot_text(series.label));
    if (labels && places.size() > 1)
      plots += fmt::format(", {} using 1:2:3 with labels offset character 0,{} tc rgb '{}' font ',9' notitle", block,
                           number % 2 == 1 ? -0.9 : 0.9, colors[color]);
  }
  return plots;
}

Chart speed_accuracy(const Study& study, const Plan& plan, const Results& results) {
  std::string data;
  Extent xs, ys;
  std::string plots = lines_of(
      study, plan, results, [&](const Row& row) { return cost_of(study, *row.record); }, true, data, xs, ys);
  if (plots.empty()) return {};
  std::vector<std::pair<double, double>> front;
  for (const Row& row : results.rows)
    if (row.on_front && *row.error > 0) front.emplace_back(cost_of(study, *row.record), *row.error);
  std::sort(front.begin(), front.end());
  data += "$front << END\n";
  for (std::size_t i = 0; i < front.size(); ++i) data += fmt::format("{} {}\n", front[i].first, front[i].second);
  data += "END\n";
  std::string script = common(study.title, left_out(results));
  if (study.along)
    script +=
        fmt::format("set key title {} left\n", gnuplot_text("numbers at points: " + axis_title(study.axes[*study.along])));
  script += fmt::format("set xlabel {}\nset ylabel {}\n", gnuplot_text(cost_title(study)), gnuplot_text(error_title(study)));
  script += logarithmic("x", xs) + logarithmic("y", ys);
  script += fmt::format("set xrange {}\nset yrange {}\n", xs.range(true), ys.range(true));
  return {"speed_accuracy",
          data + script + "plot $front using 1:2 with steps lc rgb '#bbbbbb' lw 6 title 'Pareto front'" + plots +
              ", $front using 1:2 with points pt 6 ps 2 lw 1.8 lc rgb '#444444' title 'points of the front'\n"};
}

Chart convergence(const Study& study, const Plan& plan, const Results& results) {
  const std::size_t along = *study.along;
  const Axis& axis = study.axes[along];
  std::string data;
  Extent xs, ys;
  const std::string plots = lines_of(
      study, plan, results, [&](const Row& row) { return *axis.values[plan.points[row.point].at[along]].number; }, false, data,
      xs, ys);
  if (plots.empty() || !(xs.most > xs.least)) return {};
  std::string script = common(study.title, left_out(results));
  script += fmt::format("set xlabel {}\nset ylabel {}\n", gnuplot_text(axis_title(axis)), gnuplot_text(error_title(study)));
  if (axis.logarithmic()) script += logarithmic("x", xs);
  script += logarithmic("y", ys);
  script += fmt::format("set xrange {}\nset yrange {}\n", xs.range(axis.logarithmic()), ys.range(true));
  return {"convergence", data + script + "plot " + plots.substr(2) + "\n"};
}

// ---------------------------------------------------------------- maps

double place_on(const Axis& axis, std::size_t value) { return axis.numeric() ? *axis.values[value].number : double(value); }

std::string map_axis(const char* name, const Axis& axis, const Extent& extent) {
  std::string text = fmt::format("set {}label {}\n", name, gnuplot_text(axis_title(axis)));
  if (!axis.numeric()) {
    text += fmt::format("set {}tics (", name);
    for (std::size_t i = 0; i < axis.values.size(); ++i)
      text += fmt::format("{}{} {}", i > 0 ? ", " : "", gnuplot_text(axis.values[i].label), i);
    return text + fmt::format(")\nset {}range [-0.5:{}]\n", name, double(axis.values.size()) - 0.5);
  }
  if (axis.logarithmic()) text += logarithmic(name, extent);
  return text + fmt::format("set {}range {}\n", name, extent.range(axis.logarithmic()));
}

Chart stability_map(const Study& study, const Plan& plan, const Results& results) {
  struct Style {
    State state;
    const char* color;
    int shape;
  };
  constexpr Style styles[] = {{State::stable, "#009e73", 5}, {State::degraded, "#e69f00", 9},  {State::refused, "#0072b2", 13},
                              {State::failed, "#d55e00", 2}, {State::timed_out, "#7f3f98", 7}, {State::missing, "#aaaaaa", 6}};
  const Axis &first = study.axes[0], &second = study.axes[1];
  std::string data, plots;
  Extent xs, ys;
  for (const Style& style : styles) {
    std::string points;
    int count = 0;
    for (const Row& row : results.rows) {
      if (row.judgement.state != style.state) continue;
      const auto& at = plan.points[row.point].at;
      points += fmt::format("{} {}\n", place_on(first, at[0]), place_on(second, at[1]));
      xs.add(place_on(first, at[0]));
      ys.add(place_on(second, at[1]));
      ++count;
    }
    if (count == 0) continue;
    data += fmt::format("$state{} << END\n{}END\n", int(style.state), points);
    plots += fmt::format("{}$state{} using 1:2 with points pt {} ps 1.7 lw 2 lc rgb '{}' title {}", plots.empty() ? "" : ", ",
                         int(style.state), style.shape, style.color,
                         gnuplot_text(fmt::format("{} ({})", word_of(style.state), count)));
  }
  std::string bound;
  for (const Column& column : results.columns) {
    if (!column.boundary.predicted) continue;
    bound += fmt::format("{} {}\n", place_on(first, column.value), *column.boundary.predicted);
    ys.add(*column.boundary.predicted);
  }
  if (!bound.empty()) {
    data += "$bound << END\n" + bound + "END\n";
    plots += fmt::format(", $bound using 1:2 with linespoints lc rgb '#000000' lw 2 pt 1 ps 0.8 title {}",
                         gnuplot_text(study.map->bound_title));
  }
  return {"map",
          data + common(study.title, "") + map_axis("x", first, xs) + map_axis("y", second, ys) + "plot " + plots + "\n"};
}

}  // namespace

std::vector<Chart> charts(const Study& study, const Plan& plan, const Results& results) {
  std::vector<Chart> drawn;
  if (study.map) drawn.push_back(stability_map(study, plan, results));
  if (study.error) {
    drawn.push_back(speed_accuracy(study, plan, results));
    if (study.along) drawn.push_back(convergence(study, plan, results));
  }
  std::erase_if(drawn, [](const Chart& chart) { return chart.script.empty(); });
  return drawn;
}

}  // namespace cleave::study
