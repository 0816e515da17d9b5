#pragma once

#include <charconv>
#include <string>

namespace cleave::output {

/// The shortest text that reads back as exactly this number, whatever the locale; "nan", "inf" and "-inf" for the rest.
inline std::string number(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

}  // namespace cleave::output
