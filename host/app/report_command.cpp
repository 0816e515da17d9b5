#include "app/report_command.hpp"

#include "output/atomic_file.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

namespace cleave::app {

void add_report_options(CLI::App& command, ReportOptions& options) {
  command.add_option("run", options.run, "Directory with results of cleave run")->required();
  command.add_option("--out", options.out, "File to write (default: report.html in that directory)");
  command.add_option("--points", options.limits.points, "Particles in the view, at most (default: 200000)")
      ->check(CLI::Range(1, 10000000));
  command.add_option("--frames", options.limits.frames, "Frames in the view, at most (default: 60)")
      ->check(CLI::Range(1, 10000));
}

int report_command(const ReportOptions& options) {
  const std::string page = report::page(options.run, options.limits);
  const auto out = options.out.empty() ? options.run / "report.html" : options.out;
  output::AtomicFile file(out);
  file.stream() << page;
  file.commit();
  fmt::print("{}: {:.1f} MB\n", out.string(), double(page.size()) * 1e-6);
  return 0;
}

}  // namespace cleave::app
