#pragma once

#include "point/laws.hpp"

#include <iosfwd>

namespace cleave::point {

/// `cleave point --json`: one JSON object a line, in both directions. The first line announces the laws and what their points
/// are made of; then each line of `in` (a point, or a list of them) is answered by one line, in order, flushed. What cannot be
/// used is answered by {"error": ..., "id": ...}. Returns at the end of `in`. The protocol is described in docs/point.md.
/// Throws InputError if `out` cannot be written.
void serve_json(const Laws&, std::istream& in, std::ostream& out);

}  // namespace cleave::point
