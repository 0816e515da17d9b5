#pragma once

#include <string>

namespace cleave::bench {

bool gnuplot_is_installed();

/// Text between quotes, as gnuplot reads it.
std::string gnuplot_text(const std::string&);

/// What a script draws; it sets an svg terminal. Throws InputError if gnuplot cannot be run or draws nothing.
std::string draw_svg(const std::string& script);
/// The same of a script that sets a png or pngcairo terminal.
std::string draw_png(const std::string& script);

}  // namespace cleave::bench
