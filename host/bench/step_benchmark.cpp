#include "bench/step_benchmark.hpp"

#include "bench/law_choice.hpp"
#include "bench/typical_parameters.hpp"
#include "bench/yielding.hpp"
#include "common/error.hpp"
#include "discretization/simulation.hpp"

#include <sys/resource.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>

namespace cleave::bench {
namespace {

using config::Precision;
using plugins::Description;
using plugins::GivenParameters;
using plugins::Kind;

constexpr double cell_size = 1.0 / 128, density = 1000;

/// A scene to measure and what to call it.
struct Case {
  std::string material;
  std::vector<std::pair<std::string, GivenParameters>> laws;
  Precision precision;
  int threads;
  std::function<config::Scene()> scene;
  bool may_fail;                ///< another case can be measured all the same
  int warm_up = 0;              ///< steps before the first sample
  const Law* flows = nullptr;   ///< the return mapping of which some particles yield
  std::size_t first_state = 0;  ///< of it, in the material
};

std::int64_t memory_of_machine() { return std::int64_t(sysconf(_SC_PHYS_PAGES)) * std::int64_t(sysconf(_SC_PAGESIZE)); }

std::int64_t peak_memory_of_process() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return std::int64_t(usage.ru_maxrss) * 1024;
}

tbb::global_control limit_threads(int threads) {
  return tbb::global_control(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
}

/// Samples simulations alternately.
class Sampler {
 public:
  Sampler(const StepSampling& sampling, plugins::Registry& registry, StepResults& results)
      : sampling_(sampling), registry_(registry), results_(results) {}

  void measure(const std::vector<Case>& cases) {
    const double budget = double(memory_of_machine()) / 3;
    double held = 0;
    for (const Case& c : cases) {
      attempt(c, [&] { held += start(c); });
      if (held < budget) continue;
      take_turn();
      held = 0;
    }
    only_one_ = cases.size() == 1;
    take_turn();
  }

 private:
  static constexpr double long_time = 1e6;  ///< seconds, so that no step is shortened to end at an instant

  struct Sample {
    double seconds = 0;
    std::vector<std::pair<std::string, double>> stage_seconds;
  };
  struct Run {
    const Case* of;
    std::unique_ptr<mpm::Simulation> simulation;
    std::vector<Sample> samples = {};
    bool failed = false;
  };

  template <class Action>
  bool attempt(const Case& c, Action action) {
    try {
      action();
      return true;
    } catch (const std::runtime_error& error) {
      if (!c.may_fail) throw;
      results_.skipped.emplace_back(c.material, error.what());
      return false;
    }
  }

  /// Returns about how many bytes it holds, with the grid and room to sort.
  double start(const Case& c) {
    const auto limit = limit_threads(c.threads);
    runs_.push_back({&c, discretization::simulate(c.scene(), registry_)});
    mpm::Simulation& simulation = *runs_.back().simulation;
    for (int i = 0; i < c.warm_up; ++i) simulation.step(simulation.time() + long_time);
    simulation.measure();  // iterations are counted from here on
    return 2 * simulation.bytes_per_particle().back().second * double(simulation.particles());
  }

  Sample sample(mpm::Simulation& simulation, int threads) const {
    const auto limit = limit_threads(threads);
    simulation.step(simulation.time() + long_time);  // what others did to the caches is none of its own
    Sample sample;
    sample.stage_seconds = simulation.stage_seconds();
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < sampling_.steps; ++i) simulation.step(simulation.time() + long_time);
    sample.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const auto after = simulation.stage_seconds();
    for (std::size_t i = 0; i < after.size(); ++i)
      sample.stage_seconds[i].second = after[i].second - sample.stage_seconds[i].second;
    return sample;
  }

  void take_turn() {
    for (int round = 0; round < sampling_.repeats; ++round)
      for (Run& run : runs_)
        if (!run.failed)
          run.failed = !attempt(*run.of, [&] { run.samples.push_back(sample(*run.simulation, run.of->threads)); });
    if (only_one_) results_.peak_memory = peak_memory_of_process();
    for (Run& run : runs_)
      if (!run.failed) attempt(*run.of, [&] { report(run); });
    if (!runs_.empty()) ++turn_;
    runs_.clear();
  }

  void report(Run& run) {
    mpm::Simulation& simulation = *run.simulation;
    const Case& of = *run.of;
    std::sort(run.samples.begin(), run.samples.end(), [](const Sample& a, const Sample& b) { return a.seconds < b.seconds; });
    const Sample& median = run.samples[run.samples.size() / 2];
    const double nanoseconds = 1e9 / (double(simulation.particles()) * sampling_.steps);
    StepResult result{.material = of.material,
                      .laws = of.laws,
                      .precision = of.precision,
                      .particles = simulation.particles(),
                      .threads = of.threads,
                      .turn = turn_,
                      .median = median.seconds * nanoseconds,
                      .fastest = run.samples.front().seconds * nanoseconds,
                      .stages = median.stage_seconds,
                      .bytes_per_particle = simulation.bytes_per_particle(),
                      .yielding = {},
                      .constraint_iterations = {},
                      .constraint_residual = {},
                      .newton_iterations = {},
                      .linear_iterations = {}};
    const auto record = simulation.measure();
    if (stage_is_there(result, "constraint")) {
      result.constraint_iterations = record.constraint_iterations;
      result.constraint_residual = record.constraint_residual;
    }
    if (record.newton_iterations > 0) {
      result.newton_iterations = record.newton_iterations;
      result.linear_iterations = record.linear_iterations;
    }
    if (of.flows) {
      const auto before = simulation.state();
      const double time = simulation.time();
      simulation.step(time + long_time);
      result.yielding = yielding_fraction(of.flows->instance, of.first_state, of.precision == Precision::single_precision,
                                          before, simulation.state(), simulation.time() - time);
    }
    for (auto& stage : result.stages) stage.second *= nanoseconds;
    if (result.laws.empty())
      for (const auto& plugin : simulation.plugins()) result.laws.emplace_back(plugin.id, GivenParameters{});
    results_.isa = simulation.isa();
    results_.results.push_back(std::move(result));
  }

  static bool stage_is_there(const StepResult& result, const char* name) {
    return std::any_of(result.stages.begin(), result.stages.end(), [&](const auto& stage) { return stage.first == name; });
  }

  const StepSampling& sampling_;
  plugins::Registry& registry_;
  StepResults& results_;
  std::vector<Run> runs_;
  int turn_ = 0;
  bool only_one_ = false;
};

/// Laws that go together, with parameters.
struct Block {
  std::string name;
  config::Material material;
  std::shared_ptr<const Law> flows;  ///< a return mapping of which some particles are to yield
  std::size_t first_state = 0;       ///< of it, in the material
  double wave_speed = 0;             ///< m/s, without fibres
  double stable_step = 0;            ///< s, at rest
  bool single = true, doubled = true;
};

/// A block at rest.
config::Scene block_scene(const Block& block, Precision precision, std::int64_t particles, int dimension) {
  config::Scene scene;
  auto& simulation = scene.simulation;
  simulation.dimension = dimension;
  simulation.cell_size = cell_size;
  simulation.precision = precision;
  scene.materials.push_back(block.material);
  config::Body body;
  body.name = "block";
  body.material = block.material.name;
  body.sampling.particles_per_cell = dimension == 3 ? 8 : 4;
  const double edge = std::pow(double(particles) / body.sampling.particles_per_cell, 1.0 / dimension) * cell_size;
  body.shape = scene::ShapeSpec{};
  body.shape->size = Vector3::Constant(edge);
  scene.bodies.push_back(body);
  return scene;
}

/// The same, flying a twentieth of a cell per step. Spinning pulls it apart with (0.03 c)^2 times the density, c being the wave
/// speed: a thousandth of the stiffness.
config::Scene moving_scene(const Block& block, Precision precision, std::int64_t particles, int dimension) {
  auto scene = block_scene(block, precision, particles, dimension);
  auto& body = scene.bodies.front();
  const double half = body.shape->size.x() / 2;
  body.velocity = cell_size / block.stable_step * Vector3(0.035, 0.018, dimension == 3 ? -0.03 : 0);
  body.spin.angular_velocity = Vector3(0, 0, 0.03 * block.wave_speed / half);
  return scene;
}

/// Three tenths of the particles shear in a block of their own, by so much in a step that every law that yields does after
/// `flow_steps`; the others fly, out of reach. `file` gets the particles that shear.
constexpr double flowing_part = 0.3, shear_per_step = 0.003;
constexpr int flow_steps = 60;
config::Scene flowing_scene(const Block& block, Precision precision, std::int64_t particles, int dimension,
                            const std::filesystem::path& file) {
  auto scene = moving_scene(block, precision, std::llround((1 - flowing_part) * double(particles)), dimension);
  scene.bodies.front().spin = {};  // nothing may yield there, however weak the law
  ShearingBlock sheared{.dimension = dimension,
                        .particles = std::llround(flowing_part * double(particles)),
                        .cell_size = cell_size,
                        .rate = shear_per_step / block.stable_step,
                        .velocity = scene.bodies.front().velocity};
  sheared.center[dimension - 1] = 1.5 * scene.bodies.front().shape->size.x() + 20 * cell_size;
  sheared.write(file);
  config::Body body;
  body.name = "sheared";
  body.material = block.material.name;
  body.particle_file = file;
  scene.bodies.push_back(body);
  return scene;
}

/// A block of 5:4:4 that hangs by its ends.
constexpr std::int64_t hanging_particles = 20 * 16 * 16 * 8;
config::Scene hanging_scene(const Block& block, Precision precision, std::int64_t particles, int dimension) {
  constexpr double width = 0.01;
  auto scene = block_scene(block, precision, particles, dimension);
  scene.simulation.cell_size = width;
  scene.simulation.time_step = 2e-4;
  scene.simulation.gravity[dimension - 1] = -9.81;
  const double cells = double(particles) / scene.bodies.front().sampling.particles_per_cell;
  const double fourth = dimension == 3 ? std::cbrt(cells / 80) : std::sqrt(cells / 20);
  const Vector3 size = width * Vector3(std::round(5 * fourth), std::round(4 * fourth), std::round(4 * fourth));
  scene.bodies.front().shape->size = size;
  for (const int side : {-1, 1}) {
    config::Handle handle;
    handle.name = side < 0 ? "left" : "right";
    handle.region.center = Vector3(side * (size.x() - width) / 2, 0, 0);
    handle.region.size = Vector3(width, size.y(), size.z());
    scene.handles.push_back(handle);
  }
  return scene;
}

/// A file that lives as long as this.
class TemporaryFile {
 public:
  TemporaryFile() {
    std::string name = (std::filesystem::temp_directory_path() / "cleave-bench-XXXXXX").string();
    if (!mkdtemp(name.data()))
      throw InputError("cannot make a directory in " + std::filesystem::temp_directory_path().string());
    directory_ = name;
  }
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove_all(directory_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  std::filesystem::path path() const { return directory_ / "particles.csv"; }

 private:
  std::filesystem::path directory_;
};

/// The materials that are asked for.
class Blocks {
 public:
  Blocks(const BlockOptions& options, plugins::Registry& registry, StepResults& results)
      : options_(options), registry_(registry), results_(results) {}

  std::vector<Block> make() {
    const auto wanted = wanted_materials();
    for (const auto& id : registry_.ids(Kind::elasticity)) {
      try {
        elastic_.add(make_law(registry_, id, given(id), 0, surroundings()));
      } catch (const InputError& error) {
        refused_[id] = error.what();
        if (options_.parameters.contains(id)) throw InputError("error: " + std::string(error.what()));
      }
    }
    for (std::size_t i = 0; i < wanted.size(); ++i)
      attempt(wanted[i], [&](const std::string& what) { refuse(options_.materials[i], what); });
    if (!wanted.empty()) return std::move(blocks_);
    for (const Kind kind : {Kind::elasticity, Kind::plasticity, Kind::damage})
      for (const auto& id : registry_.ids(kind))
        attempt({registry_.find(id)}, [&](const std::string& what) {
          if (options_.parameters.contains(id)) throw InputError("error: " + what);
          results_.skipped.emplace_back(id, what);
        });
    return std::move(blocks_);
  }

 private:
  using Laws = std::vector<const Description*>;

  plugins::Context surroundings() const {
    return {.dimension = options_.dimension, .cell_size = cell_size, .density = density};
  }
  GivenParameters given(const std::string& id) const {
    const auto found = options_.parameters.find(id);
    return found == options_.parameters.end() ? GivenParameters{} : found->second;
  }
  [[noreturn]] static void refuse(const std::string& material, const std::string& what) {
    throw InputError("--materials " + material + ": error: " + what);
  }

  /// At most one law of a kind, the elastic one first.
  std::vector<Laws> wanted_materials() const {
    std::vector<Laws> materials;
    for (const auto& text : options_.materials) {
      Laws laws(4, nullptr);
      for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find('+', begin), text.size());
        const std::string id = text.substr(begin, end - begin);
        const Description* law = registry_.find(id);
        if (id == "all") refuse(text, "\"all\" stands alone");
        if (id.empty()) refuse(text, "expected an ID, or IDs joined by +");
        if (!law) refuse(text, registry_.unknown_id(id));
        if (law->kind > Kind::constraint)
          refuse(text, "expected laws of elasticity, plasticity and damage, or a constraint; what " + id +
                           " does is measured with a scene");
        const Description*& place = laws[std::size_t(law->kind)];
        if (place) refuse(text, "two laws of " + std::string(name(law->kind)) + "; materials are separated by commas");
        place = law;
        begin = end + 1;
      }
      std::erase(laws, nullptr);
      materials.push_back(laws);
    }
    return materials;
  }

  std::size_t elastic_for(const Laws& laws) const {
    const Description& first = *laws.front();
    if (first.kind != Kind::elasticity) return elastic_.partner(laws, "");
    if (const auto refusal = refused_.find(first.id); refusal != refused_.end()) throw InputError(refusal->second);
    const Laws others(laws.begin() + 1, laws.end());
    try {
      return elastic_.partner(others, first.id);
    } catch (const InputError& error) {
      throw InputError(std::string(error.what()) + ", " + elastic_[elastic_.partner(others, "")].instance.description().id +
                       " does");
    }
  }

  template <class Otherwise>
  void attempt(const Laws& laws, Otherwise otherwise) {
    try {
      add(laws);
    } catch (const std::runtime_error& error) {
      otherwise(error.what());
    }
  }

  void add(const Laws& laws) {
    const std::size_t chosen = elastic_for(laws);
    const Law& elastic = elastic_[chosen];
    Block block;
    block.material.name = "material";
    block.material.density = density;
    const auto& probe = elastic_.probe(chosen);
    block.wave_speed = std::sqrt((probe.bulk_modulus + 4. / 3 * probe.shear_modulus) / density);
    std::shared_ptr<const Law> flows;
    std::uint64_t needs = 0;
    const auto take = [&](const Law& law) {
      const Description& d = law.instance.description();
      block.name += (block.name.empty() ? "" : " + ") + d.id;
      if (d.kind != Kind::constraint) {
        block.single = block.single && law.instance.can(CLEAVE_SINGLE);
        block.doubled = block.doubled && law.instance.can(CLEAVE_DOUBLE);
      }
      needs |= d.capabilities_with(law.parameters);
      return config::PluginUse{d.id, law.parameters, {}};
    };
    block.material.elasticity = take(elastic);
    for (const Description* law : laws) {
      if (law->kind == Kind::elasticity) continue;
      const std::shared_ptr<const Law> paired =
          elastic_.make_paired(registry_, law->id, given(law->id), chosen, surroundings());
      if (law->kind == Kind::plasticity) {
        block.material.plasticity = take(*paired);
        flows = paired;
      } else {
        (law->kind == Kind::damage ? block.material.damage : block.material.constraint) = take(*paired);
      }
    }
    lay_fibers(block.material, needs);
    if (block.material.constraint) soften(block, given(block.material.elasticity.id));
    blocks_.push_back(with_stable_step(block));
    if (flows && !block.material.constraint) {
      block = blocks_.back();
      block.name += ", yielding";
      block.flows = flows;
      block.first_state = std::size_t(elastic.instance.description().state_components());
      blocks_.push_back(block);
    }
    if (laws.size() == 1 && laws[0]->kind == Kind::elasticity) add_with_fibers(block, elastic);
  }

  /// Everything elastic that is in Pa: 10 kPa.
  void soften(Block& block, const GivenParameters& parameters) {
    block.material.elasticity.parameters =
        make_law(registry_, block.material.elasticity.id, parameters, 1e4, surroundings())->parameters;
  }

  static void lay_fibers(config::Material& material, std::uint64_t needs) {
    if (!(needs & (CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER))) return;
    material.fibers = config::Fibers{};
    if (needs & CLEAVE_NEEDS_SECOND_FIBER) material.fibers->second = Vector3::UnitY();
  }

  /// An elastic law once more, with the fibres it can have.
  void add_with_fibers(Block block, const Law& law) {
    auto fibrous = fiber_parameters(law.instance.description());
    if (fibrous.empty() || law.instance.can(CLEAVE_NEEDS_FIBER)) return;
    fibrous.insert(law.parameters.begin(), law.parameters.end());
    block.name += " with fibres";
    block.material.elasticity.parameters = fibrous;
    lay_fibers(block.material, law.instance.description().capabilities_with(fibrous));
    blocks_.push_back(with_stable_step(std::move(block)));
  }

  Block with_stable_step(Block block) {
    constexpr std::int64_t few = 512;
    const Precision precision = block.single ? Precision::single_precision : Precision::double_precision;
    const auto scene = block_scene(block, precision, few, options_.dimension);
    block.stable_step = discretization::simulate(scene, registry_)->largest_step().seconds;
    return block;
  }

  const BlockOptions& options_;
  plugins::Registry& registry_;
  StepResults& results_;
  ElasticLaws elastic_;
  std::map<std::string, std::string> refused_;  ///< elastic laws without typical parameters, and what they say
  std::vector<Block> blocks_;
};

}  // namespace

StepResults measure_steps(const BlockOptions& options, const StepSampling& sampling, plugins::Registry& registry) {
  StepResults results;
  results.dimension = options.dimension;
  results.sampling = sampling;
  Blocks made(options, registry, results);  // laws of its own keep what others are made on
  const auto blocks = made.make();
  const TemporaryFile sheared;
  std::vector<Case> cases;
  const auto sizes = options.particles.empty() ? std::vector<std::int64_t>{0} : options.particles;
  for (const std::int64_t size : sizes)
    for (const Precision precision : sampling.precisions)
      for (const Block& block : blocks) {
        const bool single = precision == Precision::single_precision;
        const std::int64_t particles = size ? size : block.material.constraint ? hanging_particles : 1000000;
        if (!(single ? block.single : block.doubled)) {
          if (size == sizes.front())
            results.skipped.emplace_back(block.name, single ? "offers no single precision" : "offers no double precision");
          continue;
        }
        std::vector<std::pair<std::string, GivenParameters>> laws;
        const auto& m = block.material;
        for (const auto* use : {&m.elasticity, m.plasticity ? &*m.plasticity : nullptr, m.damage ? &*m.damage : nullptr,
                                m.constraint ? &*m.constraint : nullptr})
          if (use) laws.emplace_back(use->id, use->parameters);
        for (const int threads : sampling.threads)
          cases.push_back({block.name, laws, precision, threads,
                           [&block, &sheared, precision, particles, dimension = options.dimension] {
                             if (block.flows) return flowing_scene(block, precision, particles, dimension, sheared.path());
                             return (block.material.constraint ? hanging_scene : moving_scene)(block, precision, particles,
                                                                                               dimension);
                           },
                           options.materials.empty(), block.flows ? flow_steps : 0, block.flows.get(), block.first_state});
      }
  Sampler(sampling, registry, results).measure(cases);
  return results;
}

StepResults measure_steps(const config::Scene& scene, const StepSampling& sampling, plugins::Registry& registry) {
  StepResults results;
  results.dimension = scene.simulation.dimension;
  results.sampling = sampling;
  std::vector<Case> cases;
  for (const Precision precision : sampling.precisions)
    for (const int threads : sampling.threads)
      cases.push_back({scene.file.stem().string(),
                       {},
                       precision,
                       threads,
                       [&scene, precision] {
                         config::Scene as_asked = scene;
                         as_asked.simulation.precision = precision;
                         return as_asked;
                       },
                       false});
  Sampler(sampling, registry, results).measure(cases);
  return results;
}

}  // namespace cleave::bench
