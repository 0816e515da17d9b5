#pragma once

#include "config/scene.hpp"
#include "output/frame.hpp"
#include "render/camera.hpp"
#include "render/image.hpp"
#include "render/stage.hpp"

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace cleave::render {

enum class Palette { automatic, viridis, heat };

/// How pictures look.
struct Look {
  int width = 1280, height = 720;
  View view;
  double zoom = 1;
  bool points = false;          ///< particles as balls, no surfaces
  bool material_space = false;  ///< particles where they were at rest
  bool colliders = true;
  bool labels = true;  ///< time and colour bar
  int samples = 3;     ///< rays along either side of a pixel
  /// "body", "piece", "velocity" (its length) or an attribute: its value, the length of a vector, the Frobenius norm of a
  /// tensor.
  std::string color = "body";
  std::optional<std::pair<double, double>> range;  ///< of values; empty: those of the frames surveyed
  Palette palette = Palette::automatic;            ///< heat for damage, viridis for all else
};

/// What pictures show of the scene beside its bodies.
struct Surroundings {
  int dimension = 3, up_axis = 1;
  std::vector<config::Collider> colliders;
};

/// Colour of a number in [0, 1], darker with each step: viridis, and from cream to dark red the scheme "OrRd" with nine classes
/// of ColorBrewer (C. Brewer, M. Harrower; Apache 2.0). Grey for NaN.
Color palette_color(Palette, double);

/// What shows most of such a frame: damage if there is any, else bodies.
std::string default_color(const output::ParticleFrame&);
/// Whether frames have to be read with this attribute to be painted.
bool is_needed(const Look&, const std::string& attribute);

/// Paints frames of one run, all from one place and with one scale of colours.
class Painter {
 public:
  Painter(Look, Surroundings);
  ~Painter();

  /// Lets the pictures hold this frame, and its values: without the outermost half per cent of particles on each side, as
  /// debris may fly far.
  void survey(const output::ParticleFrame&);
  /// Lets them hold this one alone; the scale of colours stays.
  void follow(const output::ParticleFrame&);
  /// Where particles are at rest, for pictures in material space.
  void rest(const output::ParticleFrame&);

  Image paint(const output::ParticleFrame&);

  const Box& bounds() const { return bounds_; }
  std::pair<double, double> range() const;

 private:
  Camera camera() const;
  Color color_of(double value) const;
  std::vector<float> values(const output::ParticleFrame&) const;
  void add_body(const output::ParticleFrame&, std::size_t body, const std::vector<float>& values, Stage&);
  void add_mesh(const output::ParticleFrame&, const output::BodyMesh&, const std::vector<float>& values, Stage&) const;
  void add_colliders(double time, Stage&);
  void label(Image&, const output::ParticleFrame&) const;
  Box box_of(const output::ParticleFrame&) const;

  Look look_;
  Surroundings surroundings_;
  Box bounds_;
  double least_, most_;
  std::string unit_;
  std::optional<output::ParticleFrame> rest_;
  std::vector<Triangles> rest_surfaces_;
  std::vector<std::unique_ptr<scene::SignedDistance>> shapes_;
  std::map<std::size_t, Triangles> resting_;  ///< colliders that do not move, as seen within `resting_in_`
  Box resting_in_;
};

/// The part of a shape at a pose that lies in the box, as triangles; empty if there is none.
Triangles collider_surface(const scene::SignedDistance&, const scene::RigidMotion::Pose&, const Box&);

}  // namespace cleave::render
