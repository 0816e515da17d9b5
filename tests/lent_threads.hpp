// Threads as a host lends them to plugins.
#pragma once

#include <cleave/abi.h>

#include <algorithm>
#include <thread>
#include <vector>

namespace cleave::test {

/// Each of `count` threads works on every count-th range.
class LentThreads {
 public:
  explicit LentThreads(unsigned count) : table_{sizeof table_, count, this, &for_ranges} {}
  LentThreads(const LentThreads&) = delete;
  LentThreads& operator=(const LentThreads&) = delete;

  /// Null if there is one thread: the plugin works alone.
  const cleave_threads* get() const { return table_.count > 1 ? &table_ : nullptr; }

 private:
  static void for_ranges(void* user, std::uint64_t size, std::uint64_t grain, void (*work)(void*, std::uint64_t, std::uint64_t),
                         void* data) {
    const unsigned threads = static_cast<LentThreads*>(user)->table_.count;
    std::vector<std::thread> pool;
    for (unsigned t = 0; t < threads; ++t)
      pool.emplace_back([=] {
        for (std::uint64_t first = t * grain; first < size; first += threads * grain)
          work(data, first, std::min(first + grain, size));
      });
    for (auto& thread : pool) thread.join();
  }
  cleave_threads table_;
};

}  // namespace cleave::test
