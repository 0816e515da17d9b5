// The kernels of the transfers with every instruction set of this processor, on one thread, laws called as in a step. Bytes are
// those of particles: what there is of them is read by the one, read or written by the other.

#include "micro.hpp"
#include "specimen.hpp"

namespace cleave::benchmarks {
namespace {

template <class T, int D>
void particle_to_grid(benchmark::State& state, const std::string& isa, const Scale& scale) {
  Specimen<T, D> s(isa, scale.particles, false);
  const auto& kernels = mpm::kernels_of<T, D>(kernels_for(isa).transfer);
  mpm::Buffer scratch(kernels.scratch_bytes);
  mpm::BlockReport report;
  const auto transfer = [&] {
    s.grid.clear(s.grid.data());
    s.for_blocks([&](const auto& block) { kernels.particle_to_grid(s.view, block, s.step, scratch.data(), report); });
  };
  for (auto _ : state) transfer();
  const std::int64_t points = state.iterations() * std::int64_t(s.particles.size());
  state.SetItemsProcessed(points);
  state.SetBytesProcessed(std::int64_t(double(points) * s.bytes_per_particle()));
  check(state, report.status == 0 && report.result == CLEAVE_OK, "the law has a result for every point");
  check(state, s.of_particles().near(s.of_grid(false)), "mass and momentum of the grid are those of the particles");
}

template <class T, int D>
void grid_to_particle(benchmark::State& state, const std::string& isa, const Scale& scale) {
  Specimen<T, D> s(isa, scale.particles, false);
  const auto& kernels = mpm::kernels_of<T, D>(kernels_for(isa).transfer);
  mpm::Buffer scratch(kernels.scratch_bytes);
  mpm::BlockReport report;
  s.grid.clear(s.grid.data());
  s.for_blocks([&](const auto& block) { kernels.particle_to_grid(s.view, block, s.step, scratch.data(), report); });
  const T none[3] = {};
  kernels.grid_update(s.grid.data(), 0, s.grid.blocks(), none);
  const auto transfer = [&] {
    s.for_blocks([&](const auto& block) { kernels.grid_to_particle(s.view, block, s.step, scratch.data(), report); });
  };
  transfer();
  const bool keeps_momentum = s.of_particles().near(s.of_grid(true));  // later the particles have moved, and the grid has not
  for (auto _ : state) transfer();
  const std::int64_t points = state.iterations() * std::int64_t(s.particles.size());
  state.SetItemsProcessed(points);
  state.SetBytesProcessed(std::int64_t(double(points) * s.bytes_per_particle()));
  check(state, !report.not_finite && !report.strayed && !report.inverted, "particles stay where they are");
  check(state, keeps_momentum, "momentum of the particles is that of the grid");
}

template <class T, int D>
void grid_update(benchmark::State& state, const std::string& isa, const Scale& scale) {
  Specimen<T, D> s(isa, scale.particles, false);
  const auto& kernels = mpm::kernels_of<T, D>(kernels_for(isa).transfer);
  const auto fill = [&] {
    for (std::size_t n = 0; n < s.grid.nodes(); n++)
      for (int i = 0; i < 4; i++) s.grid.node(n)[i] = i == 0 ? T(2) : T(1);
  };
  fill();
  // v/2 + 1/4, over and over: 1/2
  const T change[3] = {T(0.25), T(0.25), T(0.25)};
  for (auto _ : state) kernels.grid_update(s.grid.data(), 0, s.grid.blocks(), change);
  state.SetItemsProcessed(state.iterations() * std::int64_t(s.particles.size()));
  state.SetBytesProcessed(state.iterations() * std::int64_t(s.grid.nodes() * 8 * sizeof(T)));
  fill();
  kernels.grid_update(s.grid.data(), 0, s.grid.blocks(), change);
  bool right = true;
  for (std::size_t n = 0; n < s.grid.nodes(); n++)
    for (int a = 0; a < 3; a++) right = right && s.grid.node(n)[1 + a] == T(0.75) && s.grid.node(n)[0] == T(2);
  check(state, right, "velocity is momentum over mass and what gravity adds");
}

template <class T, int D>
void add(const std::string& isa, const Scale& scale) {
  const auto name = [&](const char* kernel) {
    return std::string(kernel) + (D == 3 ? "/3D/" : "/2D/") + precision_name<T>() + "/" + isa;
  };
  benchmark::RegisterBenchmark(name("particle_to_grid").c_str(), particle_to_grid<T, D>, isa, scale);
  benchmark::RegisterBenchmark(name("grid_to_particle").c_str(), grid_to_particle<T, D>, isa, scale);
  benchmark::RegisterBenchmark(name("grid_update").c_str(), grid_update<T, D>, isa, scale);
}

}  // namespace

void register_transfers(const Scale& scale) {
  for (const auto& isa : instruction_sets()) {
    add<float, 3>(isa, scale);
    add<double, 3>(isa, scale);
    add<float, 2>(isa, scale);
    add<double, 2>(isa, scale);
  }
}

}  // namespace cleave::benchmarks
