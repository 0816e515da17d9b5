#pragma once

#include "output/frame.hpp"

#include <string>

namespace cleave::output {

/// Valid JSON in UTF-8: a number that is not finite becomes null, bytes that are not UTF-8 become U+FFFD.
/// To what it is given it adds `peak_memory_bytes` of this process.
std::string summary_json(const Summary&);

}  // namespace cleave::output
