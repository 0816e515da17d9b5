#pragma once

#include "render/image.hpp"

#include <string>

namespace cleave::render {

/// Width of a line of text, in pixels; `size` is the height of its capitals and what hangs below.
int text_width(const std::string& utf8, int size);

/// Writes one line; (x, y) is the left end of its base line.
void draw_text(Image&, const std::string& utf8, int x, int y, int size, Color);

}  // namespace cleave::render
