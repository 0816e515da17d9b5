#include "output/summary.hpp"

#include "output/number.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>

namespace cleave::output {
namespace {

/// Length of the well-formed UTF-8 character at `position`, 0 if there is none.
std::size_t character_length(const std::string& text, std::size_t position) {
  const auto byte = [&](std::size_t i) {
    return position + i < text.size() ? static_cast<unsigned char>(text[position + i]) : static_cast<unsigned char>(0);
  };
  const unsigned first = byte(0);
  const std::size_t length = first < 0x80                    ? 1
                             : first >= 0xc2 && first < 0xe0 ? 2
                             : first >= 0xe0 && first < 0xf0 ? 3
                             : first >= 0xf0 && first < 0xf5 ? 4
                                                             : 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((byte(i) & 0xc0) != 0x80) return 0;
  // Overlong forms, surrogates and what lies beyond the last code point show in the second byte.
  if ((first == 0xe0 && byte(1) < 0xa0) || (first == 0xed && byte(1) >= 0xa0) || (first == 0xf0 && byte(1) < 0x90) ||
      (first == 0xf4 && byte(1) >= 0x90))
    return 0;
  return length;
}

std::string json(const std::string& text) {
  std::string result = "\"";
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = character_length(text, i);
    const char c = text[i];
    if (length == 0) {
      result += "\\ufffd";
    } else if (length > 1) {
      result.append(text, i, length);
    } else if (c == '"' || c == '\\') {
      result += {'\\', c};
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(c));
      result += escape;
    } else {
      result += c;
    }
    i += length == 0 ? 1 : length;
  }
  return result + '"';
}

std::string json(double value) { return std::isfinite(value) ? number(value) : "null"; }
std::string json(std::int64_t value) { return std::to_string(value); }
std::string json(int value) { return std::to_string(value); }

template <class Value>
std::string json(const std::vector<std::pair<std::string, Value>>& members) {
  std::string result;
  for (const auto& [name, value] : members) result += (result.empty() ? "\n    " : ",\n    ") + json(name) + ": " + json(value);
  return result.empty() ? "{}" : "{" + result + "\n  }";
}

std::string json(const std::vector<PluginRecord>& plugins) {
  std::string result;
  for (const PluginRecord& plugin : plugins)
    result += (result.empty() ? "\n    {" : ",\n    {") + ("\"id\": " + json(plugin.id)) +
              ", \"version\": " + json(plugin.version) + ", \"path\": " + json(plugin.path) +
              ", \"sha256\": " + json(plugin.sha256) + "}";
  return result.empty() ? "[]" : "[" + result + "\n  ]";
}

/// The most memory this program has held at once, bytes; NaN where the system does not tell. Unlike getrusage it does not count
/// what the program was started from.
double peak_memory() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return 1024 * std::strtod(line.c_str() + 6, nullptr);
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

std::string summary_json(const Summary& summary) {
  std::string result;
  const auto add = [&result](const char* name, const auto& value) {
    result += (result.empty() ? "{\n  \"" : ",\n  \"") + std::string(name) + "\": " + json(value);
  };
  add("status", summary.status);
  add("scene", summary.scene);
  add("version", summary.version);
  add("particles", summary.particles);
  add("steps", summary.steps);
  add("frames", summary.frames);
  add("simulated_seconds", summary.simulated_seconds);
  add("wall_seconds", summary.wall_seconds);
  add("particle_steps_per_second", summary.particle_steps_per_second);
  add("stage_seconds", summary.stage_seconds);
  add("limits", summary.limits);
  add("integrators", summary.integrators);
  add("bytes_per_particle", summary.bytes_per_particle);
  add("peak_memory_bytes", peak_memory());
  add("plugins", summary.plugins);
  add("threads", summary.threads);
  add("precision", summary.precision);
  add("isa", summary.isa);
  return result + "\n}\n";
}

}  // namespace cleave::output
