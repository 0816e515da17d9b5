#include "app/run_command.hpp"

#include "app/render_command.hpp"
#include "app/resume.hpp"
#include "app/run_pieces.hpp"
#include "checkpoint/run_directory.hpp"
#include "common/error.hpp"
#include "common/interrupts.hpp"
#include "config/scene.hpp"
#include "discretization/simulation.hpp"
#include "mpm/law_watch.hpp"
#include "output/background.hpp"
#include "output/color.hpp"
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
    signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error like a full disk
  }
  Interrupts interrupts{&on_interrupt};
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

output::Playback playback_of(const config::Simulation& simulation) {
  const Vector3 g = simulation.gravity.cwiseAbs();
  return {simulation.frame_rate, simulation.dimension == 3 && g.z() > g.y() ? 2 : 1};
}

}  // namespace

int run_command(const RunOptions& options, plugins::Registry& registry) {
  using Clock = std::chrono::steady_clock;
  const InterruptGuard guard;  // from the start: a run stopped while it samples its bodies ends in order, too
  std::vector<config::Override> overrides;
  for (const auto& s : options.sets) overrides.push_back(config::parse_override(s));
  std::vector<std::string> warnings;
  const bool of_directory = options.resume && (options.scene.empty() || std::filesystem::is_directory(options.scene));
  const std::filesystem::path given = !of_directory ? options.scene : options.scene.empty() ? options.out : options.scene;
  const config::Scene scene = config::load_scene(of_directory ? given / "scene.toml" : given, overrides, registry, &warnings);
  for (const auto& w : warnings) fmt::print(stderr, "{}\n", w);

  const int threads = options.threads > 0 ? options.threads : tbb::info::default_concurrency();
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(threads));

  const auto begin = Clock::now();
  const auto seconds_since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };
  const std::filesystem::path out = !options.out.empty() ? options.out
                                    : of_directory       ? given
                                                         : std::filesystem::path("out") / given.stem();
  const checkpoint::RunCheckpoints checkpoints(out);
  const config::CheckpointTimes& checkpoint_times = scene.output.checkpoint;
  checkpoint::Run run;
  if (options.resume || checkpoint_times.any()) run = describe_run(config::to_toml(scene, registry), threads);
  auto start = options.resume ? find_start(checkpoints, out, run) : std::nullopt;
  RunPieces pieces(scene);
  auto simulation = discretization::simulate(pieces.scene(), registry);
  pieces.rest(*simulation);
  if (start || checkpoint_times.any()) add_program(run, *simulation);
  if (start) {
    compare_programs(*start, run, options.resume_anyway);
    simulation->restore(start->state());
    pieces.restore(start->state());
    for (const auto& what : simulation->not_saved())
      fmt::print(stderr, "warning: {}: the run goes on within its tolerance, not to the bit\n", what);
  } else {
    checkpoints.clear();
  }
  const bool resumed = bool(start);
  const checkpoint::Run before = resumed ? start->run : checkpoint::Run();
  const std::filesystem::path resumed_from = resumed ? start->file : std::filesystem::path();
  start.reset();
  if (before.time > scene.simulation.end_time * (1 + 1e-9))
    throw InputError(fmt::format("error: {} is of t = {:.6g} s, simulation.end_time is {:.6g} s", resumed_from.string(),
                                 before.time, scene.simulation.end_time));
  const output::EarlierPart earlier{before.frames, before.table};
  std::optional<std::vector<std::string>> meshes;
  if (simulation->has_surfaces()) meshes = scene.output.meshes.value_or(std::vector<std::string>{"ply"});
  const output::Playback playback = playback_of(scene.simulation);
  output::Writer writer(out, scene.output.formats, scene.output.surface, resumed ? &earlier : nullptr, meshes, pieces.any(),
                        playback);
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
    if (resumed)
      fmt::print("resumed at step {}, t = {:.6g} s, from {}\n", simulation->steps(), simulation->time(), resumed_from.string());
    else if (options.resume)
      fmt::print("there is no checkpoint in {} yet: from the beginning\n", out.string());
    std::fflush(stdout);
  }

  const auto& sim = scene.simulation;
  auto last_frame = int(std::ceil(sim.end_time * sim.frame_rate - 1e-6));
  const double end_time = options.frames ? std::min(sim.end_time, *options.frames / sim.frame_rate) : sim.end_time;
  if (options.frames) last_frame = std::min(last_frame, *options.frames);

  output::Summary summary;
  summary.scene = std::filesystem::absolute(scene.file).string();
  summary.particles = simulation->particles();
  summary.threads = threads;
  summary.precision = single ? "single" : "double";
  summary.isa = simulation->isa();
  summary.version = CLEAVE_VERSION;
  summary.plugins = simulation->plugins();
  summary.bytes_per_particle = simulation->bytes_per_particle();

  output::Progress progress(end_time, simulation->particles(),
                            options.quiet ? output::Progress::Mode::quiet : output::Progress::mode_for(2));
  if (resumed) progress.start(simulation->time(), simulation->steps());
  const mpm::CrashDump crash_dump(out / "failed_batch.json");
  // Half of the threads at most: the others step. A single one cannot do both at once.
  const auto wall_seconds = [&] { return before.wall_seconds + seconds_since(begin); };
  std::optional<Preview> preview;
  if (options.preview > 0) preview.emplace(scene, out, options.preview, resumed);
  output::BackgroundWriter frames(writer, threads / 2, wall_seconds);
  if (preview) frames.also([&](const output::ParticleFrame& frame) { preview->frame(frame); });
  double stepping = before.stepping_seconds, output_wait = before.output_seconds, saving = 0;
  int frames_taken = before.frames;
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
    auto frame = simulation->frame(index);
    frame.playback = playback;
    pieces.find(frame, record);
    if (const auto& color = scene.output.color) output::color(frame, {color->by, color->range});
    progress.frame(record);
    frames.write(std::move(frame), std::move(record));
    frames_taken++;
    output_wait += seconds_since(t);
  };
  const auto write_summary = [&](const char* status) {
    summary.status = status;
    summary.steps = simulation->steps();
    summary.frames = before.frames + frames.frames();
    summary.simulated_seconds = simulation->time();
    summary.wall_seconds = wall_seconds();
    summary.particle_steps_per_second =
        stepping > 0 ? double(simulation->particles()) * double(simulation->steps()) / stepping : 0;
    summary.stage_seconds = simulation->stage_seconds();
    summary.stage_seconds.emplace_back("output", output_wait);
    if (saving > 0) summary.stage_seconds.emplace_back("checkpoints", saving);
    if (frames.seconds() > 0) summary.stage_seconds.emplace_back("output in the background", frames.seconds());
    summary.limits = simulation->limits();
    summary.integrators = simulation->integrators();
    writer.summary(summary);
  };

  struct Saved {
    std::int64_t steps = -1;
    int frames = 0;
    std::string file;
  } saved;
  if (resumed) saved = {before.steps, before.frames, resumed_from.string()};
  auto saved_at = Clock::now();
  /// A checkpoint that cannot be written is no reason to end a run.
  const auto save = [&] {
    if (!checkpoint_times.any() || (saved.steps == simulation->steps() && saved.frames == frames_taken)) return;
    const auto t = Clock::now();
    std::exception_ptr frames_failed;
    try {
      const auto file = checkpoints.save(
          simulation->steps(),
          [&](checkpoint::StateWriter& state) {
            simulation->save(state);
            pieces.save(state);
          },
          [&] {
            try {
              wait_for_frames();
              run.table = writer.table();
            } catch (...) {
              frames_failed = std::current_exception();
              throw;
            }
            run.frames = frames_taken;
            run.steps = simulation->steps();
            run.time = simulation->time();
            run.wall_seconds = wall_seconds();
            run.stepping_seconds = stepping;
            run.output_seconds = output_wait;
            return run;
          });
      saved = {simulation->steps(), frames_taken, file.string()};
    } catch (const InputError& e) {
      if (frames_failed) throw;
      progress.finish("");
      fmt::print(stderr, "warning: there is no checkpoint of step {}: {}\n", simulation->steps(), e.what());
    }
    saving += seconds_since(t);
    saved_at = Clock::now();
  };
  /// The end of the steps to a frame.
  const auto target_of = [&](int frame) {
    return frame == last_frame && !options.frames ? sim.end_time : std::min(frame / sim.frame_rate, sim.end_time);
  };
  /// Steps from the last checkpoint to the state from which a step failed have the same bits again.
  const auto keep_last_good_state = [&] {
    const std::int64_t failed = simulation->steps();
    const auto pass_frame = [&](int index) {  // what a frame leaves behind
      auto record = simulation->measure();
      if (!pieces.any()) return;
      auto frame = simulation->frame(index);
      pieces.find(frame, record);
    };
    fmt::print(stderr, "stepping to the state before, from {}\n", saved.file.empty() ? "the beginning" : saved.file);
    try {
      simulation.reset();
      simulation = discretization::simulate(pieces.scene(), registry);
      pieces.rest(*simulation);
      const int frames_complete = before.frames + frames.frames();
      frames_taken = std::min(saved.frames, frames_complete);
      if (!saved.file.empty()) {
        std::vector<std::string> problems;
        auto last = checkpoints.newest(problems);
        if (!last || last->file != saved.file) throw InputError(fmt::format("{}", fmt::join(problems, "\n")));
        simulation->restore(last->state());
        pieces.restore(last->state());
      } else {
        pass_frame(0);
        frames_taken = 1;
      }
      while (simulation->steps() < failed && !interrupted) {
        simulation->step(target_of(frames_taken));
        if (simulation->time() < target_of(frames_taken)) continue;
        pass_frame(frames_taken);
        frames_taken++;
      }
      save();
      fmt::print(stderr, "{} is in {}\n", interrupted ? "what was reached" : "the state before the step that failed",
                 saved.file);
    } catch (const std::runtime_error& e) {
      fmt::print(stderr, "warning: it could not be reached: {}\n", e.what());
    }
  };
  const auto enough_steps = [&] { return options.steps && simulation->steps() >= *options.steps; };

  const char* status = "done";
  bool early = false;
  try {
    if (frames_taken == 0) take_frame(0);
    for (int f = frames_taken; f <= last_frame && !interrupted; f++) {
      const double due = f / sim.frame_rate, target = target_of(f);
      while (simulation->time() < target && !interrupted && !enough_steps()) {
        const auto t = Clock::now();
        simulation->step(target);
        stepping += seconds_since(t);
        frames.check();
        progress.step(simulation->time(), simulation->steps(), f);
        if (checkpoint_times.seconds > 0 && seconds_since(saved_at) >= checkpoint_times.seconds && simulation->time() < target)
          save();
      }
      if (interrupted) break;
      early = simulation->time() < due * (1 - 1e-6);
      if (early) save();  // where the run goes on this frame is written again, at its time
      take_frame(f);
      if (checkpoint_times.frames > 0 && f % checkpoint_times.frames == 0) save();
      if (checkpoint_times.seconds > 0 && seconds_since(saved_at) >= checkpoint_times.seconds) save();
      if (enough_steps()) break;
    }
    if (interrupted) {
      status = "interrupted";
      save();
      take_frame(frames_taken);
    } else if (!early) {
      save();
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
    if (checkpoint_times.any()) keep_last_good_state();
    return 3;
  }
  write_summary(status);
  progress.finish("");
  if (!options.quiet) {
    fmt::print("{}: {} steps, {:.3g} s simulated in {:.1f} s ({:.1f} s stepping, {:.1f} million particle-steps per second)\n",
               status, simulation->steps(), simulation->time(), seconds_since(begin), stepping,
               summary.particle_steps_per_second * 1e-6);
    for (const auto& path : writer.written()) fmt::print("  {}\n", path.string());
    if (preview) fmt::print("  {}\n", (out / "preview").string());
  }
  return interrupted ? 130 : 0;
}

}  // namespace cleave::app
