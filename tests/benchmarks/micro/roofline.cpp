// What one core of this machine can do at most: multiply-adds from registers, and streams of memory that no cache holds.

#include "machine_limits.hpp"
#include "micro.hpp"
#include "specimen.hpp"

#include <cmath>

namespace cleave::benchmarks {
namespace {

template <class T>
void multiply_add(benchmark::State& state) {
  constexpr long rounds = 10000;
  T x = 0;
  for (auto _ : state) benchmark::DoNotOptimize(x = limits::multiply_add(rounds, T(0.5), T(1)));
  state.counters["FLOP/s"] = benchmark::Counter(
      double(state.iterations()) * rounds * double(limits::multiply_add_operations(T())), benchmark::Counter::kIsRate);
  check(state, x == T(2), "x = x/2 + 1 comes to 2");
}

float* numbers(const mpm::Buffer& b) { return reinterpret_cast<float*>(b.data()); }

void read(benchmark::State& state, const Scale& scale) {
  const mpm::Buffer memory(scale.memory_bytes);
  const std::size_t count = scale.memory_bytes / sizeof(float);
  for (std::size_t i = 0; i < count; i++) numbers(memory)[i] = float(i % 2);
  float sum = 0;
  for (auto _ : state) benchmark::DoNotOptimize(sum = limits::sum(numbers(memory), count));
  state.SetBytesProcessed(state.iterations() * std::int64_t(scale.memory_bytes));
  check(state, sum == float(count / 2), "half of all numbers are one");
}

void in_place(benchmark::State& state, const Scale& scale) {
  const mpm::Buffer memory(scale.memory_bytes);
  const std::size_t count = scale.memory_bytes / sizeof(float);
  for (std::size_t i = 0; i < count; i++) numbers(memory)[i] = float(i % 1024);
  bool negative = false;
  for (auto _ : state) {
    limits::scale(numbers(memory), -1, count);
    negative = !negative;
  }
  state.SetBytesProcessed(2 * state.iterations() * std::int64_t(scale.memory_bytes));
  bool right = true;
  for (std::size_t i = 0; i < count; i++) right = right && numbers(memory)[i] == (negative ? -1.f : 1.f) * float(i % 1024);
  check(state, right, "numbers change their sign each time");
}

void triad(benchmark::State& state, const Scale& scale) {
  const mpm::Buffer a(scale.memory_bytes), b(scale.memory_bytes), c(scale.memory_bytes);
  const std::size_t count = scale.memory_bytes / sizeof(float);
  for (std::size_t i = 0; i < count; i++) {
    numbers(a)[i] = -1;  // pages are there from the start
    numbers(b)[i] = float(i % 1024);
    numbers(c)[i] = float(i % 3);
  }
  for (auto _ : state) limits::triad(numbers(a), numbers(b), numbers(c), 2, count);
  state.SetBytesProcessed(3 * state.iterations() * std::int64_t(scale.memory_bytes));
  bool right = true;
  for (std::size_t i = 0; i < count; i++) right = right && numbers(a)[i] == float(i % 1024 + 2 * (i % 3));
  check(state, right, "a = b + 2 c");
}

}  // namespace

void register_roofline(const Scale& scale) {
  benchmark::RegisterBenchmark("limit/multiply_add/single", multiply_add<float>);
  benchmark::RegisterBenchmark("limit/multiply_add/double", multiply_add<double>);
  benchmark::RegisterBenchmark("limit/memory/read", read, scale);
  benchmark::RegisterBenchmark("limit/memory/in_place", in_place, scale);
  benchmark::RegisterBenchmark("limit/memory/triad", triad, scale);
}

}  // namespace cleave::benchmarks
