#include "output/progress.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <utility>

namespace cleave::output {
namespace {

constexpr double redraw_seconds = 0.1;
constexpr double rate_seconds = 1;  // over which the shown rate is averaged

double steady_seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

int terminal_width() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

template <class... Values>
std::string format(const char* pattern, Values... values) {
  char text[160];
  const int length = std::snprintf(text, sizeof text, pattern, values...);
  return {text, static_cast<std::size_t>(std::clamp(length, 0, static_cast<int>(sizeof text) - 1))};
}

std::string duration(double seconds) {
  const auto whole = static_cast<long long>(std::ceil(seconds));
  if (whole >= 3600) return format("%lld:%02lld:%02lld", whole / 3600, whole / 60 % 60, whole % 60);
  return format("%lld:%02lld", whole / 60, whole % 60);
}

}  // namespace

Progress::Mode Progress::mode_for(int file_descriptor) { return ::isatty(file_descriptor) ? Mode::bar : Mode::lines; }

Progress::Progress(double end_time, std::int64_t particles, Mode mode)
    : Progress(end_time, particles, mode, std::cerr, steady_seconds, 0) {}

Progress::Progress(double end_time, std::int64_t particles, Mode mode, std::ostream& out, std::function<double()> clock,
                   int width)
    : end_time_(end_time), particles_(particles), mode_(mode), out_(out), clock_(std::move(clock)), width_(width) {
  first_.wall = clock_();
  now_ = frame_start_ = rate_start_ = first_;
  next_drawing_ = first_.wall;
}

Progress::~Progress() {
  clear();
  out_.flush();
}

void Progress::step(double time, std::int64_t steps, int frame) {
  if (mode_ == Mode::quiet) return;
  now_ = {clock_(), time, steps};
  frame_ = frame;
  if (now_.wall - rate_start_.wall >= rate_seconds) {
    recent_rate_ = rate(rate_start_, now_);
    rate_start_ = now_;
  }
  if (mode_ == Mode::bar && now_.wall >= next_drawing_) draw();
}

void Progress::start(double time, std::int64_t steps) {
  if (mode_ == Mode::quiet) return;
  first_ = now_ = frame_start_ = rate_start_ = {clock_(), time, steps};
}

void Progress::frame(const FrameRecord& record) {
  if (mode_ == Mode::quiet) return;
  now_.wall = clock_();
  now_.time = record.time;
  frame_ = record.frame;
  if (mode_ == Mode::bar) {
    if (now_.wall >= next_drawing_) draw();
    return;
  }
  out_ << format("frame %d  time %.6g s  %.0f%%", record.frame, record.time, percent());
  if (record.steps > 0) {
    // The steps that step() told of are those of this frame, unless nobody called it.
    now_.steps = std::max(now_.steps, frame_start_.steps + record.steps);
    out_ << "  " << record.steps << " steps, last " << format("%.3g s", record.time_step);
    if (!record.limited_by.empty()) out_ << " (" << record.limited_by << ')';
    out_ << format("  %.1f Mp/s  ", rate(frame_start_, now_)) << time_left() << " left";
  }
  out_ << std::endl;
  frame_start_ = now_;
}

void Progress::finish(const std::string& message) {
  if (mode_ == Mode::quiet) return;
  clear();
  out_ << message << std::endl;
}

void Progress::draw() {
  next_drawing_ = now_.wall + redraw_seconds;
  const double shown_rate = recent_rate_ > 0 ? recent_rate_ : rate(first_, now_);
  std::string text =
      format("%3.0f%%  frame %d  step %lld  %.1f Mp/s  ", percent(), frame_, static_cast<long long>(now_.steps), shown_rate) +
      time_left() + " left";
  // The last column stays empty: some terminals wrap as soon as it is filled.
  const int width = (width_ > 0 ? width_ : terminal_width()) - 1;
  const int bar_width = std::min(40, width - static_cast<int>(text.size()) - 3);
  if (bar_width >= 5) {
    const int filled = static_cast<int>(percent() / 100 * bar_width);
    text = '[' + std::string(static_cast<std::size_t>(filled), '#') +
           std::string(static_cast<std::size_t>(bar_width - filled), '-') + "] " + text;
  }
  if (static_cast<int>(text.size()) > width) text.resize(static_cast<std::size_t>(std::max(width, 0)));
  out_ << '\r' << text << "\x1b[K" << std::flush;
  drawn_ = true;
}

void Progress::clear() {
  if (std::exchange(drawn_, false)) out_ << "\r\x1b[K";
}

double Progress::rate(const Sample& from, const Sample& to) const {
  const double seconds = to.wall - from.wall;
  return seconds > 0 ? 1e-6 * static_cast<double>(particles_) * static_cast<double>(to.steps - from.steps) / seconds : 0;
}

std::string Progress::time_left() const {
  const double done = now_.time - first_.time, left = (end_time_ - now_.time) / done * (now_.wall - first_.wall);
  return done > 0 && std::isfinite(left) && left < 1e7 ? duration(std::max(left, 0.0)) : "-:--";
}

double Progress::percent() const {
  return end_time_ > 0 && std::isfinite(now_.time) ? std::clamp(100 * now_.time / end_time_, 0.0, 100.0) : 0;
}

}  // namespace cleave::output
