#pragma once

#include "config/scene.hpp"
#include "output/frame.hpp"
#include "plugins/registry.hpp"

#include <cstdint>
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

/// A scene in motion.
class Simulation {
 public:
  virtual ~Simulation() = default;

  /// Loads the scene's plugins, samples its bodies and composes its materials. Throws InputError.
  static std::unique_ptr<Simulation> create(const config::Scene&, plugins::Registry&);

  /// One step of the largest stable size, or less so that a whole number of equal steps ends at `target` (s).
  /// Throws SimulationError naming step, time, particle, body and plugin; the state then is the one that failed.
  virtual void step(double target) = 0;

  virtual double time() const = 0;
  virtual std::int64_t steps() const = 0;
  virtual std::int64_t particles() const = 0;

  /// All particles by id, with the attributes the scene asks for.
  virtual output::ParticleFrame frame(int index) const = 0;
  /// All particles by id.
  virtual std::vector<ParticleState> state() const = 0;
  /// Energies, momenta and bounds of the present state; step counts are since the last call.
  virtual output::FrameRecord measure() = 0;

  virtual std::vector<std::pair<std::string, double>> stage_seconds() const = 0;
  virtual std::vector<std::pair<std::string, std::int64_t>> limits() const = 0;  ///< steps that each bound set
  /// Bytes per particle: what is stored for each material and why, then index and grid; "total" last.
  virtual std::vector<std::pair<std::string, double>> bytes_per_particle() const = 0;
  virtual std::vector<output::PluginRecord> plugins() const = 0;
  virtual const char* isa() const = 0;
  /// After a step that failed: the points of the law that failed, as the JSON of write_batch; empty if none did.
  virtual const std::string& failed_batch() const = 0;
};

}  // namespace cleave::mpm
