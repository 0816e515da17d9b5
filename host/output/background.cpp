#include "output/background.hpp"

#include <tbb/task_arena.h>

#include <chrono>
#include <utility>

namespace cleave::output {

BackgroundWriter::BackgroundWriter(Writer& writer, int threads, std::function<double()> clock)
    : writer_(writer), threads_(threads), clock_(std::move(clock)) {}

BackgroundWriter::~BackgroundWriter() {
  if (pending_.valid()) pending_.wait();
}

void BackgroundWriter::write_now(const ParticleFrame& frame, FrameRecord& record) {
  writer_.frame(frame);
  if (also_) also_(frame);
  record.wall_seconds = clock_();
  writer_.record(record);
}

void BackgroundWriter::write(ParticleFrame frame, FrameRecord record) {
  wait();
  if (threads_ < 1) {
    write_now(frame, record);
    frames_++;
    return;
  }
  pending_ = std::async(std::launch::async, [this, given = std::move(frame), record]() mutable {
    const ParticleFrame taken = std::move(given);  // given back when it is written, not when somebody waits for it
    const double start = clock_();
    tbb::task_arena(threads_).execute([&] { write_now(taken, record); });
    return clock_() - start;
  });
}

void BackgroundWriter::wait() {
  if (!pending_.valid()) return;
  seconds_ += pending_.get();
  frames_++;
}

void BackgroundWriter::check() {
  if (pending_.valid() && pending_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) wait();
}

}  // namespace cleave::output
