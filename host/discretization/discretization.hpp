#pragma once

#include "discretization/elastic_response.hpp"
#include "discretization/surroundings.hpp"
#include "mpm/simulation.hpp"
#include "output/frame.hpp"
#include "plugins/registry.hpp"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cleave::discretization {

/// The bodies of one material, stepped as a whole by a plugin. In a frame they have the fields of the plugin as attributes and
/// its surfaces as meshes. In a record minimum_J > maximum_J if no body has F.
class Discretization final : public mpm::Simulation {
 public:
  /// Hands the bodies to an instance of the material's plugin. `first_particle` is the number of their first point in the
  /// scene. Throws InputError if it refuses one.
  Discretization(const config::Scene&, const config::Material&, std::vector<mpm::SampledBody>, plugins::Registry&,
                 std::int64_t first_particle);

  mpm::Bound largest_step() override;
  std::int64_t particles() const override { return std::int64_t(points_); }
  const std::vector<std::size_t>& held() const override { return surroundings_.held(); }

  std::vector<std::string> attributes() const override;
  bool has_surfaces() const override;
  output::ParticleFrame frame(int index) const override;
  std::vector<mpm::ParticleState> state() const override;
  output::FrameRecord measure() override;

  std::vector<std::pair<std::string, double>> stage_seconds() const override { return {{"discretization", seconds_}}; }
  std::vector<std::pair<std::string, std::int64_t>> integrators() const override { return {}; }
  std::vector<std::pair<std::string, double>> bytes_per_particle() const override;
  std::vector<output::PluginRecord> plugins() const override;
  const char* isa() const override { return "none"; }
  const std::string& failed_batch() const override { return failed_batch_; }
  std::vector<std::string> not_saved() const override { return {}; }

 private:
  struct Field {
    std::string unit;
    int components;
    const double* values;
  };
  struct Body {
    std::string name;
    std::vector<double> volumes;                  ///< at rest, m^3 (2D: m^2)
    std::unique_ptr<ElasticResponse> elasticity;  ///< null without an elastic law
  };

  void advance(double time_step) override;
  void save_state(checkpoint::StateWriter&, const std::string& prefix) const override;
  void restore_state(checkpoint::StateReader&, const std::string& prefix) override;

  void add(const config::Material&, mpm::SampledBody&);
  double stable_step() const;
  std::uint64_t saved_bytes() const;
  /// Fields of a body by name. Throws SimulationError if position or velocity is not among them or one has no such shape.
  std::map<std::string, Field> fields(std::size_t body) const;
  /// Empty if the body has no surface. Throws SimulationError if it is not what a surface has to be.
  std::optional<cleave_surface> surface(std::size_t body) const;
  output::BodyMesh mesh(std::size_t body, const cleave_surface&) const;
  [[noreturn]] void fail(const std::string& what) const;
  /// Calls a function that may fail, and says when.
  template <class Call>
  void in_step(const Call& call, const std::string& when) const;

  std::string material_;
  double density_;
  config::Simulation settings_;
  config::Output output_;
  plugins::Instance elasticity_;  // without a handle if the material has none
  std::vector<Body> bodies_;
  std::size_t points_ = 0;
  Surroundings surroundings_;
  plugins::Instance instance_;
  double seconds_ = 0;
  std::int64_t first_particle_;
  std::string failed_batch_;
};

}  // namespace cleave::discretization
