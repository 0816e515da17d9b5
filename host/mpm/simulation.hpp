#pragma once

#include "checkpoint/state.hpp"
#include "config/scene.hpp"
#include "mpm/time_step.hpp"
#include "output/frame.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace cleave::mpm {

/// Everything that is stored of one particle, in full precision.
struct ParticleState {
  std::int64_t id = 0;
  std::int32_t body = 0;
  Vector3 position = Vector3::Zero();           ///< m
  Vector3 velocity = Vector3::Zero();           ///< m/s
  Matrix3 velocity_gradient = Matrix3::Zero();  ///< the affine field C of APIC, 1/s
  double volume = 0;                            ///< at rest, m^3 (2D: m^2)
  bool stores_b = false;
  Matrix3 strain = Matrix3::Identity();  ///< elastic b or F, as stored
  double damage = 0;                     ///< d in [0,1]
  std::vector<double> state;             ///< components of the state variables
};

/// A scene in motion. Frames end at instants that a whole number of equal steps reaches; what the steps are, and how large they
/// may be, is the implementation's: the material point method here, several methods side by side in host/discretization.
class Simulation {
 public:
  virtual ~Simulation() = default;

  /// Loads the scene's plugins, samples its bodies and composes its materials; all of them are the material point method's.
  /// Throws InputError.
  static std::unique_ptr<Simulation> create(const config::Scene&, plugins::Registry&);
  /// The same for a part of a scene: its handles may hold none of these particles.
  static std::unique_ptr<Simulation> create_part(const config::Scene&, plugins::Registry&);

  /// One step of the largest stable size, or less so that a whole number of equal steps ends at `target` (s).
  /// Throws SimulationError naming step, time, particle, body and plugin; the state then is the one that failed.
  void step(double target);
  /// The two halves of step(), for parts of a scene that take their steps together: the largest step from the present state
  /// and what bounds it, then one step that is not larger; `end` is the time after it.
  virtual Bound largest_step() = 0;
  void take_step(double time_step, double end);

  /// Everything that later steps, frames and records hang on, between two steps. Nothing is changed by saving: a simulation
  /// that is restored goes on with the bits of the one that was saved, and so does that one. Sections are named "<prefix>...".
  void save(checkpoint::StateWriter&, const std::string& prefix = "") const;
  /// Into a simulation of the same scene, at its start or anywhere else. Throws InputError if the state is of another one; this
  /// one is then not to be used any more.
  void restore(checkpoint::StateReader&, const std::string& prefix = "");
  /// What a restored simulation goes on without, as a text for the user each: the bits are then not the same.
  virtual std::vector<std::string> not_saved() const = 0;

  double time() const { return time_; }
  std::int64_t steps() const { return steps_; }
  virtual std::int64_t particles() const = 0;
  /// How many particles each handle of the scene holds.
  virtual const std::vector<std::size_t>& held() const = 0;

  /// Names of what the attributes of a frame can be.
  virtual std::vector<std::string> attributes() const = 0;
  /// Whether bodies have surfaces, which frames hold beside the particles.
  virtual bool has_surfaces() const { return false; }
  /// All particles by id, with the attributes the scene asks for.
  virtual output::ParticleFrame frame(int index) const = 0;
  /// All particles by id.
  virtual std::vector<ParticleState> state() const = 0;
  /// Energies, momenta and bounds of the present state; step counts are since the last call.
  virtual output::FrameRecord measure() = 0;

  virtual std::vector<std::pair<std::string, double>> stage_seconds() const = 0;
  std::vector<std::pair<std::string, std::int64_t>> limits() const {  ///< steps that each bound set
    return {limits_.begin(), limits_.end()};
  }
  /// Steps that each integrator has taken; none where the material point method has no body.
  virtual std::vector<std::pair<std::string, std::int64_t>> integrators() const = 0;
  /// Bytes per particle: what is stored for each material and why, then index and grid; "total" last.
  virtual std::vector<std::pair<std::string, double>> bytes_per_particle() const = 0;
  virtual std::vector<output::PluginRecord> plugins() const = 0;
  virtual const char* isa() const = 0;
  /// After a step that failed: the points of the law that failed, as the JSON of write_batch; empty if none did.
  virtual const std::string& failed_batch() const = 0;

 protected:
  virtual void advance(double time_step) = 0;
  virtual void save_state(checkpoint::StateWriter&, const std::string& prefix) const = 0;
  virtual void restore_state(checkpoint::StateReader&, const std::string& prefix) = 0;
  /// Time, last step and what bounded it, and the number of steps since the last call.
  void record_steps(output::FrameRecord&);

  double time_ = 0, time_step_ = 0;
  std::int64_t steps_ = 0;

 private:
  /// What saving and restoring share.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.time_, self.time_step_, self.steps_, self.limited_by_, self.steps_at_record_, self.limits_,
            self.smallest_bound_);
  }

  std::string limited_by_;
  std::int64_t steps_at_record_ = 0;
  double smallest_bound_ = std::numeric_limits<double>::infinity();  ///< since the last record, s
  std::map<std::string, std::int64_t> limits_;
};

/// Throws InputError if a handle of the scene holds no particle.
void check_handles(const config::Scene&, const std::vector<std::size_t>& held);

}  // namespace cleave::mpm
