#pragma once

#include "output/frame.hpp"

#include <functional>
#include <future>
#include <utility>

namespace cleave::output {

/// Writes frames and their rows of frames.csv while the simulation goes on: in order, one at a time, each on a thread of its
/// own that asks TBB for at most `threads` threads. A frame that is due while the one before is being written waits for it, so
/// that one copy of the particles is the most there is. With no threads given to it, frames are written where they are handed
/// over.
///
/// What writing throws reaches whoever calls next. To be called from one thread.
class BackgroundWriter {
 public:
  /// `clock`: wall seconds since the start of the run, also called while frames are written.
  BackgroundWriter(Writer&, int threads, std::function<double()> clock);
  ~BackgroundWriter();  ///< waits; what is thrown here is lost: wait() before
  BackgroundWriter(const BackgroundWriter&) = delete;
  BackgroundWriter& operator=(const BackgroundWriter&) = delete;

  /// To be called with each frame after its files are written and before its row is, where they are written.
  void also(std::function<void(const ParticleFrame&)> what) { also_ = std::move(what); }

  /// Waits for the frame before. The row gets its wall_seconds when the frame's files are complete, and is written then.
  void write(ParticleFrame, FrameRecord);
  void wait();   ///< until what was handed over is complete
  void check();  ///< throws what writing has thrown so far; does not wait

  /// Of the frames waited for, the number that is complete and the seconds spent on them beside the simulation.
  int frames() const { return frames_; }
  double seconds() const { return seconds_; }

 private:
  void write_now(const ParticleFrame&, FrameRecord&);

  Writer& writer_;
  int threads_;
  std::function<double()> clock_;
  std::function<void(const ParticleFrame&)> also_;
  int frames_ = 0;
  double seconds_ = 0;
  std::future<double> pending_;  ///< seconds that the frame took
};

}  // namespace cleave::output
