#include "plugins/isa.hpp"

#include "common/error.hpp"

#include <cstdlib>
#include <string_view>

namespace cleave::plugins {
namespace {

/// Highest level of the x86-64 psABI that processor and operating system support; 0 on other processors.
int supported_level() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                  __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                  __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                  __builtin_cpu_supports("avx512vl");
  return v4 ? 4 : v3 ? 3 : 2;
#else
  return 0;
#endif
}

}  // namespace

std::vector<std::string> preferred_isa_directories() {
  const int supported = supported_level();
  const auto directory = [](int level) { return "x86-64-v" + std::to_string(level); };
  if (const char* forced = std::getenv("CLEAVE_ISA"); forced && *forced) {
    for (int level = 2; level <= 4; ++level) {
      if (forced != directory(level)) continue;
      if (level > supported)
        throw InputError("CLEAVE_ISA=" + std::string(forced) + ": this processor supports at most " +
                         (supported ? directory(supported) : "its own baseline"));
      return level == 2 ? std::vector<std::string>{} : std::vector<std::string>{directory(level)};
    }
    throw InputError("CLEAVE_ISA=" + std::string(forced) + ": must be x86-64-v2, x86-64-v3 or x86-64-v4");
  }
  std::vector<std::string> directories;
  for (int level = supported; level >= 3; --level) directories.push_back(directory(level));
  return directories;
}

}  // namespace cleave::plugins
