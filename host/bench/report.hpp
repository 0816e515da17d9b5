#pragma once

#include "bench/kernel_benchmark.hpp"

#include <string>

namespace cleave::bench {

/// Where several plugins were named, each is also compared with the first of them, condition by condition.
std::string table_text(const KernelOptions&, const KernelResults&);
std::string json_text(const KernelOptions&, const KernelResults&);

/// Horizontal bars, one for each kernel and precision, drawn by gnuplot.
std::string chart_svg(const KernelResults&);

}  // namespace cleave::bench
