#include <unistd.h>

#include <cstdio>

namespace {

bool processor_has_level(int level) {
  __builtin_cpu_init();
  const bool v2 = __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt");
  const bool v3 = v2 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                  __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  return level <= 2 ? v2 : level == 3 ? v3 : v4;
}

/// Runs before the initializers of the other translation units, which may already contain the instructions in question.
__attribute__((constructor(101))) void skip_without_instruction_set() {
  if (processor_has_level(CLEAVE_TEST_X86_64_LEVEL)) return;
  std::fprintf(stderr, "Skipped: this processor lacks x86-64-v%d.\n", CLEAVE_TEST_X86_64_LEVEL);
  _exit(77);
}

}  // namespace
