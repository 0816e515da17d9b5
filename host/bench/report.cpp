#include "bench/report.hpp"

#include "bench/gnuplot.hpp"
#include "bench/json.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace cleave::bench {
namespace {

/// "elasticity/qr: stress, with fibres"
std::string label(const Kernel& kernel) { return kernel.id + ": " + kernel.condition; }

std::string number_cell(const std::optional<Timing>& timing) {
  return timing ? fmt::format("{:.2f}", timing->median) : std::string("-");
}

/// What the others are compared with: the plugin named first, under the same condition.
const Kernel* reference(const KernelOptions& options, const KernelResults& results, const Kernel& kernel) {
  for (const Kernel& other : results.kernels)
    if (other.id == options.plugins.front() && other.condition == kernel.condition) return &other;
  return nullptr;
}

std::string ratio_cell(const std::optional<Timing>& timing, const std::optional<Timing>& first) {
  return timing && first ? fmt::format("{:.2f}", timing->median / first->median) : std::string("-");
}

toml::table to_json(const Timing& timing) { return toml::table{{"median_ns", timing.median}, {"fastest_ns", timing.fastest}}; }

/// The label of a tick, which gnuplot takes for a format.
std::string tick(const std::string& text) {
  std::string format;
  for (const char c : text) format += std::string(c == '%' ? 2 : 1, c);
  return gnuplot_text(format);
}

/// Bars grow to the right from the axis; kernels follow each other downwards, single precision above double.
std::string chart_script(const KernelResults& results) {
  const std::size_t rows = results.kernels.size();
  std::string labels, single, doubled;
  double longest = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    const Kernel& kernel = results.kernels[i];
    const double y = double(rows - i);
    labels += fmt::format("{}{} {}", i == 0 ? "" : ", ", tick(label(kernel)), y);
    const auto bar = [&](std::string& bars, const std::optional<Timing>& timing, double low, double high) {
      if (!timing) return;
      bars += fmt::format("0 {} 0 {} {} {}\n", y, timing->median, y + low, y + high);
      longest = std::max(longest, timing->median);
    };
    bar(single, kernel.single, 0.02, 0.36);
    bar(doubled, kernel.doubled, -0.36, -0.02);
  }
  return fmt::format(
      "set terminal svg noenhanced size 900,{} background 'white'\n"
      "set xlabel 'nanoseconds per point'\nset xrange [0:{}]\nset yrange [0.4:{}]\n"
      "set ytics ({})\nset ytics scale 0\nset xtics nomirror\nset grid xtics\nset border 3\nset key outside top center "
      "horizontal\n"
      "$single << END\n{}END\n$double << END\n{}END\n"
      "plot $single using 1:2:3:4:5:6 with boxxyerror fs solid noborder lc rgb '#1f6f8b' title 'single precision', "
      "$double using 1:2:3:4:5:6 with boxxyerror fs solid noborder lc rgb '#e07b39' title 'double precision'\n",
      110 + 30 * rows, 1.05 * longest, double(rows) + 0.6, labels, single.empty() ? "0 0 0 0 0 0\n" : single,
      doubled.empty() ? "0 0 0 0 0 0\n" : doubled);
}

}  // namespace

std::string table_text(const KernelOptions& options, const KernelResults& results) {
  std::size_t width = 0;
  for (const Kernel& kernel : results.kernels) width = std::max(width, label(kernel).size());
  const bool compared = options.plugins.size() > 1;
  std::string text =
      fmt::format("nanoseconds per point, one thread, {} points per call, median of {}\n\n{:<{}}  {:>8}  {:>8}{}\n",
                  options.points, options.repeats, "", width, "single", "double", compared ? "     x of the first" : "");
  for (const Kernel& kernel : results.kernels) {
    text +=
        fmt::format("{:<{}}  {:>8}  {:>8}  ", label(kernel), width, number_cell(kernel.single), number_cell(kernel.doubled));
    if (compared) {
      const Kernel* first = reference(options, results, kernel);
      text += fmt::format("{:>8}  {:>8}  ", ratio_cell(kernel.single, first ? first->single : std::nullopt),
                          ratio_cell(kernel.doubled, first ? first->doubled : std::nullopt));
    }
    text += kernel.isa;
    if (!kernel.elasticity.empty()) text += ", with " + kernel.elasticity;
    text += '\n';
  }
  for (const Skipped& skipped : results.skipped) text += fmt::format("not measured: {}: {}\n", skipped.id, skipped.reason);
  if (!results.skipped.empty()) text += "parameters can be given with --set ID.PARAMETER=VALUE\n";
  return text;
}

std::string json_text(const KernelOptions& options, const KernelResults& results) {
  toml::array kernels, skipped;
  for (const Kernel& kernel : results.kernels) {
    toml::table row{{"plugin", kernel.id}, {"condition", kernel.condition}, {"isa", kernel.isa}};
    if (!kernel.elasticity.empty()) row.insert("elasticity", kernel.elasticity);
    if (kernel.yielding) row.insert("yielding", *kernel.yielding);
    row.insert("parameters", to_json(kernel.parameters));
    if (kernel.single) row.insert("single", to_json(*kernel.single));
    if (kernel.doubled) row.insert("double", to_json(*kernel.doubled));
    kernels.push_back(std::move(row));
  }
  for (const Skipped& s : results.skipped) skipped.push_back(toml::table{{"plugin", s.id}, {"reason", s.reason}});
  const toml::table table{{"points", std::int64_t(options.points)},
                          {"repeats", options.repeats},
                          {"kernels", std::move(kernels)},
                          {"skipped", std::move(skipped)}};
  return json_text(table);
}

std::string chart_svg(const KernelResults& results) { return draw_svg(chart_script(results)); }

}  // namespace cleave::bench
