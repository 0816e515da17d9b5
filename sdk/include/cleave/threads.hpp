/// Threads that the host lends to a plugin for the time of a call.
#ifndef CLEAVE_THREADS_HPP
#define CLEAVE_THREADS_HPP

#include <cleave/abi.h>

#include <algorithm>
#include <cstdint>
#include <exception>
#include <mutex>

namespace cleave {

class Threads {
 public:
  /// Alone, if there are none.
  explicit Threads(const cleave_threads* threads = nullptr) : threads_(threads) {}

  std::uint32_t count() const { return threads_ ? threads_->count : 1; }

  /// work(first, last) for the ranges [k grain, (k + 1) grain) of [0, size), whichever the threads: what a range computes on
  /// its own is the same for any number of them. Rethrows the first exception of a range; the others are still worked on.
  template <class Work>
  void for_ranges(std::uint64_t size, std::uint64_t grain, const Work& work) const {
    grain = std::max<std::uint64_t>(grain, 1);
    if (!threads_) {
      for (std::uint64_t first = 0; first < size; first += grain) work(first, std::min(first + grain, size));
      return;
    }
    struct Call {
      const Work& work;
      std::mutex mutex;
      std::exception_ptr thrown;
    } call{work, {}, nullptr};
    const auto range = [](void* data, std::uint64_t first, std::uint64_t last) {
      auto& c = *static_cast<Call*>(data);
      try {
        c.work(first, last);
      } catch (...) {
        const std::lock_guard lock(c.mutex);
        if (!c.thrown) c.thrown = std::current_exception();
      }
    };
    threads_->for_ranges(threads_->user, size, grain, range, &call);
    if (call.thrown) std::rethrow_exception(call.thrown);
  }

  /// task(0), task(1), ... task(count - 1), each a piece of work of its own.
  template <class Task>
  void for_each(std::uint64_t count, const Task& task) const {
    for_ranges(count, 1, [&](std::uint64_t first, std::uint64_t) { task(first); });
  }

 private:
  const cleave_threads* threads_;
};

}  // namespace cleave

#endif
