#pragma once

#include "discretization/elastic_response.hpp"
#include "discretization/surroundings.hpp"
#include "mpm/simulation.hpp"
#include "output/frame.hpp"
#include "plugins/registry.hpp"

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace cleave::discretization {

/// The bodies of one material, stepped as a whole by a plugin.
class Discretization {
 public:
  /// Hands the bodies to an instance of the material's plugin. Throws InputError if it refuses one.
  Discretization(const config::Scene&, const config::Material&, std::vector<mpm::SampledBody>, plugins::Registry&);

  const plugins::Instance& plugin() const { return instance_; }
  const std::string& material() const { return material_; }
  std::size_t bodies() const { return bodies_.size(); }
  std::size_t points() const { return points_; }
  double rest_volume() const { return rest_volume_; }
  /// Of the state the plugin would save.
  std::uint64_t saved_bytes() const;
  /// One section. Throws InputError where the plugin refuses what is restored.
  void save(checkpoint::StateWriter&, const std::string& section) const;
  void restore(checkpoint::StateReader&, const std::string& section);
  const std::vector<std::size_t>& held() const { return surroundings_.held(); }

  /// s, positive. Throws SimulationError if the plugin gives none.
  double stable_step() const;
  /// From `time` on. Throws SimulationError naming the plugin, and body and point if something is not finite afterwards.
  void step(double time, double time_step);

  /// Adds bodies, points and fields. Attributes that only a part of a frame's points have are 0 for the others. `asked`: names
  /// of attributes; empty: all but "F", which gives "J".
  void write(output::ParticleFrame&, const std::vector<std::string>& asked) const;
  void write(std::vector<mpm::ParticleState>&, std::int32_t first_body) const;
  /// Adds energies, momenta and extremes, where center_of_mass stands for the first moment of mass; `damaged` is the rest
  /// volume with d > 1/2.
  void measure(output::FrameRecord&, double& damaged) const;

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
  /// Fields of a body by name. Throws SimulationError if position or velocity is not among them or one has no such shape.
  std::map<std::string, Field> fields(std::size_t body) const;
  [[noreturn]] void fail(const std::string& what) const;

  std::string material_;
  double density_;
  int dimension_;
  Vector3 gravity_;
  plugins::Instance elasticity_;  // without a handle if the material has none
  std::vector<Body> bodies_;
  std::size_t points_ = 0;
  double rest_volume_ = 0;
  Surroundings surroundings_;
  plugins::Instance instance_;
};

}  // namespace cleave::discretization
