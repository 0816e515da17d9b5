#include "discretization/simulation.hpp"

#include "checkpoint/state.hpp"
#include "common/error.hpp"
#include "common/nearest.hpp"
#include "discretization/discretization.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>

namespace cleave::discretization {
namespace {

/// The scene without the materials, and their bodies, that are not the material point method's, or without those that are.
config::Scene part_of(const config::Scene& scene, bool discretized) {
  config::Scene part = scene;
  std::erase_if(part.materials, [&](const auto& m) { return bool(m.discretization) != discretized; });
  std::erase_if(part.bodies, [&](const auto& body) {
    return std::none_of(part.materials.begin(), part.materials.end(), [&](const auto& m) { return m.name == body.material; });
  });
  return part;
}

/// Bodies, particles and meshes of another part of the scene. Attributes that only some particles have are 0 for the others.
/// Throws SimulationError where two parts have one of the same name and another shape.
void append(output::ParticleFrame& all, output::ParticleFrame part) {
  const std::size_t before = all.particles(), added = part.particles();
  const auto bodies = std::int32_t(all.bodies.size());
  const auto take = [](auto& to, auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  for (auto& attribute : part.attributes) {
    const auto known =
        std::find_if(all.attributes.begin(), all.attributes.end(), [&](const auto& a) { return a.name == attribute.name; });
    if (known == all.attributes.end()) {
      all.attributes.push_back({attribute.name, attribute.components, attribute.unit, {}});
      all.attributes.back().values.assign(before * std::size_t(attribute.components), 0.f);
      take(all.attributes.back().values, attribute.values);
    } else if (known->components != attribute.components) {
      throw SimulationError(fmt::format(
          "body '{}' has the field \"{}\" with {} component{}; another body has one of that name with {}", part.bodies.front(),
          attribute.name, attribute.components, attribute.components > 1 ? "s" : "", known->components));
    } else {
      take(known->values, attribute.values);
    }
  }
  for (auto& a : all.attributes) a.values.resize((before + added) * std::size_t(a.components), 0.f);
  take(all.bodies, part.bodies);
  for (const std::size_t end : part.body_ends) all.body_ends.push_back(before + end);
  take(all.positions, part.positions);
  take(all.velocities, part.velocities);
  take(all.volumes, part.volumes);
  for (auto& mesh : part.meshes) {
    mesh.body += bodies;
    all.meshes.push_back(std::move(mesh));
  }
}

/// Sums, extremes and means of two parts of the scene with `particles` and `added` particles.
void add(output::FrameRecord& all, const output::FrameRecord& part, std::int64_t particles, std::int64_t added) {
  const auto mean = [](auto a, double weight_a, auto b, double weight_b) {
    return decltype(a)((weight_a * a + weight_b * b) / (weight_a + weight_b));
  };
  const auto of_particles = [&](double& value, double other) { value = mean(value, double(particles), other, double(added)); };
  all.center_of_mass = mean(all.center_of_mass, all.mass, part.center_of_mass, part.mass);
  all.damaged_fraction = mean(all.damaged_fraction, all.rest_volume, part.damaged_fraction, part.rest_volume);
  of_particles(all.damage_active, part.damage_active);
  of_particles(all.under_sampled, part.under_sampled);
  all.halved_steps += part.halved_steps;
  for (const auto sum :
       {&output::FrameRecord::kinetic_energy, &output::FrameRecord::elastic_energy, &output::FrameRecord::gravity_energy,
        &output::FrameRecord::mass, &output::FrameRecord::volume, &output::FrameRecord::rest_volume})
    all.*sum += part.*sum;
  all.momentum += part.momentum;
  all.angular_momentum += part.angular_momentum;
  all.minimum_J = std::min(all.minimum_J, part.minimum_J);
  // Iterations are counted by at most one part.
  for (const auto largest : {&output::FrameRecord::maximum_J, &output::FrameRecord::maximum_speed,
                             &output::FrameRecord::maximum_damage, &output::FrameRecord::damage_iterations,
                             &output::FrameRecord::newton_iterations, &output::FrameRecord::linear_iterations,
                             &output::FrameRecord::constraint_iterations, &output::FrameRecord::constraint_residual})
    all.*largest = std::max(all.*largest, part.*largest);
  all.damage_iterations_most = std::max(all.damage_iterations_most, part.damage_iterations_most);
  if (part.pieces) all.pieces = all.pieces.value_or(0) + *part.pieces;
}

/// Adds what is counted by name.
template <class Number>
void add(std::vector<std::pair<std::string, Number>>& all, const std::vector<std::pair<std::string, Number>>& part) {
  for (const auto& [name, count] : part) {
    const auto known = std::find_if(all.begin(), all.end(), [&n = name](const auto& entry) { return entry.first == n; });
    if (known == all.end())
      all.emplace_back(name, count);
    else
      known->second += count;
  }
}

/// Methods side by side, each with the bodies it owns. They meet through colliders alone.
class MixedSimulation final : public mpm::Simulation {
 public:
  MixedSimulation(const config::Scene& scene, plugins::Registry& registry) : scene_(scene), held_(scene.handles.size(), 0) {
    if (const auto points = part_of(scene, false); !points.bodies.empty()) {
      parts_.push_back(mpm::Simulation::create_part(points, registry));
      has_particles_ = true;
    }
    const auto discretized = part_of(scene, true);
    auto bodies = mpm::sample_bodies(discretized);
    for (std::size_t m = 0; m < discretized.materials.size(); m++) {
      std::vector<mpm::SampledBody> own;
      for (auto& body : bodies)
        if (body.material == m) own.push_back(std::move(body));
      if (own.empty()) continue;
      parts_.push_back(
          std::make_unique<Discretization>(scene, discretized.materials[m], std::move(own), registry, particles()));
    }
    if (parts_.empty()) throw InputError("the scene has no body to simulate");
    for (const auto& part : parts_)
      for (std::size_t h = 0; h < held_.size(); h++) held_[h] += part->held()[h];
    mpm::check_handles(scene, held_);
    check_output();
  }

  mpm::Bound largest_step() override {
    mpm::Bound bound{std::numeric_limits<double>::infinity(), "frame"};
    for (const auto& part : parts_)
      if (const mpm::Bound other = part->largest_step(); other.seconds < bound.seconds) bound = other;
    return bound;
  }

  std::int64_t particles() const override {
    std::int64_t count = 0;
    for (const auto& part : parts_) count += part->particles();
    return count;
  }
  const std::vector<std::size_t>& held() const override { return held_; }
  const char* isa() const override {
    for (const auto& part : parts_)
      if (part->isa() != std::string_view("none")) return part->isa();
    return "none";
  }
  const std::string& failed_batch() const override {
    for (const auto& part : parts_)
      if (!part->failed_batch().empty()) return part->failed_batch();
    return parts_.front()->failed_batch();
  }

  std::vector<std::string> attributes() const override {
    std::vector<std::string> names;
    for (const auto& part : parts_)
      for (auto& name : part->attributes())
        if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    return names;
  }
  bool has_surfaces() const override {
    return std::any_of(parts_.begin(), parts_.end(), [](const auto& part) { return part->has_surfaces(); });
  }
  output::ParticleFrame frame(int index) const override {
    output::ParticleFrame all = parts_.front()->frame(index);
    for (std::size_t p = 1; p < parts_.size(); p++) append(all, parts_[p]->frame(index));
    return all;
  }

  std::vector<mpm::ParticleState> state() const override {
    std::vector<mpm::ParticleState> all;
    for (const auto& part : parts_) {
      const auto first = std::int64_t(all.size());
      const std::int32_t bodies = all.empty() ? 0 : all.back().body + 1;
      for (auto& particle : part->state()) {
        particle.id += first;
        particle.body += bodies;
        all.push_back(std::move(particle));
      }
    }
    return all;
  }

  output::FrameRecord measure() override {
    output::FrameRecord all = parts_.front()->measure();
    std::int64_t particles = parts_.front()->particles();
    for (std::size_t p = 1; p < parts_.size(); particles += parts_[p++]->particles())
      add(all, parts_[p]->measure(), particles, parts_[p]->particles());
    record_steps(all);
    if (all.minimum_J > all.maximum_J) all.minimum_J = all.maximum_J = 1;
    return all;
  }

  std::vector<std::pair<std::string, double>> stage_seconds() const override {
    std::vector<std::pair<std::string, double>> stages;
    for (const auto& part : parts_) add(stages, part->stage_seconds());
    return stages;
  }

  std::vector<std::pair<std::string, std::int64_t>> integrators() const override {
    std::vector<std::pair<std::string, std::int64_t>> steps;
    for (const auto& part : parts_) add(steps, part->integrators());
    return steps;
  }

  std::vector<std::pair<std::string, double>> bytes_per_particle() const override {
    std::vector<std::pair<std::string, double>> all;
    double total = 0;
    for (const auto& part : parts_) {
      const auto own = part->bytes_per_particle();
      all.insert(all.end(), own.begin(), own.end() - 1);
      total += own.back().second * double(part->particles());
    }
    all.emplace_back("total", total / double(particles()));
    return all;
  }

  std::vector<output::PluginRecord> plugins() const override {
    std::map<std::string, output::PluginRecord> used;
    for (const auto& part : parts_)
      for (auto& record : part->plugins()) used[record.id] = record;
    std::vector<output::PluginRecord> all;
    for (auto& [id, record] : used) all.push_back(record);
    return all;
  }

  std::vector<std::string> not_saved() const override {
    std::vector<std::string> all;
    for (const auto& part : parts_)
      for (auto& what : part->not_saved()) all.push_back(std::move(what));
    return all;
  }

 private:
  void advance(double dt) override {
    for (const auto& part : parts_) part->take_step(dt, time_ + dt);
  }
  void save_state(checkpoint::StateWriter& writer, const std::string& prefix) const override {
    for (std::size_t p = 0; p < parts_.size(); p++) parts_[p]->save(writer, fmt::format("{}part {} ", prefix, p));
  }
  void restore_state(checkpoint::StateReader& reader, const std::string& prefix) override {
    for (std::size_t p = 0; p < parts_.size(); p++) parts_[p]->restore(reader, fmt::format("{}part {} ", prefix, p));
  }

  /// The scene's reader knows neither the fields of a discretization nor whether its bodies have surfaces.
  void check_output() const {
    output::ParticleFrame present;
    try {
      present = frame(0);
    } catch (const SimulationError& e) {
      throw InputError(std::string("error: ") + e.what());
    }
    const auto names = attributes();
    for (const auto& asked : scene_.output.attributes) {
      const auto named = [&](const auto& a) { return a.name == asked; };
      if (std::any_of(present.attributes.begin(), present.attributes.end(), named)) continue;
      if (asked == "piece" && has_particles_) continue;
      const auto meant = nearest(asked, names);
      throw InputError(fmt::format("error: output.attributes: no body of the scene has \"{}\"{}; there are: {}", asked,
                                   meant ? ", did you mean \"" + *meant + "\"?" : "", fmt::join(names, ", ")));
    }
    if (!scene_.output.meshes) return;
    for (const auto& format : *scene_.output.meshes) {
      const bool tetrahedra = format == "vtu";
      if (std::none_of(present.meshes.begin(), present.meshes.end(),
                       [&](const auto& mesh) { return !tetrahedra || !mesh.tetrahedra.empty(); }))
        throw InputError(fmt::format("error: output.meshes: no body of the scene has {} that \"{}\" could be written of",
                                     tetrahedra ? "tetrahedra" : "a surface", format));
    }
  }

  config::Scene scene_;
  std::vector<std::unique_ptr<mpm::Simulation>> parts_;
  std::vector<std::size_t> held_;
  bool has_particles_ = false;  ///< of the material point method, whose pieces frames can have
};

}  // namespace

std::unique_ptr<mpm::Simulation> simulate(const config::Scene& scene, plugins::Registry& registry) {
  if (std::none_of(scene.materials.begin(), scene.materials.end(), [](const auto& m) { return bool(m.discretization); }))
    return mpm::Simulation::create(scene, registry);
  return std::make_unique<MixedSimulation>(scene, registry);
}

}  // namespace cleave::discretization
