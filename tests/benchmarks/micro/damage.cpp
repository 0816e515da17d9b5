// Implicit phase-field damage that grows everywhere in a block: the laws, the product with the stiffness (the larger part of an
// iteration) with every instruction set, and whole solves by conjugate gradients.

#include "micro.hpp"
#include "specimen.hpp"

#include "mpm/damage.hpp"

#include <cstring>
#include <ctime>

namespace cleave::benchmarks {
namespace {

constexpr double time_step = 3.5e-4;

template <class T, int D>
struct Cracking : Specimen<T, D> {
  using S = Specimen<T, D>;
  mpm::BoundLaw inputs, law;
  mpm::Buffer before;

  Cracking(const std::string& isa, const Scale& scale)
      : S(isa, scale.particles, true),
        inputs(this->material.template damage_inputs<T>()),
        law(this->material.template driving_force<T>()),
        before(bytes()) {
    std::memcpy(before.data(), this->particles.data(), bytes());
  }
  void restore() { std::memcpy(this->particles.data(), before.data(), bytes()); }
  std::size_t bytes() const { return this->particles.tiles() * this->view.stride; }
  mpm::DamageEvolution<T, D> evolution(const config::DamageSolver& solver) {
    return mpm::DamageEvolution<T, D>(this->material, inputs, law, solver, S::cell_size);
  }
};

double thread_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

template <class T, int D>
void drive(benchmark::State& state, const Scale& scale) {
  Cracking<T, D> s(instruction_sets().front(), scale);
  auto damage = s.evolution({});
  std::vector<mpm::BlockReport> reports;
  for (auto _ : state) {
    damage.drive(s.view, s.particles, time_step, reports);
    state.PauseTiming();  // history is particle state
    s.restore();
    state.ResumeTiming();
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(s.particles.size()));
  bool right = !reports.empty();
  for (const auto& r : reports) right = right && r.status == 0 && r.result == CLEAVE_OK;
  check(state, right, "laws have results for all points");
}

template <class T, int D>
void stiffness(benchmark::State& state, const std::string& isa, const Scale& scale) {
  Cracking<T, D> s(isa, scale);
  const auto& kernels = mpm::kernels_of<T, D>(kernels_for(isa).damage);
  mpm::Buffer scratch(kernels.scratch_bytes), from(s.grid.nodes() * sizeof(T)), to(s.grid.nodes() * sizeof(T));
  mpm::Buffer volume(s.particles.tiles() * CLEAVE_TILE_BYTES), driving_force(s.particles.tiles() * CLEAVE_TILE_BYTES);
  double whole = 0;
  s.particles.for_each([&](const auto&, std::uint64_t slot) {
    const T v = s.particles.value(s.view.volume, slot);
    reinterpret_cast<T*>(volume.data())[slot] = v;
    whole += double(v);
  });
  T *field = reinterpret_cast<T*>(from.data()), *product = reinterpret_cast<T*>(to.data());
  for (std::size_t n = 0; n < s.grid.nodes(); n++) field[n] = T(0.01 * s.grid.node_coordinates(n)[0]);
  const mpm::DamageView damage{s.inputs, s.law, false, time_step, driving_force.data(), volume.data()};
  const auto multiply = [&] {
    std::memset(to.data(), 0, s.grid.nodes() * sizeof(T));
    s.for_blocks([&](const auto& block) { kernels.stiffness(s.view, block, damage, field, product, scratch.data()); });
  };
  for (auto _ : state) multiply();
  state.SetItemsProcessed(state.iterations() * std::int64_t(s.particles.size()));
  double form = 0;
  for (std::size_t n = 0; n < s.grid.nodes(); n++) form += double(field[n]) * double(product[n]);
  check(state, std::abs(form - 1e-4 * whole) < (sizeof(T) == 4 ? 1e-3 : 1e-10) * 1e-4 * whole,
        "the quadratic form of K is the integral of the squared gradient");
}

template <class T, int D>
void check_damage(benchmark::State& state, const Cracking<T, D>& s, std::int64_t unconverged) {
  bool right = true;
  double largest = 0;
  s.particles.for_each([&](const auto&, std::uint64_t slot) {
    const double d = double(s.particles.value(s.view.damage, slot));
    right = right && d >= 0 && d <= 1;
    largest = std::max(largest, d);
  });
  check(state, right && largest > 0, "damage has grown, between 0 and 1");
  check(state, unconverged == 0, "the solve has converged");
}

/// To the tolerance that scenes have by default.
template <class T, int D>
void solve(benchmark::State& state, const Scale& scale) {
  Cracking<T, D> s(instruction_sets().front(), scale);
  auto damage = s.evolution({});
  std::vector<mpm::BlockReport> reports;
  damage.drive(s.view, s.particles, time_step, reports);
  for (auto _ : state) {
    state.PauseTiming();
    s.restore();
    state.ResumeTiming();
    damage.evolve(s.view, s.particles, s.grid, time_step);
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(s.particles.size()));
  const auto statistics = damage.take_statistics();
  state.counters["iterations"] = double(statistics.iterations) / double(statistics.solves);
  check_damage(state, s, statistics.unconverged);
}

/// The difference of a solve to all digits and one of a single iteration, over the number of iterations between them.
template <class T, int D>
void iteration(benchmark::State& state, const Scale& scale) {
  Cracking<T, D> s(instruction_sets().front(), scale);
  config::DamageSolver one, all;
  one.maximum_iterations = 1;
  all.tolerance = 0;
  auto shortest = s.evolution(one), longest = s.evolution(all);
  std::vector<mpm::BlockReport> reports;
  for (auto* damage : {&shortest, &longest}) {
    damage->drive(s.view, s.particles, time_step, reports);
    s.restore();
  }
  std::int64_t unconverged = 0;
  for (auto _ : state) {
    const auto seconds = [&](mpm::DamageEvolution<T, D>& damage) {
      s.restore();
      const double start = thread_seconds();
      damage.evolve(s.view, s.particles, s.grid, time_step);
      return thread_seconds() - start;
    };
    const double first = seconds(shortest), whole = seconds(longest);
    const auto statistics = longest.take_statistics();
    unconverged += statistics.unconverged;
    check(state, statistics.iterations > 1, "there is more than one iteration");
    state.SetIterationTime((whole - first) / double(std::max<std::int64_t>(1, statistics.iterations - 1)));
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(s.particles.size()));
  check_damage(state, s, sizeof(T) == 4 ? 0 : unconverged);
}

template <class T, int D>
void add(const Scale& scale) {
  const std::string kind = std::string(D == 3 ? "/3D/" : "/2D/") + precision_name<T>();
  benchmark::RegisterBenchmark(("damage/laws" + kind).c_str(), drive<T, D>, scale);
  for (const auto& isa : instruction_sets())
    benchmark::RegisterBenchmark(("damage/stiffness" + kind + "/" + isa).c_str(), stiffness<T, D>, isa, scale);
  benchmark::RegisterBenchmark(("damage/solve" + kind).c_str(), solve<T, D>, scale);
  benchmark::RegisterBenchmark(("damage/iteration" + kind).c_str(), iteration<T, D>, scale)->UseManualTime();
}

}  // namespace

void register_damage(const Scale& scale) {
  add<float, 3>(scale);
  add<double, 3>(scale);
  add<float, 2>(scale);
  add<double, 2>(scale);
}

}  // namespace cleave::benchmarks
