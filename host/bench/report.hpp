#pragma once

#include "bench/kernel_benchmark.hpp"

#include <string>

namespace cleave::bench {

std::string table_text(const KernelOptions&, const KernelResults&);
std::string json_text(const KernelOptions&, const KernelResults&);

/// Horizontal bars, one for each kernel and precision, drawn by gnuplot.
bool gnuplot_is_installed();
std::string chart_svg(const KernelResults&);

}  // namespace cleave::bench
