#include "mpm/simulation.hpp"

#include "common/error.hpp"
#include "mpm/bodies.hpp"
#include "mpm/colliders.hpp"
#include "mpm/constraints.hpp"
#include "mpm/damage.hpp"
#include "mpm/grid.hpp"
#include "mpm/handles.hpp"
#include "mpm/implicit.hpp"
#include "mpm/integrator_choice.hpp"
#include "mpm/law_watch.hpp"
#include "mpm/material.hpp"
#include "mpm/particle_blocks.hpp"
#include "mpm/particles.hpp"
#include "mpm/sampling_gaps.hpp"
#include "mpm/time_step.hpp"
#include "mpm/velocity_jumps.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>
#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cstring>
#include <map>
#include <set>
#include <span>

namespace cleave::mpm {
namespace {

using Clock = std::chrono::steady_clock;

enum Stage {
  sort_stage,
  damage_stage,
  to_grid_stage,
  grid_stage,
  implicit_stage,
  constraint_stage,
  to_particles_stage,
  bound_stage,
  stage_count
};
constexpr const char* stage_names[stage_count] = {"sort",           "damage",     "particles to grid", "grid update",
                                                  "implicit solve", "constraint", "grid to particles", "step bounds"};

/// Elastic waves are measured every this many steps, or once particles may have been strained by so much since: they change by
/// fractions of a percent from step to step, and the CFL number leaves a factor of two.
constexpr int wave_interval = 8;
constexpr double wave_strain = 0.5;

/// A step that is too large, or an implicit one that is not solved for, is taken in halves, down to this power of one half.
constexpr int most_halvings = 5;
/// With entries of the strain of a step up to this one no neighbourhood loses three quarters of its volume, det(I + A) >=
/// (1 - 3 max|A_ij|)^3 > 1/4, and none is turned inside out.
constexpr double harmless_strain = 0.12;
/// A step of automatic size that leaves a neighbourhood less of its volume is too large.
constexpr double least_volume_ratio = 0.25;

/// Explicit damage whose steps are so many times smaller than those of elasticity is refused.
constexpr double explicit_damage_limit = 1000;

/// Results of a law for the points of a batch, as rows of tiles.
template <class T>
struct LawResults {
  const T* values;
  int rows;  ///< of a tile
  double operator()(int component, int point) const {
    constexpr int lanes = tile_lanes<T>;
    return double(values[(point / lanes * rows + component) * lanes + point % lanes]);
  }
};

/// sqrt(3/2 s:s) with s = dev(tau)/J, from the components xx yy zz xy xz yz of tau.
double von_mises_stress(const Eigen::Vector<double, 6>& tau, double J) {
  const Vector3 deviator = tau.head<3>().array() - tau.head<3>().mean();
  return std::sqrt(1.5 * deviator.squaredNorm() + 3 * tau.tail<3>().squaredNorm()) / std::abs(J);
}

/// Quantities of frames that are no state variables.
bool is_built_in(const std::string& attribute) {
  static const std::set<std::string> names = {"J", "C", "b", "F", "damage", "toughness", "stress", "piece"};
  return names.contains(attribute);
}

template <class T, int D>
class MpmSimulation final : public Simulation {
  using Set = Particles<T, D>;
  static constexpr int lanes = tile_lanes<T>;

 public:
  MpmSimulation(const config::Scene& scene, plugins::Registry& registry)
      : scene_(scene),
        kernels_(kernels_of<T, D>(load_kernels().transfer)),
        cell_size_(scene.simulation.cell_size),
        colliders_(scene.colliders, scene.simulation.cell_size),
        handles_(scene.handles, scene.simulation.cell_size),
        scratch_([size = kernels_.scratch_bytes] { return Buffer(size); }) {
    for (const auto& m : scene.materials) {
      const bool toughness = std::any_of(scene.bodies.begin(), scene.bodies.end(),
                                         [&](const config::Body& body) { return body.material == m.name && body.toughness; });
      materials_.push_back(std::make_unique<Material>(m, registry, D, cell_size_, toughness));
      watches_.push_back(watch(watches_.size()));
    }
    if (scene.materials.empty() || scene.bodies.empty()) throw InputError("the scene has no body to simulate");
    reference_density_ = 0;
    for (const auto& m : materials_) reference_density_ = std::max(reference_density_, m->density());
    constants_.reserve(64);
    std::fill_n(reinterpret_cast<T*>(constants_.data()) + lanes, lanes, T(1));
    if (scene.simulation.integrator != config::Integrator::symplectic)
      implicit_ =
          std::make_unique<ImplicitStep<T, D>>(scene.simulation.implicit, cell_size_, reference_density_, failed_batches_);
    populate();
    sort();
    maximum_speed_ = 0;
    for (const auto& s : sets_)
      s->for_each([&](const auto&, std::uint64_t slot) {
        for (int a = 0; a < D; a++)
          maximum_speed_ = std::max(maximum_speed_, std::abs(double(s->value(s->layout().velocity, a, slot))));
      });
    if (scene.simulation.integrator != config::Integrator::implicit) measure_waves();
    check_damage_step();
    check_fixed_step();
  }

  Bound largest_step() override;
  std::int64_t particles() const override { return particle_count_; }
  const std::vector<std::size_t>& held() const override { return held_; }
  const char* isa() const override { return load_kernels().isa; }
  const std::string& failed_batch() const override { return failed_batch_; }

  std::vector<std::string> attributes() const override;
  output::ParticleFrame frame(int index) const override;
  std::vector<ParticleState> state() const override;
  output::FrameRecord measure() override;

  std::vector<std::pair<std::string, double>> stage_seconds() const override {
    std::vector<std::pair<std::string, double>> r;
    for (int s = 0; s < stage_count; s++)
      if ((s != constraint_stage || constraints_) && (s != implicit_stage || implicit_))
        r.emplace_back(stage_names[s], stage_seconds_[s]);
    return r;
  }
  std::vector<std::pair<std::string, std::int64_t>> integrators() const override {
    return {integrators_.begin(), integrators_.end()};
  }
  std::vector<std::pair<std::string, double>> bytes_per_particle() const override;
  std::vector<std::string> not_saved() const override {
    return constraints_ ? constraints_->not_saved() : std::vector<std::string>();
  }
  std::vector<output::PluginRecord> plugins() const override {
    std::map<std::string, output::PluginRecord> used;
    for (const auto& m : materials_)
      for (const auto* law : {&m->elasticity(), &m->plasticity(), &m->damage(), &m->constraint()})
        if (*law) {
          const auto& d = law->description();
          used[d.id] = {d.id, d.version, law->plugin().path().string(), law->plugin().sha256()};
        }
    std::vector<output::PluginRecord> r;
    for (auto& [id, record] : used) r.push_back(record);
    return r;
  }

 private:
  /// Adds the seconds a scope takes to a stage.
  struct Timer {
    Timer(MpmSimulation& sim, Stage stage) : seconds(sim.stage_seconds_[stage]) {}
    ~Timer() { seconds += std::chrono::duration<double>(Clock::now() - start).count(); }
    double& seconds;
    Clock::time_point start = Clock::now();
  };

  void save_state(checkpoint::StateWriter&, const std::string& prefix) const override;
  void restore_state(checkpoint::StateReader&, const std::string& prefix) override;
  /// What saving and restoring share, beside the particles.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.maximum_speed_, self.wave_step_, self.waves_at_, self.needs_sort_, self.choice_, self.symplectic_step_,
            self.implicit_solves_, self.newton_iterations_, self.linear_iterations_, self.integrators_, self.warned_unreliable_,
            self.warned_damage_, self.strained_, self.halved_steps_, self.warned_halved_);
  }

  /// Damage of F_n first, then forces with it, then momentum and strain.
  void advance(double dt) override {
    // What the other integrator can do in one step, too, is not worth a solve.
    const bool implicit = scene_.simulation.integrator == config::Integrator::implicit ||
                          (choice_.implicit() && dt > symplectic_step_ * (1 + 1e-9));
    work_ = {};
    const Counted before = counted();
    drive_damage(dt);
    const int passes = any_evolution_ ? scene_.simulation.damage.passes : 1;
    std::vector<Buffer> start;
    if (passes > 1) keep(start, true);
    for (int pass = 0; pass < passes; pass++) {
      if (pass > 0) {  // driving forces of the strain this step has come to, on the state it started from
        drive_damage(dt);
        restore(start, true);
      }
      evolve_damage(dt);
      const bool trial = pass + 1 < passes;
      const int halvings = passes == 1 ? most_halvings : 0;
      if (implicit)
        move_implicitly(time_, dt, trial, halvings);
      else
        move(time_, dt, trial, halvings);
    }
    integrators_[implicit ? "implicit" : "symplectic"]++;
    if (implicit)
      choice_.took_implicit_step(work_, dt, shared_since(before));
    else
      choice_.took_symplectic_step(shared_since(before));
  }

  /// Of damage and constraints, so far.
  struct Counted {
    std::vector<typename DamageEvolution<T, D>::Statistics> damage;
    typename Constraints<T, D>::Statistics constraints;
  };
  Counted counted() const {
    Counted now;
    for (const auto& d : damage_) now.damage.push_back(d ? d->statistics() : typename DamageEvolution<T, D>::Statistics());
    if (constraints_) now.constraints = constraints_->statistics();
    return now;
  }
  SharedWork shared_since(const Counted& before) const {
    const Counted now = counted();
    SharedWork work;
    for (std::size_t s = 0; s < sets_.size(); s++) {
      const auto &n = now.damage[s], &b = before.damage[s];
      const auto passes = double(n.steps - b.steps);
      if (passes == 0) continue;
      const double part = double(sets_[s]->size()) / double(particle_count_), active = n.active_blocks - b.active_blocks;
      work += {.driven = part * passes,
               .damaged = part * active,
               .damage_iterations = part * active / passes * double(n.iterations - b.iterations)};
    }
    const auto &n = now.constraints, &b = before.constraints;
    work += {.projected = double(n.particles - b.particles) / double(particle_count_),
             .projection_iterations = double(n.particle_iterations - b.particle_iterations) / double(particle_count_)};
    return work;
  }

  /// Symplectically, in two halves where that turns out too large. Damage has evolved by the whole step already.
  void move(double start, double dt, bool trial, int halvings) {
    StepView view = step_view(start, dt);
    particles_to_grid(view, true);
    update_grid(view);
    if (constraints_) apply_constraints(view);
    if (moved(view, trial, halvings)) return;
    move(start, dt / 2, trial, halvings - 1);
    if (needs_sort_) sort();
    move(start + dt / 2, dt / 2, trial, halvings - 1);
  }

  /// Grid to particles, or false and they are as they were: the step is too large. What may turn out so is told from the grid:
  /// then, and only then, particles are kept.
  bool moved(StepView view, bool trial, int halvings) {
    if (!may_be_too_large(view.time_step) || halvings == 0) {
      grid_to_particles(view, trial);
      return true;
    }
    std::vector<Buffer> before;
    keep(before, false);
    const bool unsorted = needs_sort_;
    if (!scene_.simulation.time_step) view.least_volume_ratio = least_volume_ratio;
    const auto too_large = grid_to_particles(view, trial, true);
    if (!too_large) return true;
    restore(before, false);
    needs_sort_ = unsorted;
    failed_batches_.clear();
    waves_at_ = steps_ - wave_interval;
    if (halvings == most_halvings) {
      halved_steps_++;
      if (!std::exchange(warned_halved_, true))
        spdlog::warn("step {} at t = {:.6g} s: {}; it is taken in halves. Said once: frames.csv counts halved_steps", steps_,
                     view.start, *too_large);
    }
    return false;
  }

  /// Whether this step might turn out too large, by what the grid says.
  bool may_be_too_large(double dt) {
    const double to_strain = dt / cell_size_, bound = to_strain * jumps_.bound(grid_, std::as_const(*this).sets());
    if (!(bound > harmless_strain)) {
      strained_ += bound;
      return false;
    }
    const double strain = to_strain * jumps_.largest(grid_, std::as_const(*this).sets(), harmless_strain / to_strain);
    strained_ += strain;
    return strain > harmless_strain;
  }

  /// With velocities that are solved for, in two halves where there is no solution, or where constraints make of it what turns
  /// matter inside out: the solve guards against that, their projection does not.
  void move_implicitly(double start, double dt, bool trial, int halvings) {
    StepView view = step_view(start, dt);
    particles_to_grid(view, false);
    if (solve_grid(view, halvings == 0)) {
      if (constraints_) {
        apply_constraints(view);
        if (moved(view, trial, halvings)) return;
      } else {
        grid_to_particles(view, trial);
        return;
      }
    }
    move_implicitly(start, dt / 2, trial, halvings - 1);
    if (needs_sort_) sort();
    move_implicitly(start + dt / 2, dt / 2, trial, halvings - 1);
  }

  StepView step_view(double start, double dt) const {
    StepView view;
    view.start = start;
    view.time_step = dt;
    view.cell_size = cell_size_;
    view.force_scale = 4 * dt / (cell_size_ * reference_density_);
    view.scheme = scene_.simulation.transfer == config::Transfer::apic  ? TransferScheme::apic
                  : scene_.simulation.transfer == config::Transfer::pic ? TransferScheme::pic
                                                                        : TransferScheme::flip;
    view.flip_ratio = scene_.simulation.flip_ratio;
    view.grid = grid_.data();
    return view;
  }

  /// What particles are, apart from where they are stored; trials move only those that have damage.
  void keep(std::vector<Buffer>& copies, bool damaged_only) const {
    for (std::size_t k = 0; k < sets_.size(); k++) {
      const std::size_t bytes = damage_[k] || !damaged_only ? sets_[k]->tiles() * sets_[k]->layout().stride : 0;
      copies.emplace_back(bytes);
      if (bytes) std::memcpy(copies.back().data(), sets_[k]->data(), bytes);
    }
  }
  void restore(const std::vector<Buffer>& copies, bool damaged_only) {
    for (std::size_t k = 0; k < sets_.size(); k++)
      if (damage_[k] || !damaged_only)
        std::memcpy(sets_[k]->data(), copies[k].data(), sets_[k]->tiles() * sets_[k]->layout().stride);
  }
  void drive_damage(double dt);
  void evolve_damage(double dt);
  void check_damage_step();
  /// Says once that a fixed step is above what elastic waves allow.
  void check_fixed_step();
  void populate();
  void find_held(const std::vector<SampledBody>&);
  void store(std::size_t material, std::vector<SampledBody>&);
  void sort();
  /// The grid of the blocks that particles are in, and what is known of it.
  void rebuild_grid();
  void measure_waves();
  void particles_to_grid(StepView&, bool stress);
  void update_grid(const StepView&);
  void add_gravity(double dt);
  void hold_handles(const StepView&, std::vector<HeldNode>*);
  using Solve = typename ImplicitStep<T, D>::Outcome;
  /// Velocities at the end of an implicit step, from a grid that has masses and momenta, if they cost no more than `most`.
  Solve solve(const StepView&, double most);
  /// The same, counted. Returns false if there is no solution, or throws if none `has_to` be left.
  bool solve_grid(const StepView&, bool has_to);
  /// What an implicit step from the present state costs; empty if that is more than `most` or there is no solution.
  std::optional<SolveWork> try_implicit_step(double dt, double most);
  void apply_constraints(const StepView&);
  /// A trial leaves particles that have no damage where they are. Where the step may be too large, says so if it is, and then
  /// leaves particles in any state.
  std::optional<std::string> grid_to_particles(const StepView&, bool trial, bool may_be_too_large = false);
  static const plugins::Instance& failed_law(const Material& m, const BlockReport& r) {
    return r.failed == LawKind::damage ? m.damage() : r.failed == LawKind::plasticity ? m.plasticity() : m.elasticity();
  }
  void check(const std::vector<BlockReport>&, std::size_t set, const char* stage);
  /// What a smaller step may mend.
  std::optional<std::string> too_large(const std::vector<BlockReport>&, std::size_t set, const StepView&) const;
  std::string name_of(const Set&, std::uint64_t slot) const;
  /// The first particle that is beyond the grid or nowhere, as the beginning of a message.
  std::string first_lost() const;
  [[noreturn]] void fail(std::size_t set, const BlockReport&, const char* stage);
  /// The batch of this point as a file, empty if no law failed there.
  std::string failed_batch(const FailedBatches::Kept*, const Set&) const;

  /// The calls of a material's laws, watched.
  struct Watches {
    LawWatch stress, degraded_stress, return_mapping, damage_inputs, driving_force, implicit_response, implicit_differential;
  };
  std::unique_ptr<Watches> watch(std::size_t material);

  ParticleView view(std::size_t set) const {
    const Set& s = *sets_[set];
    const Material& m = *materials_[set_material_[set]];
    const Watches& laws = *watches_[set_material_[set]];
    ParticleView v = s.view();
    v.detect_inversion = m.detects_inversion();
    v.relative_density = m.density() / reference_density_;
    v.elasticity = laws.stress.watched();
    if (m.damage()) {
      v.degraded_elasticity = laws.degraded_stress.watched();
      v.residual = m.damage_model().residual;
    }
    v.plasticity = laws.return_mapping.watched();
    v.constants = constants_.data();
    return v;
  }
  std::vector<Set*> sets() {
    std::vector<Set*> r;
    for (auto& s : sets_) r.push_back(s.get());
    return r;
  }
  std::vector<const Set*> sets() const {
    std::vector<const Set*> r;
    for (auto& s : sets_) r.push_back(s.get());
    return r;
  }
  void* scratch() { return scratch_.local().data(); }

  /// Rows of a tile that a law writes into outside the step, and which of them has g.
  struct ScratchRows {
    int count, degradation;
  };
  static constexpr ScratchRows measure_scratch{2, 1}, stress_scratch{stress_rows, degradation_row};
  /// Calls a law outside the step for all points of a set; f(block, first slot, results, count) gets them batch by batch.
  template <class F>
  void evaluate(std::size_t set, const BoundLaw& law, ScratchRows scratch, F&& f) const;

  config::Scene scene_;
  const TransferKernels<T, D>& kernels_;
  double cell_size_;
  double reference_density_ = 1;
  std::vector<std::unique_ptr<Material>> materials_;
  FailedBatches failed_batches_;
  std::vector<std::unique_ptr<Watches>> watches_;  // of each material
  std::string failed_batch_;
  std::vector<std::unique_ptr<Set>> sets_;
  std::vector<std::size_t> set_material_;
  std::vector<std::unique_ptr<DamageEvolution<T, D>>> damage_;  // of each set, null without a damage law
  bool any_evolution_ = false, sorts_always_ = false;
  std::vector<std::string> body_names_;
  std::vector<std::uint32_t> first_id_;  // of each body, and the end
  Grid<T, D> grid_;
  Colliders<T, D> colliders_;
  Handles<T, D> handles_;
  std::unique_ptr<ImplicitStep<T, D>> implicit_;                                      // null if all steps are symplectic
  IntegratorChoice choice_;                                                           // of an automatic integrator
  double symplectic_step_ = 0;                                                        // the largest from the present state
  SolveWork work_;                                                                    // of the implicit step that goes on
  std::int64_t implicit_solves_ = 0, newton_iterations_ = 0, linear_iterations_ = 0;  // since the last record
  std::unique_ptr<Constraints<T, D>> constraints_;                                    // null if no material has one
  std::vector<HeldNode> held_nodes_;                                                  // in this step, kept for constraints only
  Buffer constants_;
  ThreadScratch scratch_;

  std::vector<std::size_t> held_;                    // particles of each handle
  std::map<std::string, std::int64_t> integrators_;  // steps of each
  double maximum_speed_ = 0, wave_step_ = 0;
  std::int64_t waves_at_ = 0, particle_count_ = 0;
  VelocityJumps<T, D> jumps_;
  double strained_ = 0;            // at most, of any particle since waves were measured
  std::int64_t halved_steps_ = 0;  // since the last record
  bool needs_sort_ = false;
  bool warned_unreliable_ = false, warned_damage_ = false, warned_halved_ = false, warned_step_ = false;
  double stage_seconds_[stage_count] = {};
};

// ------------------------------------------------------------------------------------------------- start

template <class T, int D>
void MpmSimulation<T, D>::populate() {
  std::vector<SampledBody> bodies;
  std::uint32_t id = 0;
  for (const auto& body : scene_.bodies) {
    bodies.push_back(sample_body(scene_, body));
    const SampledBody& s = bodies.back();
    body_names_.push_back(s.name);
    first_id_.push_back(id);
    id += std::uint32_t(s.particles.positions.size());
    const Material& material = *materials_[s.material];
    if (material.detects_inversion())
      for (std::size_t i = 0; i < s.particles.deformation.size(); i++)
        if (const double J = s.particles.deformation[i].determinant(); !(J > 0))
          throw InputError(fmt::format("body '{}': particle {} starts with det F = {:.6g}, where {} is not defined", s.name, i,
                                       J, material.elasticity().description().id));
  }
  first_id_.push_back(id);
  particle_count_ = id;
  find_held(bodies);
  for (std::size_t m = 0; m < materials_.size(); m++) {
    const auto fills = [m](const SampledBody& body) { return body.material == m && !body.particles.positions.empty(); };
    if (std::none_of(bodies.begin(), bodies.end(), fills)) continue;
    sets_.push_back(std::make_unique<Set>(materials_[m]->layout()));
    set_material_.push_back(m);
    store(m, bodies);
    if (materials_[m]->constraint()) {
      if (!constraints_) constraints_ = std::make_unique<Constraints<T, D>>(cell_size_, reference_density_);
      constraints_->add(materials_[m]->constraint(), sets_.size() - 1);
    }
    damage_.push_back(nullptr);
    if (materials_[m]->damage()) {
      damage_.back() =
          std::make_unique<DamageEvolution<T, D>>(*materials_[m], watches_[m]->damage_inputs.watched(),
                                                  watches_[m]->driving_force.watched(), scene_.simulation.damage, cell_size_);
      any_evolution_ = any_evolution_ || !damage_.back()->local();
      sorts_always_ = sorts_always_ || damage_.back()->needs_sorted_particles();
    }
  }
}

/// The first handle whose region a particle is in holds it.
template <class T, int D>
void MpmSimulation<T, D>::find_held(const std::vector<SampledBody>& bodies) {
  const std::size_t n = scene_.handles.size();
  held_.assign(n, 0);
  if (n == 0) return;
  std::vector<std::unique_ptr<scene::SignedDistance>> regions;
  for (const auto& h : scene_.handles) regions.push_back(scene::build_shape(h.region, cell_size_ / 2));
  std::vector<std::uint16_t> handle_of_id(std::size_t(particle_count_), Handles<T, D>::none);
  for (std::size_t b = 0; b < bodies.size(); b++) {
    const auto& positions = bodies[b].particles.positions;
    tbb::parallel_for(std::size_t(0), positions.size(), [&](std::size_t i) {
      for (std::size_t h = 0; h < n; h++) {
        const std::string& body = scene_.handles[h].body;
        if (!(body.empty() || body == bodies[b].name) || regions[h]->distance(positions[i]) > 0) continue;
        handle_of_id[first_id_[b] + i] = std::uint16_t(h);
        break;
      }
    });
  }
  for (const std::uint16_t h : handle_of_id)
    if (h != Handles<T, D>::none) held_[h]++;
  handles_.assign(std::move(handle_of_id));
}

/// Moves the particles of a material from its bodies to the set made last.
template <class T, int D>
void MpmSimulation<T, D>::store(std::size_t m, std::vector<SampledBody>& bodies) {
  const Material& material = *materials_[m];
  const std::vector<double> initial = material.initial_state();
  struct Part {
    SampledBody* body;
    std::size_t first;  // particle of the material
    std::uint32_t first_id;
    std::vector<const std::vector<double>*> given;  // per component of the state variables, null: initial
  };
  std::vector<Part> parts;
  std::size_t count = 0;
  for (std::size_t b = 0; b < bodies.size(); b++) {
    if (bodies[b].material != m) continue;
    Part part{&bodies[b], count, first_id_[b], {}};
    const auto& columns = bodies[b].particles.states;
    for (const auto& s : material.states())
      for (int c = 0; c < int(s.tensor); c++) {
        const auto it = columns.find(s.tensor == CLEAVE_SCALAR ? s.name : s.name + std::to_string(c));
        part.given.push_back(it == columns.end() ? nullptr : &it->second);
      }
    parts.push_back(std::move(part));
    count += bodies[b].particles.positions.size();
  }
  const auto part_of = [&](std::size_t i) -> const Part& {
    return *(std::upper_bound(parts.begin(), parts.end(), i, [](std::size_t a, const Part& b) { return a < b.first; }) - 1);
  };
  const auto position = [&](std::size_t i) -> Vector3 {
    const Part& part = part_of(i);
    return part.body->particles.positions[i - part.first] / cell_size_;
  };
  const double cell_volume = std::pow(cell_size_, D);
  const auto read = [&](std::size_t n, double* state, double* fibers) {
    const Part& part = part_of(n);
    const SampledBody& body = *part.body;
    const std::size_t i = n - part.first;
    NewParticle p;
    p.id = part.first_id + std::uint32_t(i);
    p.position = body.particles.positions[i] / cell_size_;
    p.velocity = body.velocity_of(i);
    if (scene_.simulation.transfer == config::Transfer::apic) p.velocity_gradient = body.velocity_gradient;
    p.volume = body.particles.volumes[i] / cell_volume;
    if (!body.particles.deformation.empty()) p.deformation = body.particles.deformation[i];
    if (!body.toughness.empty()) p.toughness = body.toughness[i];
    for (std::size_t c = 0; c < part.given.size(); c++) state[c] = part.given[c] ? (*part.given[c])[i] : initial[c];
    for (const auto* family : {material.layout().fiber ? &body.fibers.first : nullptr,
                               material.layout().second_fiber ? &body.fibers.second : nullptr})
      if (family) fibers = std::copy_n((*family)[i].data(), 3, fibers);
    return p;
  };
  sets_.back()->assign({count, position, read});
  for (Part& part : parts) {
    part.body->particles = {};
    part.body->fibers = {};
    part.body->toughness = {};
  }
}

template <class T, int D>
void MpmSimulation<T, D>::sort() {
  Timer timer(*this, sort_stage);
  try {
    for (std::size_t k = 0; k < sets_.size(); k++)
      if (needs_sort_ || (damage_[k] && damage_[k]->needs_sorted_particles())) sets_[k]->sort();
  } catch (const SimulationError& e) {
    throw SimulationError(fmt::format("step {} at t = {:.6g} s: {}{}", steps_, time_, first_lost(), e.what()));
  }
  needs_sort_ = false;
  rebuild_grid();
}

template <class T, int D>
std::string MpmSimulation<T, D>::first_lost() const {
  constexpr double farthest = double(farthest_block) * GridShape<D>::block_edge;
  std::string who;
  for (const auto& set : sets_)
    set->for_each([&](const auto& block, std::uint64_t slot) {
      if (who.empty() && !(set->position(block, slot).cwiseAbs().maxCoeff() < farthest)) who = name_of(*set, slot) + ": ";
    });
  return who;
}

template <class T, int D>
void MpmSimulation<T, D>::rebuild_grid() {
  std::vector<BlockCoordinate> homes;
  for (const auto& s : sets_)
    for (const auto& b : s->blocks()) homes.push_back(b.coordinate);
  grid_.rebuild(homes);
  for (auto& s : sets_) {
    auto& blocks = s->blocks();
    tbb::parallel_for(std::size_t(0), blocks.size(), [&](std::size_t i) { grid_.link(blocks[i], blocks[i].coordinate); });
  }
  colliders_.prepare(grid_);
  if (handles_.any()) handles_.prepare(sets());
}

// ------------------------------------------------------------------------------------------------- checkpoints

template <class T, int D>
void MpmSimulation<T, D>::save_state(checkpoint::StateWriter& writer, const std::string& prefix) const {
  checkpoint::pack(writer, prefix + "steps", [this](auto& archive) { list(*this, archive); });
  writer.section(prefix + "stage seconds", stage_seconds_, stage_count);
  for (std::size_t k = 0; k < sets_.size(); k++) {
    const std::string set = fmt::format("{}material {} ", prefix, set_material_[k]);
    sets_[k]->save(writer, set);
    if (damage_[k]) checkpoint::pack(writer, set + "damage", [&](auto& archive) { damage_[k]->list(*damage_[k], archive); });
  }
  if (implicit_) checkpoint::pack(writer, prefix + "implicit", [this](auto& archive) { implicit_->list(*implicit_, archive); });
  if (constraints_) constraints_->save(writer, prefix + "constraint ");
}

template <class T, int D>
void MpmSimulation<T, D>::restore_state(checkpoint::StateReader& reader, const std::string& prefix) {
  for (std::size_t k = 0; k < sets_.size(); k++) {
    const std::string set = fmt::format("{}material {} ", prefix, set_material_[k]);
    sets_[k]->restore(reader, set, std::uint64_t(particle_count_));
    if (damage_[k]) checkpoint::unpack(reader, set + "damage", [&](auto& archive) { damage_[k]->list(*damage_[k], archive); });
  }
  rebuild_grid();
  if (implicit_) {
    checkpoint::unpack(reader, prefix + "implicit", [this](auto& archive) { implicit_->list(*implicit_, archive); });
    implicit_->restore();
  }
  if (constraints_) constraints_->restore(reader, prefix + "constraint ");
  checkpoint::unpack(reader, prefix + "steps", [this](auto& archive) { list(*this, archive); });
  reader.read(prefix + "stage seconds", std::as_writable_bytes(std::span(stage_seconds_)));
}

// ------------------------------------------------------------------------------------------------- step size

template <class T, int D>
template <class F>
void MpmSimulation<T, D>::evaluate(std::size_t set, const BoundLaw& law, ScratchRows scratch, F&& f) const {
  const Set& s = *sets_[set];
  tbb::parallel_for(std::size_t(0), s.blocks().size(), [&](std::size_t i) {
    const auto& b = s.blocks()[i];
    alignas(64) T rows[stress_rows * chunk_points];
    const Material& m = *materials_[set_material_[set]];
    cleave_status status[chunk_points];
    for (std::uint32_t k = 0; k < b.count; k += chunk_points) {
      const std::uint32_t count = std::min<std::uint32_t>(chunk_points, b.count - k);
      const std::uint64_t tile = b.first_tile + k / lanes;
      std::fill_n(status, chunk_points, cleave_status(CLEAVE_STATUS_OK));
      cleave_batch batch{};
      batch.struct_size = sizeof batch;
      batch.count = count;
      batch.layout = law.layout;
      batch.streams[0] = s.data() + tile * s.layout().stride;
      batch.streams[1] = rows;
      batch.streams[2] = constants_.data();
      batch.status = status;
      if (m.damage())
        for (std::uint32_t p = 0; p < (count + lanes - 1) / lanes * lanes; p++) {
          const double d = double(s.value(s.layout().damage, tile * lanes + p));
          rows[(int(p) / lanes * scratch.count + scratch.degradation) * lanes + int(p) % lanes] =
              T(1 - (1 - m.damage_model().residual) * d * (2 - d));
        }
      law.function(law.instance, &batch);
      f(i, tile * lanes, LawResults<T>{rows, scratch.count}, int(count));
    }
  });
}

template <class T, int D>
void MpmSimulation<T, D>::measure_waves() {
  Timer timer(*this, bound_stage);
  double fastest = 0;  // squared wave speed
  for (std::size_t s = 0; s < sets_.size(); s++) {
    const Material& m = *materials_[set_material_[s]];
    const BoundLaw law = m.measure<T>(Material::Measure::wave_modulus);
    if (!law.function) continue;
    std::vector<double> largest(sets_[s]->blocks().size(), 0.0);
    evaluate(s, law, measure_scratch, [&](std::size_t block, std::uint64_t, const LawResults<T>& modulus, int count) {
      for (int p = 0; p < count; p++)
        if (modulus(0, p) > largest[block]) largest[block] = modulus(0, p);
    });
    for (double modulus : largest) fastest = std::max(fastest, modulus / m.density());
  }
  wave_step_ = fastest > 0 ? scene_.simulation.cfl * cell_size_ / std::sqrt(fastest) : std::numeric_limits<double>::infinity();
  waves_at_ = steps_;
  strained_ = 0;
}

template <class T, int D>
Bound MpmSimulation<T, D>::largest_step() {
  if (needs_sort_ || sorts_always_) sort();
  const auto& sim = scene_.simulation;
  Bound bound{std::numeric_limits<double>::infinity(), "frame"};
  const auto consider = [&](double seconds, const char* name) {
    if (seconds < bound.seconds) bound = {seconds, name};
  };
  if (sim.time_step) {
    consider(*sim.time_step, "fixed");
    return bound;
  }
  const double speed = std::max({maximum_speed_, colliders_.maximum_speed(time_), handles_.maximum_speed(time_)});
  // a particle moves less than half a cell; gravity alone may still speed it up during the step
  const double g = sim.gravity.norm(), half = 0.5 * cell_size_;
  if (speed > 0 || g > 0) consider(2 * half / (speed + std::sqrt(speed * speed + 4 * g * half)), "particle speed");
  if (sim.maximum_time_step > 0) consider(sim.maximum_time_step, "maximum");
  double damage_step = std::numeric_limits<double>::infinity();
  for (const auto& d : damage_)
    if (d) damage_step = std::min(damage_step, d->stable_step());
  consider(damage_step, "explicit damage");
  if (sim.integrator == config::Integrator::implicit) return bound;

  Bound implicit = bound;
  if (1 / sim.frame_rate < implicit.seconds) implicit = {1 / sim.frame_rate, "frame"};
  if (steps_ - waves_at_ >= wave_interval || strained_ > wave_strain) measure_waves();
  consider(wave_step_, "elastic wave");
  if (sim.integrator == config::Integrator::symplectic) return bound;

  symplectic_step_ = bound.seconds;
  const auto said = choice_.choose({.symplectic = bound, .implicit = implicit},
                                   [&](double most) { return try_implicit_step(implicit.seconds, most); });
  if (said) spdlog::info("t = {:.6g} s: {}", time_, *said);
  return choice_.implicit() ? implicit : bound;
}

// ------------------------------------------------------------------------------------------------- damage

template <class T, int D>
void MpmSimulation<T, D>::drive_damage(double dt) {
  Timer timer(*this, damage_stage);
  std::vector<BlockReport> reports;
  for (std::size_t s = 0; s < sets_.size(); s++)
    if (damage_[s]) {
      damage_[s]->drive(view(s), *sets_[s], dt, reports);
      check(reports, s, "damage");
    }
}

template <class T, int D>
void MpmSimulation<T, D>::evolve_damage(double dt) {
  Timer timer(*this, damage_stage);
  for (std::size_t s = 0; s < sets_.size(); s++) {
    if (!damage_[s]) continue;
    if (const double bound = damage_[s]->stable_step(); scene_.simulation.time_step && dt > bound * (1 + 1e-9)) {
      const Material& m = *materials_[set_material_[s]];
      throw SimulationError(fmt::format(
          "step {} at t = {:.6g} s: the fixed step of {:.3g} s is above {:.3g} s, the most that the explicit evolution of "
          "damage "
          "of material '{}' allows under its present driving force; give a smaller simulation.time_step or \"auto\", or "
          "integration = \"implicit\" in its damage law",
          steps_, time_, dt, bound, m.name()));
    }
    damage_[s]->evolve(view(s), *sets_[s], grid_, dt);
  }
}

/// Explicit damage that cannot work at the size of the steps, said before the run.
template <class T, int D>
void MpmSimulation<T, D>::check_damage_step() {
  const auto& sim = scene_.simulation;
  for (std::size_t s = 0; s < sets_.size(); s++) {
    if (!damage_[s]) continue;
    const config::Material& m = scene_.materials[set_material_[s]];
    const double bound = damage_[s]->step_bound(0), step = sim.time_step ? *sim.time_step : wave_step_;
    if (sim.time_step && step > bound)
      throw InputError(error_at(m.damage->where) +
                       fmt::format("explicit evolution of damage takes steps of at most {:.3g} s here, simulation.time_step is "
                                   "{:.3g} s; give a smaller one or \"auto\", or integration = \"implicit\"",
                                   bound, step));
    if (bound < step / explicit_damage_limit)
      throw InputError(error_at(m.damage->where) +
                       fmt::format("explicit evolution of damage takes steps of at most {:.3g} s here, {:.0f} times less than "
                                   "elasticity ({:.3g} s); give integration = \"implicit\", which has no such limit, or a "
                                   "larger viscosity",
                                   bound, step / bound, step));
    if (bound < step / 2)
      spdlog::warn(
          "material '{}': explicit evolution of damage limits the step to {:.3g} s, {:.1f} times less than elasticity; "
          "integration = \"implicit\" has no such limit",
          m.name, bound, step / bound);
  }
}

template <class T, int D>
void MpmSimulation<T, D>::check_fixed_step() {
  const auto& sim = scene_.simulation;
  if (!sim.time_step || sim.integrator == config::Integrator::implicit || warned_step_) return;
  const double stable = wave_step_ / sim.cfl;
  if (*sim.time_step <= stable) return;
  warned_step_ = true;
  spdlog::warn(
      "t = {:.6g} s: the fixed step of {:.3g} s is above {:.3g} s, which elastic waves allow (CFL 1): energy may grow from "
      "step "
      "to step; give time_step = \"auto\", or integrator = \"implicit\". Said once",
      time_, *sim.time_step, stable);
}

// ------------------------------------------------------------------------------------------------- a step

template <class T, int D>
void MpmSimulation<T, D>::particles_to_grid(StepView& step, bool stress) {
  Timer timer(*this, to_grid_stage);
  const bool flip = step.scheme == TransferScheme::flip;
  const T no_change[3] = {};
  for (int pass = flip ? 0 : 1; pass < 2; pass++) {
    step.stress = stress && pass == 1;
    step.grid = pass == 1 ? grid_.data() : grid_.before();
    grid_.clear(static_cast<T*>(step.grid));
    for (std::size_t s = 0; s < sets_.size(); s++) {
      const ParticleView particles = view(s);
      const auto& blocks = sets_[s]->blocks();
      std::vector<BlockReport> reports(blocks.size());
      for_coloured(*sets_[s], scratch_, [&](std::size_t i, void* memory) {
        kernels_.particle_to_grid(particles, blocks[i], step, memory, reports[i]);
      });
      check(reports, s, "particles to grid");
    }
    if (pass == 0) {  // FLIP compares with the velocities before forces
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid_.blocks(), 64), [&](const auto& range) {
        kernels_.grid_update(static_cast<T*>(step.grid), range.begin(), range.end(), no_change);
      });
      step.grid_before = step.grid;
    }
  }
}

template <class T, int D>
void MpmSimulation<T, D>::add_gravity(double dt) {
  T change[3];
  for (int a = 0; a < 3; a++) change[a] = a < D ? T(scene_.simulation.gravity[a] * dt) : T(0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid_.blocks(), 64),
                    [&](const auto& range) { kernels_.grid_update(grid_.data(), range.begin(), range.end(), change); });
}

template <class T, int D>
void MpmSimulation<T, D>::hold_handles(const StepView& step, std::vector<HeldNode>* held) {
  if (!handles_.any()) return;
  std::vector<double> densities;
  for (auto m : set_material_) densities.push_back(materials_[m]->density() / reference_density_);
  handles_.apply(grid_, std::as_const(*this).sets(), densities, step.start, step.time_step, held);
}

template <class T, int D>
void MpmSimulation<T, D>::update_grid(const StepView& step) {
  Timer timer(*this, grid_stage);
  add_gravity(step.time_step);
  std::vector<HeldNode>* const held = constraints_ ? &held_nodes_ : nullptr;
  held_nodes_.clear();
  hold_handles(step, held);
  colliders_.apply(grid_, step.start + step.time_step, held);
}

template <class T, int D>
auto MpmSimulation<T, D>::solve(const StepView& step, double most) -> Solve {
  Timer timer(*this, implicit_stage);
  add_gravity(step.time_step);
  std::vector<typename ImplicitStep<T, D>::Part> parts;
  for (std::size_t s = 0; s < sets_.size(); s++) {
    const Watches& laws = *watches_[set_material_[s]];
    parts.push_back({sets_[s].get(), view(s), materials_[set_material_[s]].get(), laws.implicit_response.watched(),
                     laws.implicit_differential.watched()});
  }
  held_nodes_.clear();
  hold_handles(step, &held_nodes_);
  auto boundary = ImplicitBoundary<T, D>(held_nodes_, colliders_.contacts(grid_, step.start + step.time_step), grid_.data());
  auto outcome = implicit_->solve(grid_, parts, boundary, step.time_step, scene_.simulation.gravity * step.time_step, most);
  held_nodes_ = boundary.held();
  return outcome;
}

template <class T, int D>
std::optional<SolveWork> MpmSimulation<T, D>::try_implicit_step(double dt, double most) {
  StepView step = step_view(time_, dt);
  particles_to_grid(step, false);
  implicit_->forget();
  const Solve outcome = solve(step, most);
  implicit_->forget();
  return outcome.solved ? std::optional(outcome.work) : std::nullopt;
}

template <class T, int D>
bool MpmSimulation<T, D>::solve_grid(const StepView& step, bool has_to) {
  const Solve outcome = solve(step, std::numeric_limits<double>::infinity());
  work_ += outcome.work;
  implicit_solves_++;
  newton_iterations_ += outcome.newton_iterations;
  linear_iterations_ += outcome.linear_iterations;
  if (outcome.solved || !has_to) return outcome.solved;
  const std::string what = "implicit step: " + outcome.problem;
  if (outcome.failed_law) fail(outcome.part, outcome.report, what.c_str());
  throw SimulationError(
      fmt::format("step {} at t = {:.6g} s, dt = {:.3g} s, {}, even with steps of {:.3g} s; give a smaller "
                  "simulation.maximum_time_step, or "
                  "more simulation.implicit.maximum_iterations",
                  steps_, step.start, time_step_, what, step.time_step));
}

template <class T, int D>
void MpmSimulation<T, D>::apply_constraints(const StepView& step) {
  Timer timer(*this, constraint_stage);
  try {
    constraints_->project(grid_, std::as_const(*this).sets(), held_nodes_, step.time_step);
  } catch (const SimulationError& e) {
    throw SimulationError(
        fmt::format("step {} at t = {:.6g} s, dt = {:.3g} s, constraint: {}", steps_, time_, time_step_, e.what()));
  }
  // A constraint may push what was about to leave a collider into it.
  colliders_.apply(grid_, step.start + step.time_step);
}

template <class T, int D>
std::optional<std::string> MpmSimulation<T, D>::grid_to_particles(const StepView& step, bool trial, bool may_be_too_large) {
  Timer timer(*this, to_particles_stage);
  std::vector<Set*> moved = sets();
  for (std::size_t s = 0; s < sets_.size(); s++)
    if (trial && !damage_[s]) moved[s] = nullptr;
  std::vector<std::vector<Vector3>> held;
  if (handles_.any()) held = handles_.positions({moved.begin(), moved.end()});
  maximum_speed_ = 0;
  for (std::size_t s = 0; s < sets_.size(); s++) {
    if (!moved[s]) continue;
    const ParticleView particles = view(s);
    const auto& blocks = sets_[s]->blocks();
    std::vector<BlockReport> reports(blocks.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks.size(), 4), [&](const auto& range) {
      void* memory = scratch();
      for (std::size_t i = range.begin(); i < range.end(); i++)
        kernels_.grid_to_particle(particles, blocks[i], step, memory, reports[i]);
    });
    for (const auto& r : reports) {
      maximum_speed_ = std::max(maximum_speed_, r.maximum_speed);
      needs_sort_ = needs_sort_ || r.strayed;
    }
    if (may_be_too_large)
      if (auto problem = too_large(reports, s, step)) return problem;
    check(reports, s, "grid to particles");
  }
  if (handles_.any() && handles_.move(moved, held, step.start, step.time_step)) needs_sort_ = true;
  return std::nullopt;
}

// ------------------------------------------------------------------------------------------------- failure

template <class T, int D>
auto MpmSimulation<T, D>::watch(std::size_t material) -> std::unique_ptr<Watches> {
  const Material& m = *materials_[material];
  const config::Material& given = scene_.materials[material];
  BatchOrigin origin{.material = m.name(),
                     .failed = {},
                     .single = std::is_same_v<T, float>,
                     .dimension = D,
                     .cell_size = cell_size_,
                     .density = m.density(),
                     .laws = {},
                     .wanted = {}};
  const auto list = [&](const plugins::Instance& law, const config::PluginUse& use) {
    origin.laws.push_back({law.description().id, law.description().version, use.parameters});
  };
  list(m.elasticity(), given.elasticity);
  if (m.plasticity()) list(m.plasticity(), *given.plasticity);
  if (m.damage()) list(m.damage(), *given.damage);
  const auto header = [&](const plugins::Instance& law, const BoundLaw& call) {
    if (!law) return std::string();
    origin.failed = law.description().id;
    origin.wanted = LawWatch::outputs_of(call);
    return batch_header(origin);
  };
  const auto watched = [&](const plugins::Instance& law, const BoundLaw& call) {
    return LawWatch(call, origin.single, header(law, call), failed_batches_);
  };
  return std::unique_ptr<Watches>(
      new Watches{watched(m.elasticity(), m.stress<T>()), watched(m.elasticity(), m.degraded_stress<T>()),
                  watched(m.plasticity(), m.return_mapping<T>()), watched(m.elasticity(), m.damage_inputs<T>()),
                  watched(m.damage(), m.driving_force<T>()), watched(m.elasticity(), m.implicit_response<T>()),
                  watched(m.elasticity(), m.implicit_differential<T>())});
}

template <class T, int D>
std::string MpmSimulation<T, D>::failed_batch(const FailedBatches::Kept* kept, const Set& s) const {
  if (!kept) return {};
  std::vector<std::int64_t> ids;
  const std::uint64_t first = std::uint64_t(kept->first - s.data()) / s.layout().stride * lanes;
  for (std::uint64_t k = 0; k < kept->batch.count; k++) ids.push_back(s.id(first + k));
  std::string text;
  const Put append = [](void* sink, const char* part, std::size_t size) {
    static_cast<std::string*>(sink)->append(part, size);
  };
  const char* reason = kept->batch.result != CLEAVE_OK ? "error" : kept->batch.not_finite ? "not finite" : "status";
  write_batch(append, &text, kept->law->header().c_str(), reason, kept->batch, kept->law->single(), ids.data());
  return text;
}

template <class T, int D>
void MpmSimulation<T, D>::check(const std::vector<BlockReport>& reports, std::size_t set, const char* stage) {
  for (const auto& r : reports) {
    if (r.status >= CLEAVE_STATUS_RETRY || r.result != CLEAVE_OK || r.not_finite || r.inverted) fail(set, r, stage);
    if (r.status == CLEAVE_STATUS_UNRELIABLE && !warned_unreliable_) {
      warned_unreliable_ = true;
      const Material& m = *materials_[set_material_[set]];
      spdlog::warn("step {}: {} reports points outside its range of validity (material '{}'); said once", steps_,
                   failed_law(m, r).description().id, m.name());
    }
  }
}

template <class T, int D>
std::optional<std::string> MpmSimulation<T, D>::too_large(const std::vector<BlockReport>& reports, std::size_t set,
                                                          const StepView& step) const {
  for (const BlockReport& r : reports) {
    if (r.not_finite || r.result != CLEAVE_OK) return std::nullopt;
    if (!r.inverted && r.status < CLEAVE_STATUS_RETRY) continue;
    const std::string who = name_of(*sets_[set], r.slot);
    if (r.inverted)
      return fmt::format("a step of {:.3g} s {} {}", step.time_step,
                         step.least_volume_ratio > 0 ? "takes three quarters of its volume from" : "turns inside out", who);
    const Material& m = *materials_[set_material_[set]];
    return fmt::format("{} has no result for {} in a step of {:.3g} s", failed_law(m, r).description().id, who, step.time_step);
  }
  return std::nullopt;
}

template <class T, int D>
std::string MpmSimulation<T, D>::name_of(const Set& s, std::uint64_t slot) const {
  const std::uint32_t id = s.id(slot);
  const std::size_t body = std::size_t(std::upper_bound(first_id_.begin(), first_id_.end(), id) - first_id_.begin()) - 1;
  return fmt::format("particle {} (body '{}')", id, body_names_[body]);
}

template <class T, int D>
void MpmSimulation<T, D>::fail(std::size_t set, const BlockReport& r, const char* stage) {
  const Material& m = *materials_[set_material_[set]];
  const Set& s = *sets_[set];
  const auto& law = failed_law(m, r).description();
  const char* tile = r.slot == ~0ull ? nullptr : s.data() + r.slot / lanes * s.layout().stride;
  const auto* kept = failed_batches_.find(tile);
  failed_batch_ = failed_batch(kept, s);
  std::string what;
  if (r.not_finite)
    what = "velocity is not finite";
  else if (r.inverted)
    what = fmt::format("the material turned inside out within one step, where {} is not defined", law.id);
  else if (r.result != CLEAVE_OK)
    what = fmt::format("plugin {} {} failed with error {}", law.id, law.version, r.result);
  else if (kept && kept->batch.not_finite)
    what = fmt::format("plugin {} {} gives numbers that are not finite", law.id, law.version);
  else
    what = fmt::format("plugin {} {} has no valid result{}", law.id, law.version,
                       r.status == CLEAVE_STATUS_RETRY ? " for this step size; try a smaller simulation.time_step" : "");
  std::string who;
  const auto* block = r.slot == ~0ull ? nullptr : s.block_of(r.slot);
  if (block) {
    const std::uint32_t id = s.id(r.slot);
    const std::size_t body = std::size_t(std::upper_bound(first_id_.begin(), first_id_.end(), id) - first_id_.begin()) - 1;
    const Vector3 x = s.position(*block, r.slot) * cell_size_;
    who = fmt::format("particle {} (body '{}', material '{}') at ({:.6g}, {:.6g}, {:.6g}) m, J = {:.4g}", id, body_names_[body],
                      m.name(), x[0], x[1], x[2], s.jacobian(r.slot));
  } else {
    who = fmt::format("material '{}'", m.name());
  }
  throw SimulationError(
      fmt::format("step {} at t = {:.6g} s, dt = {:.3g} s, {}: {}: {}", steps_, time_, time_step_, stage, who, what));
}

// ------------------------------------------------------------------------------------------------- looking at it

template <class T, int D>
std::vector<std::string> MpmSimulation<T, D>::attributes() const {
  std::vector<std::string> names = {"J", "C", "stress"};
  for (const auto& s : sets_) {
    names.push_back(s->layout().stores_b ? "b" : "F");
    if (s->layout().damage) names.push_back("damage");
    if (s->layout().toughness) names.push_back("toughness");
  }
  for (const auto& m : materials_)
    for (const auto& state : m->states()) names.push_back(state.name);
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

template <class T, int D>
output::ParticleFrame MpmSimulation<T, D>::frame(int index) const {
  output::ParticleFrame f;
  f.index = index;
  f.time = time_;
  f.dimension = D;
  f.cell_size = cell_size_;
  f.bodies = body_names_;
  f.body_ends.assign(first_id_.begin() + 1, first_id_.end());
  const auto n = std::size_t(particle_count_);
  f.positions.resize(n);
  f.velocities.resize(n);
  f.volumes.resize(n);
  const auto& asked = scene_.output.attributes;
  const auto wanted = [&](const std::string& name, bool by_default) {
    return asked.empty() ? by_default : std::find(asked.begin(), asked.end(), name) != asked.end();
  };
  // Those of one name and shape are one; another shape gets another name.
  const auto attribute = [&](std::string name, int components, const std::string& unit) -> output::Attribute& {
    for (auto& a : f.attributes) {
      if (a.name != name) continue;
      if (a.components == components) return a;
      name += '_';
    }
    f.attributes.push_back({name, components, unit, std::vector<float>(n * std::size_t(components), 0.f)});
    return f.attributes.back();
  };
  const double cell_volume = std::pow(cell_size_, D);
  for (std::size_t k = 0; k < sets_.size(); k++) {
    const Set& s = *sets_[k];
    const Material& m = *materials_[set_material_[k]];
    const auto for_particles = [&s](const auto& read) {  // every one has a place of its own in the frame
      tbb::parallel_for(std::size_t(0), s.blocks().size(), [&](std::size_t i) {
        const auto& block = s.blocks()[i];
        for (std::uint32_t p = 0; p < block.count; p++) read(block, block.first_tile * lanes + p);
      });
    };
    for_particles([&](const auto& block, std::uint64_t slot) {
      const std::uint32_t id = s.id(slot);
      f.positions[id] = s.position(block, slot) * cell_size_;
      Eigen::Vector3f v = Eigen::Vector3f::Zero();
      for (int a = 0; a < D; a++) v[a] = float(s.value(s.layout().velocity, a, slot));
      f.velocities[id] = v;
      f.volumes[id] = float(double(s.value(s.layout().volume, slot)) * cell_volume);
    });
    if (wanted("J", true)) {
      auto& a = attribute("J", 1, "1");
      for_particles([&](const auto&, std::uint64_t slot) { a.values[s.id(slot)] = float(s.jacobian(slot)); });
    }
    if (m.damage() && wanted("damage", true)) {
      auto& a = attribute("damage", 1, "1");
      for_particles([&](const auto&, std::uint64_t slot) { a.values[s.id(slot)] = float(s.value(s.layout().damage, slot)); });
    }
    if (s.layout().toughness && wanted("toughness", false)) {
      auto& a = attribute("toughness", 1, "1");
      for_particles(
          [&](const auto&, std::uint64_t slot) { a.values[s.id(slot)] = float(s.value(s.layout().toughness, slot)); });
    }
    if (wanted("stress", false)) {
      auto& a = attribute("stress", 1, "Pa");
      evaluate(k, m.damage() ? m.template degraded_stress<T>() : m.template stress<T>(), stress_scratch,
               [&](std::size_t, std::uint64_t slot, const LawResults<T>& result, int count) {
                 for (int p = 0; p < count; p++) {
                   Eigen::Vector<double, 6> tau;
                   for (int c = 0; c < 6; c++) tau[c] = result(c, p);
                   const std::uint64_t at = slot + std::uint64_t(p);
                   a.values[s.id(at)] = float(von_mises_stress(tau, s.jacobian(at)));
                 }
               });
    }
    const char* strain = s.layout().stores_b ? "b" : "F";
    if (wanted(strain, false)) {
      auto& a = attribute(strain, 9, "1");
      for_particles([&](const auto&, std::uint64_t slot) {
        const Matrix3 x = s.deformation_or_b(slot);
        for (int i = 0; i < 9; i++) a.values[s.id(slot) * 9 + i] = float(x(i / 3, i % 3));
      });
    }
    if (wanted("C", false)) {
      auto& a = attribute("C", 9, "1/s");
      for_particles([&](const auto&, std::uint64_t slot) {
        for (int i = 0; i < D; i++)
          for (int j = 0; j < D; j++) a.values[s.id(slot) * 9 + i * 3 + j] = float(s.value(s.layout().affine, i * D + j, slot));
      });
    }
    int first = 0;
    for (const auto& state : m.states()) {
      const int components = int(state.tensor);
      if (wanted(state.name, true)) {
        auto& a = attribute(is_built_in(state.name) ? state.name + '_' : state.name, components, state.unit);
        for_particles([&](const auto&, std::uint64_t slot) {
          for (int c = 0; c < components; c++)
            a.values[s.id(slot) * components + c] = float(s.value(s.layout().state, first + c, slot));
        });
      }
      first += components;
    }
  }
  return f;
}

template <class T, int D>
std::vector<ParticleState> MpmSimulation<T, D>::state() const {
  std::vector<ParticleState> all(static_cast<std::size_t>(particle_count_));
  for (const auto& set : sets_) {
    const Set& s = *set;
    const TileLayout& l = s.layout();
    s.for_each([&](const auto& block, std::uint64_t slot) {
      ParticleState& p = all[s.id(slot)];
      p.id = s.id(slot);
      p.body = std::int32_t(std::upper_bound(first_id_.begin(), first_id_.end(), s.id(slot)) - first_id_.begin()) - 1;
      p.position = s.position(block, slot) * cell_size_;
      for (int a = 0; a < D; a++) {
        p.velocity[a] = double(s.value(l.velocity, a, slot));
        for (int j = 0; j < D; j++) p.velocity_gradient(a, j) = double(s.value(l.affine, a * D + j, slot));
      }
      p.volume = double(s.value(l.volume, slot)) * std::pow(cell_size_, D);
      p.stores_b = l.stores_b;
      p.strain = s.deformation_or_b(slot);
      if (l.damage) p.damage = double(s.value(l.damage, slot));
      for (int c = 0; c < l.state_components; c++) p.state.push_back(double(s.value(l.state, c, slot)));
    });
  }
  return all;
}

template <class T, int D>
output::FrameRecord MpmSimulation<T, D>::measure() {
  output::FrameRecord r;
  record_steps(r);
  r.halved_steps = std::exchange(halved_steps_, 0);
  r.under_sampled = double(under_sampled<T, D>(grid_, std::as_const(*this).sets())) / double(particle_count_);
  if (scene_.simulation.time_step && scene_.simulation.integrator != config::Integrator::implicit) {
    measure_waves();
    check_fixed_step();
  }
  r.minimum_J = std::numeric_limits<double>::infinity();
  r.maximum_J = -r.minimum_J;
  const double cell_volume = std::pow(cell_size_, D), inertia = cell_size_ * cell_size_ / 4;
  const Vector3 g = scene_.simulation.gravity;
  double damaged = 0, active = 0;
  std::int64_t solves = 0, iterations = 0, unconverged = 0;
  for (std::size_t k = 0; k < sets_.size(); k++) {
    const Set& s = *sets_[k];
    const TileLayout& l = s.layout();
    const double density = materials_[set_material_[k]]->density();
    struct Sum {
      double kinetic = 0, elastic = 0, gravity = 0, mass = 0, volume = 0, low = 1e300, high = -1e300, speed = 0, damage = 0,
             damaged = 0;
      Vector3 momentum = Vector3::Zero(), angular = Vector3::Zero(), moment = Vector3::Zero();
    };
    std::vector<Sum> sums(s.blocks().size());
    tbb::parallel_for(std::size_t(0), s.blocks().size(), [&](std::size_t i) {
      const auto& b = s.blocks()[i];
      Sum& sum = sums[i];
      for (std::uint32_t p = 0; p < b.count; p++) {
        const std::uint64_t slot = b.first_tile * lanes + p;
        const Vector3 x = s.position(b, slot) * cell_size_;
        Vector3 v = Vector3::Zero();
        Matrix3 C = Matrix3::Zero();
        for (int a = 0; a < D; a++) {
          v[a] = double(s.value(l.velocity, a, slot));
          for (int j = 0; j < D; j++) C(a, j) = double(s.value(l.affine, a * D + j, slot));
        }
        const double volume = double(s.value(l.volume, slot)) * cell_volume, m = density * volume, J = s.jacobian(slot);
        sum.kinetic += 0.5 * m * (v.squaredNorm() + inertia * C.squaredNorm());
        sum.gravity -= m * g.dot(x);
        sum.mass += m;
        sum.volume += volume * J;
        sum.momentum += m * v;
        sum.moment += m * x;
        sum.angular += m * (x.cross(v) + inertia * Vector3(C(2, 1) - C(1, 2), C(0, 2) - C(2, 0), C(1, 0) - C(0, 1)));
        sum.low = std::min(sum.low, J);
        sum.high = std::max(sum.high, J);
        sum.speed = std::max(sum.speed, v.norm());
        if (l.damage) {
          const auto d = double(s.value(l.damage, slot));
          sum.damage = std::max(sum.damage, d);
          if (d > 0.5) sum.damaged += volume;
        }
      }
    });
    if (const BoundLaw law = materials_[set_material_[k]]->template measure<T>(Material::Measure::energy); law.function)
      evaluate(k, law, measure_scratch, [&](std::size_t block, std::uint64_t slot, const LawResults<T>& energy, int count) {
        for (int p = 0; p < count; p++)
          sums[block].elastic += energy(0, p) * double(s.value(l.volume, slot + std::uint64_t(p))) * cell_volume;
      });
    for (const auto& sum : sums) {
      r.kinetic_energy += sum.kinetic;
      r.elastic_energy += sum.elastic;
      r.gravity_energy += sum.gravity;
      r.mass += sum.mass;
      r.volume += sum.volume;
      r.momentum += sum.momentum;
      r.angular_momentum += sum.angular;
      r.center_of_mass += sum.moment;
      r.minimum_J = std::min(r.minimum_J, sum.low);
      r.maximum_J = std::max(r.maximum_J, sum.high);
      r.maximum_speed = std::max(r.maximum_speed, sum.speed);
      r.maximum_damage = std::max(r.maximum_damage, sum.damage);
      damaged += sum.damaged;
      r.rest_volume += sum.mass / density;
    }
    if (damage_[k]) {
      const auto statistics = damage_[k]->take_statistics();
      solves += statistics.solves;
      iterations += statistics.iterations;
      r.damage_iterations_most = std::max(r.damage_iterations_most, statistics.most_iterations);
      unconverged += statistics.unconverged;
      if (statistics.steps) active += statistics.active_blocks / double(statistics.steps) * double(s.size());
    }
  }
  if (r.rest_volume > 0) r.damaged_fraction = damaged / r.rest_volume;
  if (solves) r.damage_iterations = double(iterations) / double(solves);
  r.damage_active = active / double(particle_count_);
  if (constraints_) {
    const auto statistics = constraints_->take_statistics();
    if (statistics.projections) r.constraint_iterations = double(statistics.iterations) / double(statistics.projections);
    r.constraint_residual = statistics.largest_residual;
  }
  if (const auto solves_of_steps = double(std::exchange(implicit_solves_, 0)); solves_of_steps > 0) {
    r.newton_iterations = double(std::exchange(newton_iterations_, 0)) / solves_of_steps;
    r.linear_iterations = double(std::exchange(linear_iterations_, 0)) / solves_of_steps;
  }
  if (unconverged && !std::exchange(warned_damage_, true))
    spdlog::warn(
        "t = {:.6g} s: {} implicit solves of damage stopped after {} iterations short of simulation.damage.tolerance; "
        "said once",
        time_, unconverged, scene_.simulation.damage.maximum_iterations);
  if (r.mass > 0) r.center_of_mass /= r.mass;
  return r;
}

template <class T, int D>
std::vector<std::pair<std::string, double>> MpmSimulation<T, D>::bytes_per_particle() const {
  std::vector<std::pair<std::string, double>> parts;
  const auto n = double(particle_count_);
  double total = 0;
  for (std::size_t k = 0; k < sets_.size(); k++) {
    const std::string prefix = sets_.size() > 1 ? materials_[set_material_[k]]->name() + ": " : "";
    for (const auto& part : sets_[k]->layout().parts) {
      const double bytes = double(part.components) * sizeof(T);
      parts.emplace_back(prefix + part.name, bytes);
      total += bytes * double(sets_[k]->size()) / n;
    }
    if (materials_[set_material_[k]]->constraint()) {
      const auto bytes = double(Constraints<T, D>::bytes_per_particle(sets_[k]->layout()));
      parts.emplace_back(prefix + "for the constraint, in double", bytes);
      total += bytes * double(sets_[k]->size()) / n;
    }
  }
  parts.emplace_back("id", 4.0);
  parts.emplace_back("total", total + 4.0);
  return parts;
}

}  // namespace

void Simulation::step(double target) {
  const Bound bound = largest_step();
  const double dt = equal_steps(target - time_, bound.seconds);
  limited_by_ = dt < 0.5 * bound.seconds ? "frame" : bound.name;
  limits_[limited_by_]++;
  smallest_bound_ = std::min(smallest_bound_, bound.seconds);
  if (!(dt > 0) || time_ + dt == time_)
    throw SimulationError(fmt::format("step {} at t = {:.6g} s: the stable step has shrunk to {:.3g} s ({})", steps_, time_,
                                      bound.seconds, bound.name));
  take_step(dt, target - (time_ + dt) < 1e-9 * dt ? target : time_ + dt);
}

void Simulation::take_step(double time_step, double end) {
  time_step_ = time_step;
  advance(time_step);
  time_ = end;
  steps_++;
}

void Simulation::save(checkpoint::StateWriter& writer, const std::string& prefix) const {
  checkpoint::pack(writer, prefix + "time", [this](auto& archive) { list(*this, archive); });
  save_state(writer, prefix);
}

void Simulation::restore(checkpoint::StateReader& reader, const std::string& prefix) {
  restore_state(reader, prefix);
  checkpoint::unpack(reader, prefix + "time", [this](auto& archive) { list(*this, archive); });
}

void Simulation::record_steps(output::FrameRecord& record) {
  record.time = time_;
  record.steps = steps_ - std::exchange(steps_at_record_, steps_);
  record.time_step = time_step_;
  const double bound = std::exchange(smallest_bound_, std::numeric_limits<double>::infinity());
  record.stable_step = std::isfinite(bound) ? bound : 0;
  record.limited_by = limited_by_;
}

void check_handles(const config::Scene& scene, const std::vector<std::size_t>& held) {
  for (std::size_t h = 0; h < held.size(); h++)
    if (!held[h])
      throw InputError(error_at(scene.handles[h].where) + "handle '" + scene.handles[h].name + "' holds no particle");
}

std::unique_ptr<Simulation> Simulation::create_part(const config::Scene& scene, plugins::Registry& registry) {
  if (const auto problems = unsupported(scene, registry); !problems.empty())
    throw InputError(fmt::format("{}", fmt::join(problems, "\n")));
  const bool single = scene.simulation.precision == config::Precision::single_precision;
  if (scene.simulation.dimension == 2) {
    if (single) return std::make_unique<MpmSimulation<float, 2>>(scene, registry);
    return std::make_unique<MpmSimulation<double, 2>>(scene, registry);
  }
  if (single) return std::make_unique<MpmSimulation<float, 3>>(scene, registry);
  return std::make_unique<MpmSimulation<double, 3>>(scene, registry);
}

std::unique_ptr<Simulation> Simulation::create(const config::Scene& scene, plugins::Registry& registry) {
  auto simulation = create_part(scene, registry);
  check_handles(scene, simulation->held());
  return simulation;
}

}  // namespace cleave::mpm
