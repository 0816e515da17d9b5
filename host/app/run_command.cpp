#include "app/run_command.hpp"

#include "common/error.hpp"
#include "config/scene.hpp"
#include "discretization/simulation.hpp"
#include "mpm/law_watch.hpp"
#include "output/background.hpp"
#include "output/frame.hpp"
#include "output/progress.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <time.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>

namespace cleave::app {

namespace {

volatile std::sig_atomic_t interrupted = 0;
timespec interrupted_at;

/// A launcher that signals both the program and its group sends the same request twice: what follows at once is no second one.
extern "C" void on_interrupt(int signal_number) {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  if (!interrupted) {
    interrupted = 1;
    interrupted_at = now;
  } else if (double(now.tv_sec - interrupted_at.tv_sec) + 1e-9 * double(now.tv_nsec - interrupted_at.tv_nsec) > 0.5) {
    signal(signal_number, SIG_DFL);
    raise(signal_number);
  }
}

/// The first SIGINT or SIGTERM ends the run after the current step; a second one ends the program.
struct InterruptGuard {
  InterruptGuard() {
    interrupted = 0;
    struct sigaction action {};
    action.sa_handler = on_interrupt;
    sigaction(SIGINT, &action, &old_int);
    sigaction(SIGTERM, &action, &old_term);
  }
  ~InterruptGuard() {
    sigaction(SIGINT, &old_int, nullptr);
    sigaction(SIGTERM, &old_term, nullptr);
  }
  struct sigaction old_int {
  }, old_term{};
};

std::string memory_report(const mpm::Simulation& simulation) {
  std::string parts;
  double total = 0;
  for (const auto& [name, bytes] : simulation.bytes_per_particle()) {
    if (name == "total")
      total = bytes;
    else
      parts += fmt::format("{}{} {:g}", parts.empty() ? "" : ", ", name, bytes);
  }
  return fmt::format("{:g} bytes per particle: {}", total, parts);
}

/// The state at the end of a failed run, in the format of a particle file.
std::string particle_csv(const output::ParticleFrame& f) {
  std::string text = "x,y,z,vx,vy,vz,volume,id,body";
  for (const auto& a : f.attributes)
    for (int c = 0; c < a.components; c++) text += "," + a.name + (a.components > 1 ? std::to_string(c) : "");
  text += "\n";
  for (std::size_t i = 0; i < f.particles(); i++) {
    const auto& x = f.positions[i];
    const auto& v = f.velocities[i];
    text += fmt::format("{},{},{},{},{},{},{},{},{}", x[0], x[1], x[2], v[0], v[1], v[2], f.volumes[i], i, f.body_of(i));
    for (const auto& a : f.attributes)
      for (int c = 0; c < a.components; c++)
        text += fmt::format(",{}", a.values[i * std::size_t(a.components) + std::size_t(c)]);
    text += "\n";
  }
  return text;
}

}  // namespace

int run_command(const RunOptions& options, plugins::Registry& registry) {
  using Clock = std::chrono::steady_clock;
  const InterruptGuard guard;  // from the start: a run stopped while it samples its bodies ends in order, too
  std::vector<config::Override> overrides;
  for (const auto& s : options.sets) overrides.push_back(config::parse_override(s));
  std::vector<std::string> warnings;
  const config::Scene scene = config::load_scene(options.scene, overrides, registry, &warnings);
  for (const auto& w : warnings) fmt::print(stderr, "{}\n", w);

  const int threads = options.threads > 0 ? options.threads : tbb::info::default_concurrency();
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(threads));

  const auto begin = Clock::now();
  const auto seconds_since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };
  auto simulation = discretization::simulate(scene, registry);
  const std::filesystem::path out = options.out.empty() ? std::filesystem::path("out") / options.scene.stem() : options.out;
  output::Writer writer(out, scene.output.formats, scene.output.surface);
  writer.text("scene.toml", config::to_toml(scene, registry));

  const bool single = scene.simulation.precision == config::Precision::single_precision;
  if (!options.quiet) {
    const std::string_view isa = simulation->isa();
    std::string used;
    for (const auto& p : simulation->plugins()) used += fmt::format("{}{} {}", used.empty() ? "" : ", ", p.id, p.version);
    fmt::print("{} particles, {}D, cells of {:g} m, {} precision, {} thread{}, {} kernels; sampled in {:.2f} s\n",
               simulation->particles(), scene.simulation.dimension, scene.simulation.cell_size, single ? "single" : "double",
               threads, threads == 1 ? "" : "s", isa == "none" ? "no" : isa, seconds_since(begin));
    fmt::print("plugins: {}\n{}\n", used, memory_report(*simulation));
    std::fflush(stdout);
  }

  const auto& sim = scene.simulation;
  const double interval = 1 / sim.frame_rate;
  auto last_frame = int(std::ceil(sim.end_time * sim.frame_rate - 1e-6));
  const double end_time = options.frames ? std::min(sim.end_time, *options.frames * interval) : sim.end_time;
  if (options.frames) last_frame = std::min(last_frame, *options.frames);

  output::Summary summary;
  summary.scene = std::filesystem::absolute(options.scene).string();
  summary.particles = simulation->particles();
  summary.threads = threads;
  summary.precision = single ? "single" : "double";
  summary.isa = simulation->isa();
  summary.version = CLEAVE_VERSION;
  summary.plugins = simulation->plugins();
  summary.bytes_per_particle = simulation->bytes_per_particle();

  output::Progress progress(end_time, simulation->particles(),
                            options.quiet ? output::Progress::Mode::quiet : output::Progress::mode_for(2));
  const mpm::CrashDump crash_dump(out / "failed_batch.json");
  // Half of the threads at most: the others step. A single one cannot do both at once.
  output::BackgroundWriter frames(writer, threads / 2, [&] { return seconds_since(begin); });
  double stepping = 0, output_wait = 0;
  int frames_taken = 0;
  const auto wait_for_frames = [&] {
    const auto t = Clock::now();
    frames.wait();
    output_wait += seconds_since(t);
  };
  const auto take_frame = [&](int index) {
    wait_for_frames();  // before the particles are copied: one copy is enough
    const auto t = Clock::now();
    auto record = simulation->measure();
    record.frame = index;
    progress.frame(record);
    frames.write(simulation->frame(index), std::move(record));
    frames_taken++;
    output_wait += seconds_since(t);
  };
  const auto write_summary = [&](const char* status) {
    summary.status = status;
    summary.steps = simulation->steps();
    summary.frames = frames.frames();
    summary.simulated_seconds = simulation->time();
    summary.wall_seconds = seconds_since(begin);
    summary.particle_steps_per_second =
        stepping > 0 ? double(simulation->particles()) * double(simulation->steps()) / stepping : 0;
    summary.stage_seconds = simulation->stage_seconds();
    summary.stage_seconds.emplace_back("output", output_wait);
    if (frames.seconds() > 0) summary.stage_seconds.emplace_back("output in the background", frames.seconds());
    summary.limits = simulation->limits();
    summary.integrators = simulation->integrators();
    writer.summary(summary);
  };

  const char* status = "done";
  try {
    take_frame(0);
    for (int f = 1; f <= last_frame && !interrupted; f++) {
      const double target = f == last_frame && !options.frames ? sim.end_time : std::min(f * interval, sim.end_time);
      while (simulation->time() < target && !interrupted) {
        if (options.steps && simulation->steps() >= *options.steps) break;
        const auto t = Clock::now();
        simulation->step(target);
        stepping += seconds_since(t);
        frames.check();
        progress.step(simulation->time(), simulation->steps(), f);
      }
      if (interrupted) break;
      take_frame(f);
      if (options.steps && simulation->steps() >= *options.steps) break;
    }
    if (interrupted) {
      status = "interrupted";
      take_frame(frames_taken);
    }
    wait_for_frames();
  } catch (const SimulationError& e) {
    progress.finish("");
    fmt::print(stderr, "error: the simulation failed: {}\n", e.what());
    try {
      wait_for_frames();
    } catch (const InputError& unwritten) {
      fmt::print(stderr, "{}\n", unwritten.what());
    }
    writer.text("failed_state.csv", particle_csv(simulation->frame(frames_taken)));
    writer.text("failure.txt", std::string(e.what()) + "\n");
    const bool law_failed = !simulation->failed_batch().empty();
    std::error_code ignored;
    std::filesystem::remove(out / "failed_batch.json", ignored);  // of an earlier run
    if (law_failed) writer.text("failed_batch.json", simulation->failed_batch());
    write_summary("failed");
    fmt::print(stderr, "the state that failed is in {}; frames before it are complete\n", (out / "failed_state.csv").string());
    if (law_failed)
      fmt::print(stderr, "call the law again with its last points: cleave point --replay {}\n",
                 (out / "failed_batch.json").string());
    return 3;
  }
  write_summary(status);
  progress.finish("");
  if (!options.quiet) {
    fmt::print("{}: {} steps, {:.3g} s simulated in {:.1f} s ({:.1f} s stepping, {:.1f} million particle-steps per second)\n",
               status, simulation->steps(), simulation->time(), seconds_since(begin), stepping,
               summary.particle_steps_per_second * 1e-6);
    for (const auto& path : writer.written()) fmt::print("  {}\n", path.string());
  }
  return interrupted ? 130 : 0;
}

}  // namespace cleave::app
