#pragma once

#include "report/page.hpp"

#include <filesystem>

namespace CLI {
class App;
}

namespace cleave::app {

struct ReportOptions {
  std::filesystem::path run, out;  ///< out empty: report.html in the run's directory
  report::Limits limits;
};

void add_report_options(CLI::App&, ReportOptions&);

/// `cleave report`. Returns the exit status 0. Throws InputError.
int report_command(const ReportOptions&);

}  // namespace cleave::app
