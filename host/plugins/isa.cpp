#include "plugins/isa.hpp"

#include "common/error.hpp"

#include <cstdlib>
#include <optional>
#include <string>

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

std::string directory(int level) { return "x86-64-v" + std::to_string(level); }

/// The level of this name; `said` is what the user said. Throws InputError if there is none or this processor lacks it.
int level_named(const std::string& name, const std::string& said) {
  const int supported = supported_level();
  for (int level = 2; level <= 4; ++level) {
    if (name != directory(level)) continue;
    if (level > supported)
      throw InputError(said + ": this processor supports at most " + (supported ? directory(supported) : "its own baseline"));
    return level;
  }
  throw InputError(said + ": must be x86-64-v2, x86-64-v3 or x86-64-v4");
}

std::optional<int> forced_level() {
  const char* forced = std::getenv("CLEAVE_ISA");
  if (!forced || !*forced) return std::nullopt;
  return level_named(forced, "CLEAVE_ISA=" + std::string(forced));
}

}  // namespace

std::vector<std::string> preferred_isa_directories() {
  if (const auto level = forced_level())
    return *level == 2 ? std::vector<std::string>{} : std::vector<std::string>{directory(*level)};
  std::vector<std::string> directories;
  for (int level = supported_level(); level >= 3; --level) directories.push_back(directory(level));
  return directories;
}

std::filesystem::path forced_variant(const std::filesystem::path& library) {
  const auto level = forced_level();
  if (!level) return library;
  const auto variant = library.parent_path() / directory(*level) / library.filename();
  return std::filesystem::is_regular_file(variant) ? variant : library;
}

void force_isa(const std::string& name) {
  level_named(name, "--isa " + name);
  setenv("CLEAVE_ISA", name.c_str(), 1);
}

}  // namespace cleave::plugins
