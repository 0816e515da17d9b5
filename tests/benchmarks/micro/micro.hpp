#pragma once

#include <benchmark/benchmark.h>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

/// Benchmarks of the parts of a step. Each looks at what it has computed when it is done, so that a run of one iteration is a
/// test.
namespace cleave::benchmarks {

struct Scale {
  std::int64_t particles;    ///< about, of blocks
  std::size_t memory_bytes;  ///< that loops over memory go through
};

/// Ends a benchmark as failed unless `right`; the program then ends with an error.
void check(benchmark::State&, bool right, const char* claim);
int failed_checks();

/// Instruction sets that this processor has and kernels are built for, best first, as CLEAVE_ISA names them ("baseline" if
/// the processor has no such names).
std::vector<std::string> instruction_sets();

/// "single" or "double"
template <class T>
constexpr const char* precision_name() {
  return sizeof(T) == 4 ? "single" : "double";
}

void register_transfers(const Scale&);
void register_order(const Scale&);
void register_damage(const Scale&);
void register_laws();
void register_roofline(const Scale&);

}  // namespace cleave::benchmarks
