#include "bench/kernel_benchmark.hpp"

#include "bench/law_batch.hpp"
#include "bench/law_choice.hpp"
#include "bench/typical_parameters.hpp"
#include "common/error.hpp"
#include "common/types.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <random>

namespace cleave::bench {
namespace {

using plugins::Instance;
using plugins::Kind;

constexpr double cell_size = 0.01, density = 1000;
constexpr double moderate_strain = 0.1, strain_near_rest = 1e-6;

std::string isa_of(const plugins::Plugin& plugin) {
  const std::string folder = plugin.path().parent_path().filename().string();
  return folder.starts_with("x86-64-") ? folder : "baseline";
}

/// Deformations with the symmetric strains `amplitude` times `directions`, turned.
class States {
 public:
  explicit States(unsigned seed) : random_(seed) {}

  Matrix3 rotation() {
    const Vector3 axis(uniform(), uniform(), uniform());
    return Eigen::AngleAxisd(3 * uniform(), axis.norm() > 1e-3 ? axis.normalized() : Vector3::UnitX()).toRotationMatrix();
  }
  Matrix3 strain_direction() {
    const Matrix3 a = Matrix3::NullaryExpr([this] { return uniform(); });
    return (a + a.transpose()).normalized();
  }
  std::vector<Matrix3> strained(std::size_t count, double amplitude) {
    std::vector<Matrix3> all;
    for (std::size_t k = 0; k < count; ++k) all.push_back(rotation() * (Matrix3::Identity() + amplitude * strain_direction()));
    return all;
  }
  std::mt19937& random() { return random_; }

 private:
  double uniform() { return std::uniform_real_distribution<double>(-1, 1)(random_); }
  std::mt19937 random_;
};

constexpr int symmetric_row[6] = {0, 1, 2, 0, 0, 1}, symmetric_column[6] = {0, 1, 2, 1, 2, 2};

template <class T>
constexpr cleave_capability precision_of = sizeof(T) == 4 ? CLEAVE_SINGLE : CLEAVE_DOUBLE;

template <class T>
auto function_of(const Instance& law) {
  constexpr bool single = sizeof(T) == 4;
  switch (law.description().kind) {
    case Kind::elasticity:
      return single ? law.elasticity().evaluate_f32 : law.elasticity().evaluate_f64;
    case Kind::plasticity:
      return single ? law.plasticity().return_map_f32 : law.plasticity().return_map_f64;
    default:
      return single ? law.damage().drive_f32 : law.damage().drive_f64;
  }
}

cleave_field_id strain_field(const Instance& law) { return law.can(CLEAVE_ACCEPTS_B) ? CLEAVE_FIELD_B : CLEAVE_FIELD_F; }
int strain_components(const Instance& law) { return law.can(CLEAVE_ACCEPTS_B) ? 6 : 9; }
bool reads_strain(const Instance& law) { return law.can(CLEAVE_ACCEPTS_B) || law.can(CLEAVE_ACCEPTS_F); }

/// Strain, fibres and state of a law: inputs that every kind may read.
template <class T>
void add_common_inputs(LawBatch<T>& batch, const Instance& law) {
  if (reads_strain(law)) batch.add_input(strain_field(law), strain_components(law));
  if (law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER)) batch.add_input(CLEAVE_FIELD_FIBER, 3);
  if (law.can(CLEAVE_NEEDS_SECOND_FIBER)) batch.add_input(CLEAVE_FIELD_SECOND_FIBER, 3);
  const int variables = law.description().state_components();
  if (variables == 0) return;
  batch.add_input(CLEAVE_FIELD_STATE, variables);
  batch.add_output(CLEAVE_FIELD_STATE_OUT, variables);
}
template <class T>
void set_common_inputs(LawBatch<T>& batch, const Instance& law, const std::vector<Matrix3>& states) {
  States frames(5);
  const auto initial = law.initial_state();
  for (std::size_t k = 0; k < states.size(); ++k) {
    if (law.can(CLEAVE_ACCEPTS_B)) {
      const Matrix3 b = states[k] * states[k].transpose();
      for (int i = 0; i < 6; ++i) batch.set(CLEAVE_FIELD_B, i, k, b(symmetric_row[i], symmetric_column[i]));
    } else if (law.can(CLEAVE_ACCEPTS_F)) {
      for (int i = 0; i < 9; ++i) batch.set(CLEAVE_FIELD_F, i, k, states[k](i / 3, i % 3));
    }
    const Matrix3 frame = frames.rotation();
    for (int i = 0; i < 3; ++i) {
      if (law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER)) batch.set(CLEAVE_FIELD_FIBER, i, k, frame(i, 0));
      if (law.can(CLEAVE_NEEDS_SECOND_FIBER)) batch.set(CLEAVE_FIELD_SECOND_FIBER, i, k, frame(i, 1));
    }
    for (std::size_t i = 0; i < initial.size(); ++i) batch.set(CLEAVE_FIELD_STATE, int(i), k, initial[i]);
  }
}

/// Throws InputError where a point has no result: what would be measured is not the law.
template <class T>
void check_call(LawBatch<T>& batch, const Instance& law) {
  if (batch.call(function_of<T>(law), law) != CLEAVE_OK) throw InputError("refuses the batch");
  std::size_t failed = 0;
  for (std::size_t k = 0; k < batch.points(); ++k) failed += !batch.usable(k);
  if (failed > 0) throw InputError(std::to_string(failed) + " of " + std::to_string(batch.points()) + " points have no result");
}

template <class T>
LawBatch<T> stress_batch(const Instance& law, const std::vector<Matrix3>& states) {
  LawBatch<T> batch(states.size());
  add_common_inputs(batch, law);
  batch.add_output(CLEAVE_FIELD_TAU, 6);
  batch.allocate();
  set_common_inputs(batch, law, states);
  return batch;
}

/// P, or its derivative along random directions, at deformation gradients: what implicit steps ask of an elastic law.
template <class T>
LawBatch<T> implicit_batch(const Instance& law, const std::vector<Matrix3>& states, cleave_field_id output) {
  const bool fiber = law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER);
  const bool second_fiber = law.can(CLEAVE_NEEDS_SECOND_FIBER), along = output == CLEAVE_FIELD_DELTA_P;
  LawBatch<T> batch(states.size());
  batch.add_input(CLEAVE_FIELD_F, 9);
  if (along) batch.add_input(CLEAVE_FIELD_DELTA_F, 9);
  if (fiber) batch.add_input(CLEAVE_FIELD_FIBER, 3);
  if (second_fiber) batch.add_input(CLEAVE_FIELD_SECOND_FIBER, 3);
  batch.add_output(output, 9);
  batch.allocate();
  States frames(5), directions(6);
  for (std::size_t k = 0; k < states.size(); ++k) {
    const Matrix3 frame = frames.rotation(), direction = directions.rotation() * directions.strain_direction();
    for (int i = 0; i < 9; ++i) {
      batch.set(CLEAVE_FIELD_F, i, k, states[k](i / 3, i % 3));
      if (along) batch.set(CLEAVE_FIELD_DELTA_F, i, k, direction(i / 3, i % 3));
    }
    for (int i = 0; i < 3; ++i) {
      if (fiber) batch.set(CLEAVE_FIELD_FIBER, i, k, frame(i, 0));
      if (second_fiber) batch.set(CLEAVE_FIELD_SECOND_FIBER, i, k, frame(i, 1));
    }
  }
  return batch;
}

template <class T>
LawBatch<T> return_batch(const Instance& law, const std::vector<Matrix3>& states) {
  LawBatch<T> batch(states.size());
  add_common_inputs(batch, law);
  batch.add_output(law.can(CLEAVE_ACCEPTS_B) ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT, strain_components(law));
  batch.add_output(CLEAVE_FIELD_YIELDED, 1);
  batch.allocate();
  set_common_inputs(batch, law, states);
  return batch;
}

template <class T>
LawBatch<T> damage_batch(const Instance& law, const Instance& elastic, const std::vector<Matrix3>& states) {
  const bool energy = law.can(CLEAVE_NEEDS_TENSILE_ENERGY), stress = law.can(CLEAVE_NEEDS_EFFECTIVE_STRESS);
  LawBatch<T> driving(states.size());
  add_common_inputs(driving, elastic);
  if (energy) driving.add_output(CLEAVE_FIELD_TENSILE_ENERGY, 1);
  if (stress) driving.add_output(CLEAVE_FIELD_EFFECTIVE_STRESS, 6);
  driving.allocate();
  set_common_inputs(driving, elastic, states);
  check_call(driving, elastic);

  LawBatch<T> batch(states.size());
  add_common_inputs(batch, law);
  batch.add_input(CLEAVE_FIELD_DAMAGE, 1);
  if (energy) batch.add_input(CLEAVE_FIELD_TENSILE_ENERGY_IN, 1);
  if (stress) batch.add_input(CLEAVE_FIELD_EFFECTIVE_STRESS_IN, 6);
  batch.add_output(law.can(CLEAVE_DAMAGE_IS_LOCAL) ? CLEAVE_FIELD_DAMAGE_OUT : CLEAVE_FIELD_DRIVING_FORCE, 1);
  batch.allocate();
  set_common_inputs(batch, law, states);
  for (std::size_t k = 0; k < states.size(); ++k) {
    batch.set(CLEAVE_FIELD_DAMAGE, 0, k, 0.1);
    if (energy) batch.set(CLEAVE_FIELD_TENSILE_ENERGY_IN, 0, k, driving.get(CLEAVE_FIELD_TENSILE_ENERGY, 0, k));
    for (int i = 0; stress && i < 6; ++i)
      batch.set(CLEAVE_FIELD_EFFECTIVE_STRESS_IN, i, k, driving.get(CLEAVE_FIELD_EFFECTIVE_STRESS, i, k));
  }
  return batch;
}

/// States a return mapping leaves alone and states it returns, as close to each other as a ladder of strains tells.
struct YieldStates {
  std::vector<Matrix3> elastic, yielding;
};
template <class T>
YieldStates find_yield(const Instance& law) {
  constexpr std::size_t directions = 96;
  constexpr int rungs = 19;
  States states(7);
  std::vector<Matrix3> turned, along;
  for (std::size_t k = 0; k < directions; ++k) {
    turned.push_back(states.rotation());
    along.push_back(states.strain_direction());
  }
  const auto at = [&](std::size_t k, int rung) -> Matrix3 {
    return turned[k] * (Matrix3::Identity() + std::ldexp(strain_near_rest, rung) * along[k]);
  };
  enum Behaviour { elastic, yields, unknown };
  std::vector<std::array<Behaviour, rungs>> ladder(directions);
  for (int rung = 0; rung < rungs; ++rung) {
    std::vector<Matrix3> level;
    for (std::size_t k = 0; k < directions; ++k) level.push_back(at(k, rung));
    auto batch = return_batch<T>(law, level);
    if (batch.call(function_of<T>(law), law) != CLEAVE_OK) throw InputError("refuses the batch");
    for (std::size_t k = 0; k < directions; ++k)
      ladder[k][std::size_t(rung)] = !batch.usable(k) ? unknown : batch.get(CLEAVE_FIELD_YIELDED, 0, k) != 0 ? yields : elastic;
  }
  YieldStates found;
  for (std::size_t k = 0; k < directions; ++k) {
    const auto first = std::find_if(ladder[k].begin(), ladder[k].end(), [](Behaviour b) { return b != elastic; });
    const int rung = int(first - ladder[k].begin());
    if (rung > 0) found.elastic.push_back(at(k, std::min(rung - 1, 13)));  // strains below 1 %
    if (first == ladder[k].end() || *first != yields) continue;
    const bool beyond = rung + 1 < rungs && ladder[k][std::size_t(rung) + 1] == yields;
    found.yielding.push_back(at(k, beyond ? rung + 1 : rung));
  }
  return found;
}

std::vector<Matrix3> mixed(const YieldStates& pool, std::size_t count, double fraction) {
  const auto yielding = std::size_t(std::llround(fraction * double(count)));
  if (yielding < count && pool.elastic.empty()) throw InputError("every state tried yields, near rest too");
  if (yielding > 0 && pool.yielding.empty()) throw InputError("no strain up to a quarter makes it yield");
  std::vector<Matrix3> states;
  for (std::size_t k = 0; k < count; ++k)
    states.push_back(k < yielding ? pool.yielding[k % pool.yielding.size()] : pool.elastic[k % pool.elastic.size()]);
  std::mt19937 random(3);
  std::shuffle(states.begin(), states.end(), random);
  return states;
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

class Measurement {
 public:
  Measurement(const KernelOptions& options, plugins::Registry& registry) : options_(options), registry_(registry) {}

  KernelResults run() {
    check_options();
    make_elastic_laws();
    for (std::size_t i = 0; i < elastic_.size(); ++i)
      if (wanted(elastic_[i].instance.description().id)) add_elastic(elastic_[i]);
    for (const Kind kind : {Kind::plasticity, Kind::damage})
      for (const auto& id : registry_.ids(kind))
        if (wanted(id)) attempt(id, [&] { kind == Kind::plasticity ? add_plastic(id) : add_damage(id); });
    sample();
    std::erase_if(results_.kernels, [](const Kernel& kernel) { return !kernel.single && !kernel.doubled; });
    const auto place = [this](const Kernel& kernel) {
      return std::find(options_.plugins.begin(), options_.plugins.end(), kernel.id) - options_.plugins.begin();
    };
    std::stable_sort(results_.kernels.begin(), results_.kernels.end(),
                     [&](const Kernel& a, const Kernel& b) { return place(a) < place(b); });
    return std::move(results_);
  }

 private:
  struct Task {
    std::size_t kernel;
    bool single;
    std::size_t points;
    std::function<void()> call;
    int loops = 1;
    std::vector<double> samples = {};
  };

  bool wanted(const std::string& id) const {
    return options_.plugins.empty() ||
           std::find(options_.plugins.begin(), options_.plugins.end(), id) != options_.plugins.end();
  }
  plugins::GivenParameters given(const std::string& id) const {
    const auto found = options_.parameters.find(id);
    return found == options_.parameters.end() ? plugins::GivenParameters{} : found->second;
  }
  void check_options() const {
    auto ids = options_.plugins;
    for (const auto& [id, parameters] : options_.parameters) ids.push_back(id);
    if (!options_.elasticity.empty()) ids.push_back(options_.elasticity);
    for (const auto& id : ids)
      if (!registry_.find(id)) throw InputError("error: " + registry_.unknown_id(id));
    if (!options_.elasticity.empty() && registry_.find(options_.elasticity)->kind != Kind::elasticity)
      throw InputError("error: " + options_.elasticity + " is not an elastic law that others could be paired with");
  }
  template <class Action>
  void attempt(const std::string& id, Action action) {
    try {
      action();
    } catch (const InputError& error) {
      // What the user set is to be said at once; what was chosen here is the user's to set.
      if (options_.parameters.contains(id)) throw InputError("error: " + std::string(error.what()));
      if (wanted(id)) results_.skipped.push_back({id, error.what()});
    }
  }

  void make_elastic_laws() {
    for (const auto& id : registry_.ids(Kind::elasticity))
      attempt(id, [&] { elastic_.add(make_law(registry_, id, given(id), 0, {.cell_size = cell_size, .density = density})); });
  }

  const Law& make_paired(const std::string& id, std::size_t elastic) {
    paired_.push_back(elastic_.make_paired(registry_, id, given(id), elastic, {.cell_size = cell_size, .density = density}));
    return *paired_.back();
  }

  std::size_t add_kernel(const Law& law, std::string condition, std::string elastic = "") {
    results_.kernels.push_back({.id = law.instance.description().id,
                                .condition = std::move(condition),
                                .elasticity = std::move(elastic),
                                .isa = isa_of(law.instance.plugin()),
                                .parameters = law.parameters,
                                .yielding = {},
                                .single = {},
                                .doubled = {}});
    return results_.kernels.size() - 1;
  }
  /// Both precisions the law offers; `make` builds the batch of one.
  template <class Make>
  void add_tasks(std::size_t kernel, const Instance& law, Make make) {
    const auto add = [&](auto precision) {
      using T = decltype(precision);
      if (!law.can(precision_of<T>)) return;
      auto batch = std::make_shared<LawBatch<T>>(make(precision));
      check_call(*batch, law);
      if (law.description().kind == Kind::plasticity) {
        double yielding = 0;
        for (std::size_t k = 0; k < batch->points(); ++k) yielding += batch->get(CLEAVE_FIELD_YIELDED, 0, k);
        results_.kernels[kernel].yielding = yielding / double(batch->points());
      }
      const auto function = function_of<T>(law);
      tasks_.push_back({kernel, sizeof(T) == 4, batch->points(), [batch, function, &law] { batch->call(function, law); }});
    };
    add(float{});
    add(double{});
  }

  void add_elastic(const Law& law) {
    const auto& description = law.instance.description();
    const auto states = States(1).strained(options_.points, moderate_strain);
    const auto measure = [&](const Law& measured, const std::string& fibers) {
      const Instance& instance = measured.instance;
      add_tasks(add_kernel(measured, "stress" + fibers), instance,
                [&](auto precision) { return stress_batch<decltype(precision)>(instance, states); });
      const auto measure_implicit = [&](cleave_field_id output, const char* condition) {
        add_tasks(add_kernel(measured, condition + fibers), instance,
                  [&](auto precision) { return implicit_batch<decltype(precision)>(instance, states, output); });
      };
      if (instance.can(CLEAVE_HAS_PIOLA)) measure_implicit(CLEAVE_FIELD_PIOLA, "P");
      if (instance.can(CLEAVE_HAS_TANGENT)) measure_implicit(CLEAVE_FIELD_DELTA_P, "dP");
    };
    attempt(description.id, [&] { measure(law, ""); });
    auto fibrous = fiber_parameters(description);
    if (fibrous.empty() || law.instance.can(CLEAVE_NEEDS_FIBER)) return;
    attempt(description.id, [&] {
      fibrous.insert(law.parameters.begin(), law.parameters.end());
      paired_.push_back(make_law(registry_, description.id, fibrous, 0, {.cell_size = cell_size, .density = density}));
      measure(*paired_.back(), ", with fibres");
    });
  }

  void add_plastic(const std::string& id) {
    const std::size_t elastic = elastic_.partner({registry_.find(id)}, options_.elasticity);
    const Law& law = make_paired(id, elastic);
    const Instance& instance = law.instance;
    const YieldStates pool = instance.can(CLEAVE_DOUBLE) ? find_yield<double>(instance) : find_yield<float>(instance);
    for (const int percent : {0, 30, 100})
      attempt(id, [&] {
        const auto states = mixed(pool, options_.points, percent / 100.);
        add_tasks(add_kernel(law, std::to_string(percent) + " % yielding", elastic_[elastic].instance.description().id),
                  instance, [&](auto precision) { return return_batch<decltype(precision)>(instance, states); });
      });
  }

  void add_damage(const std::string& id) {
    const std::size_t elastic = elastic_.partner({registry_.find(id)}, options_.elasticity);
    const Law& law = make_paired(id, elastic);
    const Instance &instance = law.instance, &matrix = elastic_[elastic].instance;
    for (const bool loaded : {false, true})
      attempt(id, [&] {
        const auto states = States(2).strained(options_.points, loaded ? moderate_strain : strain_near_rest);
        add_tasks(add_kernel(law, loaded ? "loaded" : "near rest", matrix.description().id), instance,
                  [&](auto precision) { return damage_batch<decltype(precision)>(instance, matrix, states); });
      });
  }

  void sample() {
    constexpr double least_seconds = 1e-4;
    const auto time = [](const Task& task) {
      const auto start = std::chrono::steady_clock::now();
      for (int i = 0; i < task.loops; ++i) task.call();
      return seconds_since(start);
    };
    for (Task& task : tasks_)
      while (time(task) < least_seconds) task.loops *= 2;
    for (int round = 0; round < options_.repeats; ++round)
      for (Task& task : tasks_) task.samples.push_back(time(task) * 1e9 / task.loops / double(task.points));
    for (Task& task : tasks_) {
      std::sort(task.samples.begin(), task.samples.end());
      Kernel& kernel = results_.kernels[task.kernel];
      (task.single ? kernel.single : kernel.doubled) = Timing{task.samples[task.samples.size() / 2], task.samples.front()};
    }
  }

  const KernelOptions& options_;
  plugins::Registry& registry_;
  ElasticLaws elastic_;
  std::vector<std::unique_ptr<Law>> paired_;
  std::vector<Task> tasks_;
  KernelResults results_;
};

}  // namespace

KernelResults measure_kernels(const KernelOptions& options, plugins::Registry& registry) {
  return Measurement(options, registry).run();
}

}  // namespace cleave::bench
