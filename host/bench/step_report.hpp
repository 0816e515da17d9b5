#pragma once

#include "bench/step_benchmark.hpp"

#include <string>

namespace cleave::bench {

/// A line for each result: speed, bytes, and nanoseconds of every stage that took any time.
std::string table_text(const StepResults&);
/// The same as a Markdown table.
std::string markdown_text(const StepResults&);
std::string json_text(const StepResults&);

/// Speed over the number of particles, at the most threads, and over the number of threads, with the most particles: those of
/// the two where there is more than one number. Drawn by gnuplot.
std::string chart_svg(const StepResults&);

}  // namespace cleave::bench
