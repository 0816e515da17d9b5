#include "discretization/simulation.hpp"

#include "common/error.hpp"
#include "common/nearest.hpp"
#include "discretization/discretization.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
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

/// Methods side by side. They meet through colliders alone.
class MixedSimulation final : public mpm::Simulation {
 public:
  MixedSimulation(const config::Scene& scene, plugins::Registry& registry) : scene_(scene), held_(scene.handles.size(), 0) {
    if (const auto points = part_of(scene, false); !points.bodies.empty()) {
      mpm_ = create_part(points, registry);
      add_held(mpm_->held());
    }
    const auto discretized = part_of(scene, true);
    auto bodies = mpm::sample_bodies(discretized);
    for (std::size_t m = 0; m < discretized.materials.size(); m++) {
      std::vector<mpm::SampledBody> own;
      for (auto& body : bodies)
        if (body.material == m) own.push_back(std::move(body));
      if (own.empty()) continue;
      parts_.push_back(std::make_unique<Discretization>(scene, discretized.materials[m], std::move(own), registry));
      add_held(parts_.back()->held());
    }
    mpm::check_handles(scene, held_);
    check_attributes();
    check_fixed_step();
  }

  mpm::Bound largest_step() override {
    const auto& sim = scene_.simulation;
    mpm::Bound bound{std::numeric_limits<double>::infinity(), "frame"};
    const auto consider = [&](mpm::Bound other) {
      if (other.seconds < bound.seconds) bound = other;
    };
    if (mpm_)
      consider(mpm_->largest_step());
    else if (sim.time_step)
      consider({*sim.time_step, "fixed"});
    else if (sim.maximum_time_step > 0)
      consider({sim.maximum_time_step, "maximum"});
    try {
      for (const auto& part : parts_) {
        const double stable = part->stable_step();
        if (!sim.time_step)
          consider({stable, "discretization"});
        else if (bound.seconds > stable * (1 + 1e-9))
          throw SimulationError(fmt::format(
              "the fixed step of {:.3g} s is above {:.3g} s, the largest stable step that {} gives for material '{}' in its "
              "present state; give a smaller simulation.time_step or \"auto\"",
              bound.seconds, stable, part->plugin().description().id, part->material()));
      }
    } catch (const SimulationError& e) {
      throw SimulationError(fmt::format("step {} at t = {:.6g} s: {}", steps_, time_, e.what()));
    }
    return bound;
  }

  std::int64_t particles() const override {
    std::int64_t count = mpm_ ? mpm_->particles() : 0;
    for (const auto& part : parts_) count += std::int64_t(part->points());
    return count;
  }
  const std::vector<std::size_t>& held() const override { return held_; }
  const char* isa() const override { return mpm_ ? mpm_->isa() : "none"; }
  const std::string& failed_batch() const override {
    static const std::string none;
    return mpm_ ? mpm_->failed_batch() : none;
  }

  output::ParticleFrame frame(int index) const override {
    output::ParticleFrame f;
    if (mpm_) f = mpm_->frame(index);
    f.index = index;
    f.time = time_;
    f.dimension = scene_.simulation.dimension;
    f.cell_size = scene_.simulation.cell_size;
    for (const auto& part : parts_) part->write(f, scene_.output.attributes);
    return f;
  }

  std::vector<mpm::ParticleState> state() const override {
    std::vector<mpm::ParticleState> all;
    if (mpm_) all = mpm_->state();
    std::int32_t body = all.empty() ? 0 : all.back().body + 1;
    for (const auto& part : parts_) {
      part->write(all, body);
      body += std::int32_t(part->bodies());
    }
    return all;
  }

  output::FrameRecord measure() override {
    output::FrameRecord r;
    r.minimum_J = std::numeric_limits<double>::infinity();
    r.maximum_J = -r.minimum_J;
    if (mpm_) r = mpm_->measure();
    record_steps(r);
    double damaged = r.damaged_fraction * r.rest_volume;
    r.center_of_mass *= r.mass;
    for (const auto& part : parts_) {
      part->measure(r, damaged);
      r.rest_volume += part->rest_volume();
    }
    r.center_of_mass /= r.mass;
    r.damaged_fraction = damaged / r.rest_volume;
    if (mpm_) r.damage_active *= double(mpm_->particles()) / double(particles());
    if (r.minimum_J > r.maximum_J) r.minimum_J = r.maximum_J = 1;
    return r;
  }

  std::vector<std::pair<std::string, double>> stage_seconds() const override {
    std::vector<std::pair<std::string, double>> stages;
    if (mpm_) stages = mpm_->stage_seconds();
    stages.emplace_back("discretization", seconds_);
    return stages;
  }

  std::vector<std::pair<std::string, std::int64_t>> integrators() const override {
    return mpm_ ? mpm_->integrators() : std::vector<std::pair<std::string, std::int64_t>>();
  }

  std::vector<std::pair<std::string, double>> bytes_per_particle() const override {
    std::vector<std::pair<std::string, double>> parts;
    double total = 0;
    if (mpm_) {
      parts = mpm_->bytes_per_particle();
      total = parts.back().second * double(mpm_->particles());
      parts.pop_back();
    }
    for (const auto& part : parts_) {
      const auto bytes = double(part->saved_bytes());
      parts.emplace_back(part->material() + ": saved state", bytes / double(part->points()));
      total += bytes;
    }
    parts.emplace_back("total", total / double(particles()));
    return parts;
  }

  std::vector<output::PluginRecord> plugins() const override {
    std::map<std::string, output::PluginRecord> used;
    if (mpm_)
      for (auto& record : mpm_->plugins()) used[record.id] = record;
    for (const auto& part : parts_) {
      const auto& d = part->plugin().description();
      used[d.id] = {d.id, d.version, part->plugin().plugin().path().string()};
    }
    std::vector<output::PluginRecord> all;
    for (auto& [id, record] : used) all.push_back(record);
    return all;
  }

  std::vector<std::string> not_saved() const override { return mpm_ ? mpm_->not_saved() : std::vector<std::string>(); }

 private:
  void save_state(checkpoint::StateWriter& writer, const std::string& prefix) const override {
    if (mpm_) mpm_->save(writer, prefix + "points ");
    for (std::size_t i = 0; i < parts_.size(); i++) parts_[i]->save(writer, discretization_section(prefix, i));
  }
  void restore_state(checkpoint::StateReader& reader, const std::string& prefix) override {
    if (mpm_) mpm_->restore(reader, prefix + "points ");
    for (std::size_t i = 0; i < parts_.size(); i++) parts_[i]->restore(reader, discretization_section(prefix, i));
  }
  static std::string discretization_section(const std::string& prefix, std::size_t part) {
    return prefix + "discretization " + std::to_string(part);
  }

  void advance(double dt) override {
    if (mpm_) mpm_->take_step(dt, time_ + dt);
    const auto start = std::chrono::steady_clock::now();
    try {
      for (const auto& part : parts_) part->step(time_, dt);
    } catch (const SimulationError& e) {
      throw SimulationError(fmt::format("step {} at t = {:.6g} s, dt = {:.3g} s: {}", steps_, time_, dt, e.what()));
    }
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

  void add_held(const std::vector<std::size_t>& counts) {
    for (std::size_t h = 0; h < counts.size(); h++) held_[h] += counts[h];
  }

  /// The scene's reader does not know the fields of a discretization.
  void check_attributes() const {
    output::ParticleFrame present, offered;
    try {
      present = frame(0);
      if (mpm_) offered = mpm_->frame(0);
      for (const auto& part : parts_) part->write(offered, {});
    } catch (const SimulationError& e) {
      throw InputError(std::string("error: ") + e.what());
    }
    std::vector<std::string> names = {"F"};
    for (const auto& a : offered.attributes) names.push_back(a.name);
    for (const auto& asked : scene_.output.attributes) {
      const auto named = [&](const auto& a) { return a.name == asked; };
      if (std::any_of(present.attributes.begin(), present.attributes.end(), named)) continue;
      const auto meant = nearest(asked, names);
      throw InputError(fmt::format("error: output.attributes: no body of the scene has \"{}\"{}; there are: {}", asked,
                                   meant ? ", did you mean \"" + *meant + "\"?" : "", fmt::join(names, ", ")));
    }
  }

  void check_fixed_step() const {
    if (!scene_.simulation.time_step) return;
    for (const auto& part : parts_)
      if (const double stable = part->stable_step(); *scene_.simulation.time_step > stable * (1 + 1e-9))
        throw InputError(
            fmt::format("error: material '{}': {} is stable with steps of at most {:.3g} s, simulation.time_step "
                        "is {:.3g} s; give a smaller one or \"auto\"",
                        part->material(), part->plugin().description().id, stable, *scene_.simulation.time_step));
  }

  config::Scene scene_;
  std::unique_ptr<mpm::Simulation> mpm_;  ///< null if no body is the material point method's
  std::vector<std::unique_ptr<Discretization>> parts_;
  std::vector<std::size_t> held_;
  double seconds_ = 0;
};

}  // namespace

std::unique_ptr<mpm::Simulation> simulate(const config::Scene& scene, plugins::Registry& registry) {
  if (std::none_of(scene.materials.begin(), scene.materials.end(), [](const auto& m) { return bool(m.discretization); }))
    return mpm::Simulation::create(scene, registry);
  return std::make_unique<MixedSimulation>(scene, registry);
}

}  // namespace cleave::discretization
