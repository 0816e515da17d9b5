#include "app/render_command.hpp"

#include "common/error.hpp"
#include "common/nearest.hpp"
#include "output/atomic_file.hpp"
#include "render/image.hpp"
#include "render/movie.hpp"
#include "render/run_frames.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <CLI/CLI.hpp>

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <set>

namespace cleave::app {
namespace {

namespace fs = std::filesystem;

/// Two numbers with a sign between them; an empty one is what it was.
template <class T>
bool read_pair(const std::string& text, char sign, T& first, T& second) {
  const std::size_t at = text.find(sign);
  if (at == std::string::npos) return false;
  const auto read = [](const char* begin, const char* end, T& value) {
    if (begin == end) return true;
    const auto [rest, error] = std::from_chars(begin, end, value);
    return error == std::errc() && rest == end;
  };
  return read(text.data(), text.data() + at, first) && read(text.data() + at + 1, text.data() + text.size(), second);
}

/// The asked ones of the frames there are.
std::vector<int> chosen(const std::vector<int>& there, const RenderOptions& options) {
  int first = there.front(), last = there.back();
  if (!options.frames.empty()) {
    const auto [rest, error] = std::from_chars(options.frames.data(), options.frames.data() + options.frames.size(), first);
    if (error == std::errc() && rest == options.frames.data() + options.frames.size())
      last = first;
    else if (first = there.front(); !read_pair(options.frames, ':', first, last) || first < 0 || last < first)
      throw InputError("error: --frames " + options.frames +
                       ": expected a number, or the first and the last as in 10:20, 10: or :20");
  }
  std::vector<int> result;
  for (const int index : there)
    if (index >= first && index <= last && (index - first) % options.every == 0) result.push_back(index);
  if (result.empty())
    throw InputError(fmt::format("error: --frames {}: there are frames {} to {}", options.frames, there.front(), there.back()));
  return result;
}

render::Look look_of(const RenderOptions& options) {
  render::Look look;
  look.view = render::parse_view(options.view);
  look.zoom = options.zoom;
  look.points = options.points;
  look.material_space = options.material_space;
  look.colliders = !options.no_colliders;
  look.labels = !options.no_labels;
  look.samples = options.samples;
  look.palette = options.palette == "viridis" ? render::Palette::viridis
                 : options.palette == "heat"  ? render::Palette::heat
                                              : render::Palette::automatic;
  look.color = options.color == "speed" ? "velocity" : options.color;
  if (!options.size.empty() && (!read_pair(options.size, 'x', look.width, look.height) || look.width < 64 || look.height < 64 ||
                                look.width > 8192 || look.height > 8192))
    throw InputError("error: --size " + options.size + ": expected width and height from 64 to 8192, such as 1280x720");
  if (!options.range.empty()) {
    std::pair<double, double> range{std::nan(""), std::nan("")};
    if (!read_pair(options.range, ':', range.first, range.second) || !(range.first < range.second))
      throw InputError("error: --range " + options.range +
                       ": expected the values of the first and the last colour, such as 0:2.5");
    look.range = range;
  }
  return look;
}

struct Known {
  render::Surroundings surroundings;
  double frame_rate = 24;
};

/// Of the scene that the run left beside its frames. Pictures can do without.
Known read_scene(const fs::path& run, const plugins::Registry& registry) {
  const fs::path file = run / "scene.toml";
  try {
    const config::Scene scene = config::load_scene(file, {}, registry);
    return {surroundings_of(scene), scene.simulation.frame_rate};
  } catch (const InputError& e) {
    fmt::print(stderr, "warning: colliders are not drawn, y is taken to be up: {}\n", e.what());
    return {};
  }
}

std::string picture_name(int index) { return fmt::format("frame_{:04d}.png", index); }

/// Of an earlier call: a film would have them too.
void remove_pictures(const fs::path& folder) {
  std::vector<fs::path> old;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.starts_with("frame_") && name.ends_with(".png")) old.push_back(entry->path());
  }
  for (const fs::path& path : old) fs::remove(path, error);
}

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error || !fs::is_directory(folder)) output::throw_file_error("create directory", folder, error ? error.value() : ENOTDIR);
}

}  // namespace

void add_render_options(CLI::App& cli, RenderOptions& options) {
  cli.add_option("run", options.run, "Directory that cleave run has filled")->required()->type_name("RUN_DIR");
  cli.add_option("--out", options.out, "Directory for the pictures (default: RUN_DIR/pictures)");
  cli.add_option("--frames", options.frames, "A frame, or the first and the last: 40, 10:20, 10: (default: all)")
      ->type_name("A:B");
  cli.add_option("--every", options.every, "Draw only every so manieth of them")->check(CLI::Range(1, 1000000));
  cli.add_option(
      "--color", options.color,
      "body, piece, velocity, or any attribute of the frames (default: damage if there is any in the last frame, else body)");
  cli.add_option("--range", options.range, "Values of the first and the last colour (default: those that occur)")
      ->type_name("LOW:HIGH");
  cli.add_option("--palette", options.palette, "viridis, or heat (default for damage)")
      ->check(CLI::IsMember({"auto", "viridis", "heat"}));
  cli.add_option("--view", options.view,
                 "front, back, left, right, side, top, bottom, three-quarter (default), or azimuth:elevation in degrees");
  cli.add_option("--zoom", options.zoom, "Larger than what fits")->check(CLI::Range(0.01, 1000.0));
  cli.add_option("--fit", options.fit, "What the picture holds: all frames of the run, or each its own frame")
      ->check(CLI::IsMember({"run", "frame"}));
  cli.add_option("--size", options.size, "Width and height in pixels (default: 1280x720)")->type_name("WxH");
  cli.add_option("--samples", options.samples, "Rays along either side of a pixel")->check(CLI::Range(1, 16));
  auto* surface = cli.add_flag("--surface", options.surface, "Draw the surfaces of bodies (default in 3D)");
  auto* points = cli.add_flag("--points", options.points, "Draw particles as balls")->excludes(surface);
  cli.add_flag("--material-space", options.material_space, "Draw damaged particles where they were at rest")
      ->excludes(surface)
      ->excludes(points);
  cli.add_flag("--no-colliders", options.no_colliders, "Leave colliders and the floor out");
  cli.add_flag("--no-labels", options.no_labels, "Leave time and colour bar out");
  cli.add_flag("--sheet", options.sheet, "Also sheet.png with all pictures, small (at most 25)");
  cli.add_flag("--gif", options.gif, "Also movie.gif (needs ffmpeg)");
  cli.add_flag("--mp4", options.mp4, "Also movie.mp4 (needs ffmpeg)");
  cli.add_option("--threads", options.threads, "Number of threads (default: all)")->check(CLI::Range(1, 1024));
  cli.add_flag("--quiet", options.quiet, "Print nothing but errors");
}

render::Surroundings surroundings_of(const config::Scene& scene) {
  const Vector3 gravity = scene.simulation.gravity.cwiseAbs();
  const int up = scene.simulation.dimension == 3 && gravity.z() > gravity.y() ? 2 : 1;
  return {scene.simulation.dimension, up, scene.colliders};
}

int render_command(const RenderOptions& options, const plugins::Registry& registry) {
  render::Look look = look_of(options);
  if ((options.gif || options.mp4) && !render::ffmpeg_is_installed())
    throw InputError("error: --gif and --mp4 need the program ffmpeg, which is not in PATH (Debian: apt-get install ffmpeg)");
  const render::RunFrames frames(options.run);
  const std::vector<int> indices = chosen(frames.indices(), options);
  const Known scene = read_scene(options.run, registry);
  const int threads = options.threads > 0 ? options.threads : tbb::info::default_concurrency();
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(threads));

  const std::set<std::string> attributes = frames.attribute_names(indices.back());
  const auto load = [&](int index) {
    return frames.load(
        index, [&](const std::string& name) { return render::is_needed(look, name); }, scene.surroundings.dimension);
  };
  if (look.color.empty()) look.color = render::default_color(load(indices.back()));
  if (const std::set<std::string> always = {"body", "velocity"};
      !always.contains(look.color) && !attributes.contains(look.color)) {
    std::set<std::string> there = attributes;
    there.insert(always.begin(), always.end());
    const auto meant = nearest(look.color, {there.begin(), there.end()});
    throw InputError(fmt::format(
        "error: --color {}: frames do not have it; there are {}. {}", look.color, fmt::join(there, ", "),
        meant ? "Did you mean " + *meant + "?"
              : fmt::format(
                    "What a run writes is chosen by output.attributes, as in --set 'output.attributes=[\"damage\", \"{}\"]'",
                    look.color)));
  }

  render::Painter painter(look, scene.surroundings);
  if (look.material_space) painter.rest(load(frames.indices().front()));
  const std::size_t survey_stride = std::max<std::size_t>(1, indices.size() / 24);
  for (std::size_t n = 0; n < indices.size(); n++)
    if (n % survey_stride == 0 || n + 1 == indices.size()) painter.survey(load(indices[n]));

  const fs::path folder = options.out.empty() ? options.run / "pictures" : options.out;
  make_folder(folder);
  remove_pictures(folder);
  std::vector<render::Image> small;
  const std::size_t sheet_stride = (indices.size() + 24) / 25;
  const auto begin = std::chrono::steady_clock::now();
  for (std::size_t n = 0; n < indices.size(); n++) {
    const output::ParticleFrame frame = load(indices[n]);
    if (options.fit == "frame") painter.follow(frame);
    const render::Image image = painter.paint(frame);
    render::write_png(folder / picture_name(indices[n]), image);
    if (options.sheet && n % sheet_stride == 0) {
      const int width = std::min(320, look.width);
      small.push_back(render::shrunk(image, width, std::max(1, int(std::lround(double(width) * look.height / look.width)))));
    }
    if (!options.quiet && isatty(STDERR_FILENO)) fmt::print(stderr, "\r{} of {} pictures", n + 1, indices.size());
  }
  if (!options.quiet && isatty(STDERR_FILENO)) fmt::print(stderr, "\r");
  std::vector<fs::path> written{folder};
  if (options.sheet) {
    written.push_back(folder / "sheet.png");
    render::write_png(written.back(), render::contact_sheet(small, small.front().width));
  }
  for (const auto& [asked, name] : {std::pair(options.gif, "movie.gif"), std::pair(options.mp4, "movie.mp4")}) {
    if (!asked) continue;
    written.push_back(folder / name);
    render::make_movie(folder, written.back(), std::clamp(scene.frame_rate / options.every, 1.0, 30.0));
  }
  if (!options.quiet) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    fmt::print("{} picture{} of {} in {:.1f} s, coloured by {}\n", indices.size(), indices.size() == 1 ? "" : "s",
               options.run.string(), seconds, look.color);
    for (const fs::path& path : written) fmt::print("  {}\n", path.string());
  }
  return 0;
}

Preview::Preview(const config::Scene& scene, fs::path run, int every, bool resumed)
    : surroundings_(surroundings_of(scene)), folder_(std::move(run) / "preview"), every_(every) {
  make_folder(folder_);
  if (!resumed) remove_pictures(folder_);
}

void Preview::frame(const output::ParticleFrame& frame) {
  if (frame.index % every_ != 0) return;
  if (!painter_) {
    render::Look look;
    look.width = 640;
    look.height = 360;
    look.samples = 2;
    look.color = std::any_of(frame.attributes.begin(), frame.attributes.end(), [](const auto& a) { return a.name == "damage"; })
                     ? "damage"
                     : "body";
    painter_.emplace(look, surroundings_);
  }
  painter_->survey(frame);
  render::write_png(folder_ / picture_name(frame.index), painter_->paint(frame));
}

}  // namespace cleave::app
