#pragma once

#include "checkpoint/state.hpp"
#include "config/scene.hpp"
#include "mpm/simulation.hpp"
#include "output/frame.hpp"
#include "output/pieces.hpp"

#include <optional>

namespace cleave::app {

/// The pieces of the bodies that the material point method moves, for the frames of a run. There are none without a damage law,
/// unless output.attributes asks for "piece".
class RunPieces {
 public:
  explicit RunPieces(const config::Scene&);

  /// The scene to simulate: its frames have the damage that pieces are found by.
  const config::Scene& scene() const { return scene_; }
  /// Bodies at rest; to be called before what follows, and again for a run that starts over.
  void rest(const mpm::Simulation&);
  /// Finds the pieces and writes them where they are asked for.
  void find(output::ParticleFrame&, output::FrameRecord&);
  /// What the numbers of later frames hang on.
  void save(checkpoint::StateWriter&) const;
  /// Numbers start from 0 if the state has none.
  void restore(checkpoint::StateReader&);
  bool any() const { return any_; }  ///< then frames.csv has columns for them

 private:
  config::Scene scene_;
  std::vector<bool> counted_;  ///< of each body of the frames
  bool any_ = false, as_attribute_ = false, keeps_damage_ = true;
  std::optional<output::Pieces> pieces_;
};

}  // namespace cleave::app
