#include "study/execute.hpp"
#include "study/results.hpp"

#include <fmt/format.h>

#include <cmath>

namespace cleave::study {
namespace {

std::string escaped(const std::string& text) {
  std::string html;
  for (const char c : text) {
    if (c == '&')
      html += "&amp;";
    else if (c == '<')
      html += "&lt;";
    else if (c == '>')
      html += "&gt;";
    else if (c == '"')
      html += "&quot;";
    else
      html += c;
  }
  return html;
}

constexpr const char* style = R"(
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1080px; margin: 2em auto; padding: 0 1em; color: #222 }
h1 { font-size: 1.6em } h2 { font-size: 1.2em; margin-top: 2em }
table { border-collapse: collapse; font-size: 13px } td, th { padding: .25em .7em; border-bottom: 1px solid #ddd; text-align: left }
td.number { text-align: right; font-variant-numeric: tabular-nums } tr.front td { font-weight: 600 }
figure { margin: 1em 0 } figure svg { width: 100%; height: auto } code, pre { font-size: 12px } pre { overflow-x: auto; background: #f5f5f5; padding: .8em }
)";

std::string paragraphs(const std::string& text) {
  std::string html;
  std::size_t at = 0;
  while (at < text.size()) {
    const auto end = std::min(text.find("\n\n", at), text.size());
    html += "<p>" + escaped(text.substr(at, end - at)) + "</p>\n";
    at = end + 2;
  }
  return html;
}

std::string number_cell(const std::string& text) { return "<td class=number>" + escaped(text) + "</td>"; }

std::string table(const Study& study, const Plan& plan, const Results& results) {
  std::string html = "<table>\n<tr><th>point</th>";
  for (const Axis& axis : study.axes)
    html += "<th>" + escaped(axis.unit.empty() ? axis.name : axis.name + " (" + axis.unit + ")") + "</th>";
  if (study.error) html += "<th>" + escaped(error_title(study)) + "</th>";
  html += "<th>wall (s)</th><th>particles</th><th>steps</th><th>peak memory (MiB)</th>";
  if (study.instructions) html += "<th>instructions</th>";
  html += "<th>outcome</th></tr>\n";
  for (const Row& row : results.rows) {
    const Point& point = plan.points[row.point];
    html += fmt::format("<tr{}>", row.on_front ? " class=front" : "") + number_cell(std::to_string(row.point + 1));
    for (std::size_t a = 0; a < point.at.size(); ++a)
      html += "<td>" + escaped(study.axes[a].values[point.at[a]].label) + "</td>";
    if (study.error) html += number_cell(row.is_reference ? "reference" : row.error ? fmt::format("{:.3e}", *row.error) : "");
    const Record record = row.record.value_or(Record{});
    html += number_cell(record.wall_seconds.empty() ? "" : fmt::format("{:.3g}", record.wall()));
    html += number_cell(record.particles > 0 ? std::to_string(record.particles) : "");
    html += number_cell(record.steps > 0 ? std::to_string(record.steps) : "");
    html += number_cell(record.peak_memory > 0 ? fmt::format("{:.1f}", record.peak_memory / 1048576) : "");
    if (study.instructions) html += number_cell(record.instructions ? fmt::format("{:.3e}", *record.instructions) : "");
    const std::string word = !row.record ? "not run" : study.stability ? word_of(row.judgement.state) : word_of(record.outcome);
    const std::string& reason = row.judgement.reason.empty() ? record.reason : row.judgement.reason;
    html += "<td>" + escaped(word) + (reason.empty() ? "" : ": " + escaped(reason)) + "</td></tr>\n";
  }
  return html + "</table>\n";
}

std::string boundaries(const Study& study, const Results& results) {
  const auto number = [](const std::optional<double>& x) { return number_cell(x ? fmt::format("{:.3g}", *x) : ""); };
  std::string html = fmt::format(
      "<h2>Boundary</h2>\n<p>Along {0}: the largest value with all smaller ones stable, the next one, and what was predicted. "
      "A "
      "prediction holds if it is at most a factor 2 below the measured boundary and never above it.</p>\n"
      "<table>\n<tr><th>{1}</th><th>stable to</th><th>not at</th><th>predicted</th><th>measured / predicted, from</th>"
      "<th>to</th><th></th></tr>\n",
      escaped(study.axes[1].name), escaped(study.axes[0].name));
  for (const Column& column : results.columns) {
    const Boundary& b = column.boundary;
    html += "<tr><td>" + escaped(study.axes[0].values[column.value].label) + "</td>" + number(b.stable) + number(b.unstable) +
            number(b.predicted) + number(b.low) + number(b.high) + "<td>" + b.verdict + "</td></tr>\n";
  }
  return html + "</table>\n";
}

std::string orders(const Study& study, const Results& results) {
  std::string html;
  for (const Series& series : results.series)
    if (std::isfinite(series.order))
      html += "<tr><td>" + escaped(series.label) + "</td>" + number_cell(fmt::format("{:.2f}", series.order)) + "</tr>\n";
  if (html.empty()) return html;
  return "<h2>Order</h2>\n<p>Slope of the error over " + escaped(study.axes[*study.along].name) +
         " between its two smallest values.</p>\n<table>\n" + html + "</table>\n";
}

}  // namespace

std::string report_html(const Study& study, const Plan& plan, const Results& results,
                        const std::vector<std::pair<Chart, std::string>>& drawn, const std::filesystem::path& out) {
  std::string html = "<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n<title>" + escaped(study.title) +
                     "</title>\n<style>" + style + "</style>\n<h1>" + escaped(study.title) + "</h1>\n" +
                     paragraphs(study.description);
  for (const auto& [chart, svg] : drawn) {
    const auto start = svg.find("<svg");
    html += "<figure>\n" + svg.substr(start == std::string::npos ? 0 : start) + "</figure>\n";
  }
  if (drawn.empty()) html += "<p>Charts need gnuplot, which was not installed.</p>\n";
  for (const std::string& remark : results.remarks) html += "<p>" + escaped(remark) + ".</p>\n";
  if (!results.columns.empty()) html += boundaries(study, results);
  if (study.error && study.along) html += orders(study, results);
  html += "<h2>Points</h2>\n" + table(study, plan, results);
  if (study.error) html += "<p>In bold: the Pareto front. No other point costs less and is as accurate, within 1 %.</p>\n";
  html += "<h2>Measured on</h2>\n";
  for (const std::string& machine : results.machines) html += "<p>" + escaped(machine) + "</p>\n";
  html += fmt::format("<p>cleave {}, {} thread{} per run; wall time is that of the steps, the median of {} run{}.</p>\n",
                      CLEAVE_VERSION, study.threads, study.threads == 1 ? "" : "s", study.repetitions,
                      study.repetitions == 1 ? "" : "s");
  html += "<h2>Commands</h2>\n<pre>" + escaped(fmt::format("cleave study {} --out {}\n\n", study.file.string(), out.string()));
  for (const Run& run : plan.runs) html += escaped("# " + run.what + "\n" + command_of(study, out, run) + "\n");
  return html + "</pre>\n</html>\n";
}

}  // namespace cleave::study
