#pragma once

#include "output/frame.hpp"

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <string>

namespace cleave::output {

/// Tells the person who waits how far a simulation is: on a terminal one line that is drawn over about ten times a second,
/// elsewhere a line per frame. Rates are in Mp/s, million particle steps per second of wall time.
class Progress {
 public:
  enum class Mode { bar, lines, quiet };

  /// Bar on a terminal, lines elsewhere.
  static Mode mode_for(int file_descriptor);

  Progress(double end_time, std::int64_t particles, Mode);  ///< on the standard error stream
  /// `clock` gives seconds; `width` is that of the terminal, in characters, 0: ask for it at every drawing.
  Progress(double end_time, std::int64_t particles, Mode, std::ostream& out, std::function<double()> clock, int width = 80);
  ~Progress();  ///< leaves the cursor at the start of a line, whatever was drawn
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Where a run that is resumed goes on from: rates and times are those since then.
  void start(double time, std::int64_t steps);
  /// After each step, or each few: simulated time, steps since the start and the frame being worked on. Costs a look at the
  /// clock.
  void step(double time, std::int64_t steps, int frame);
  void frame(const FrameRecord&);           ///< a frame has been reached
  void finish(const std::string& message);  ///< clears the bar and prints the message

 private:
  struct Sample {
    double wall = 0, time = 0;
    std::int64_t steps = 0;
  };
  void draw();
  void clear();
  double rate(const Sample& from, const Sample& to) const;  ///< Mp/s
  std::string time_left() const;
  double percent() const;

  double end_time_;
  std::int64_t particles_;
  Mode mode_;
  std::ostream& out_;
  std::function<double()> clock_;
  int width_;
  Sample first_, now_, frame_start_;
  Sample rate_start_;        ///< of the interval that the next shown rate is averaged over
  double recent_rate_ = 0;   ///< Mp/s, over the last finished interval
  double next_drawing_ = 0;  ///< s
  int frame_ = 0;
  bool drawn_ = false;
};

}  // namespace cleave::output
