#include "plugins/threads.hpp"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>

namespace cleave::plugins {
namespace {

void for_ranges(void*, std::uint64_t size, std::uint64_t grain, void (*work)(void*, std::uint64_t, std::uint64_t), void* data) {
  grain = std::max<std::uint64_t>(grain, 1);
  tbb::parallel_for(std::uint64_t(0), (size + grain - 1) / grain,
                    [&](std::uint64_t k) { work(data, k * grain, std::min((k + 1) * grain, size)); });
}

}  // namespace

const cleave_threads* threads() {
  static thread_local cleave_threads table;
  table = {sizeof table, std::uint32_t(tbb::this_task_arena::max_concurrency()), nullptr, &for_ranges};
  return &table;
}

}  // namespace cleave::plugins
