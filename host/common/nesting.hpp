#pragma once

#include <string_view>
#include <vector>

namespace cleave {

/// Tables within tables that a TOML document may have at most. Tables are read, written and freed recursively: deeper ones,
/// of a header or a key of many dots, would overflow the stack.
inline constexpr int deepest_toml = 256;

/// The line (from 1) at which a TOML text nests values deeper than `deepest_toml`, found without parsing it; 0 if nowhere.
inline int line_nested_too_deep(std::string_view text) {
  std::vector<int> dots_outside;  // of the key before each bracket that is open
  int depth = 0, dots = 0, line = 1;
  const auto at = [&](std::size_t i) { return i < text.size() ? text[i] : '\n'; };
  for (std::size_t i = 0; i < text.size(); ++i) {
    switch (const char c = text[i]) {
      case '\n':
        ++line;
        if (dots_outside.empty()) dots = 0;
        break;
      case '#':
        while (at(i + 1) != '\n') ++i;
        break;
      case '"':
      case '\'': {
        const bool several_lines = at(i + 1) == c && at(i + 2) == c;
        i += several_lines ? 3 : 1;
        const auto closes = [&] { return text[i] == c && (!several_lines || (at(i + 1) == c && at(i + 2) == c)); };
        for (; i < text.size() && !closes(); ++i) {
          if (text[i] == '\n') {
            if (!several_lines) break;
            ++line;
          } else if (c == '"' && text[i] == '\\' && at(i + 1) != '\n') {
            ++i;
          }
        }
        if (i < text.size() && text[i] == '\n') --i;  // a text that was not closed ends with its line
        // Up to two quotes of the text itself may stand before the three that close it.
        if (several_lines) i += 2;
        for (int more = 0; several_lines && more < 2 && at(i + 1) == c; ++more) ++i;
        break;
      }
      case '.':
        ++dots;
        break;
      case '[':
      case '{':
        dots_outside.push_back(dots);
        depth += dots + 1;
        dots = 0;
        break;
      case ']':
      case '}':
        if (!dots_outside.empty()) {
          depth -= dots_outside.back() + 1;
          dots_outside.pop_back();
        }
        [[fallthrough]];
      case ',':
        dots = 0;
        break;
      default:
        break;
    }
    if (depth + dots > deepest_toml) return line;
  }
  return 0;
}

}  // namespace cleave
