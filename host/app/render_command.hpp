#pragma once

#include "config/scene.hpp"
#include "plugins/registry.hpp"
#include "render/painter.hpp"

#include <filesystem>
#include <optional>
#include <string>

namespace CLI {
class App;
}

namespace cleave::app {

struct RenderOptions {
  std::filesystem::path run;  ///< directory that `cleave run` has filled
  std::filesystem::path out;  ///< empty: RUN_DIR/pictures
  std::string frames, range, size, view = "three-quarter", palette = "auto", fit = "run";
  std::string color;
  double zoom = 1;
  int samples = 3, every = 1, threads = 0;
  bool points = false, surface = false, material_space = false, no_colliders = false, no_labels = false;
  bool sheet = false, gif = false, mp4 = false, quiet = false;
};

void add_render_options(CLI::App&, RenderOptions&);

/// `cleave render`. Returns the exit status. Throws InputError.
int render_command(const RenderOptions&, const plugins::Registry&);

/// What pictures of a scene show beside its bodies.
render::Surroundings surroundings_of(const config::Scene&);

/// Pictures of a run that is going on: of every so manieth frame one in the directory's folder preview, of frames as they come.
class Preview {
 public:
  /// `resumed`: beside the pictures there are.
  Preview(const config::Scene&, std::filesystem::path run, int every, bool resumed);
  void frame(const output::ParticleFrame&);

 private:
  render::Surroundings surroundings_;
  std::filesystem::path folder_;
  int every_;
  std::optional<render::Painter> painter_;
};

}  // namespace cleave::app
