// Sorting particles after they have moved, and the grid under them. Not a matter of instruction sets: both follow indices.

#include "micro.hpp"
#include "specimen.hpp"

namespace cleave::benchmarks {
namespace {

/// Whether every particle is in its home block, all are there once, and the centre of mass is where it was moved to.
template <class T, int D>
bool in_order(const Specimen<T, D>& s, const std::vector<double>& sums) {
  std::vector<bool> seen(s.particles.size(), false);
  std::vector<double> found(D, 0.0);
  bool right = true;
  s.particles.for_each([&](const auto& block, std::uint64_t slot) {
    const Vector3 x = s.particles.position(block, slot);
    for (int a = 0; a < D; a++) {
      const double inside = double(s.particles.value(s.view.position, a, slot));
      right = right && inside >= 0.5 && inside < mpm::GridShape<D>::block_edge + 0.5;
      found[std::size_t(a)] += x[a];
    }
    right = right && !seen[s.particles.id(slot)];
    seen[s.particles.id(slot)] = true;
  });
  for (int a = 0; a < D; a++)
    right = right && std::abs(found[std::size_t(a)] - sums[std::size_t(a)]) < 1e-4 * double(s.particles.size());
  return right && std::all_of(seen.begin(), seen.end(), [](bool b) { return b; });
}

/// Moved to and fro by parts of a cell, given in per cent, along all axes.
template <class T, int D>
void sort(benchmark::State& state, const Scale& scale) {
  Specimen<T, D> s(instruction_sets().front(), scale.particles, false);
  const T distance = T(double(state.range(0)) / 100);
  std::vector<double> sums(D, 0.0);
  s.particles.for_each([&](const auto& block, std::uint64_t slot) {
    for (int a = 0; a < D; a++) sums[std::size_t(a)] += s.particles.position(block, slot)[a];
  });
  bool away = false;
  const auto move = [&] {
    away = !away;
    const T way = away ? distance : -distance;
    s.particles.for_each([&](const auto&, std::uint64_t slot) {
      for (int a = 0; a < D; a++) s.particles.value(s.view.position, a, slot) += way;
    });
  };
  for (auto _ : state) {
    state.PauseTiming();
    move();
    state.ResumeTiming();
    s.particles.sort();
  }
  const std::int64_t points = state.iterations() * std::int64_t(s.particles.size());
  state.SetItemsProcessed(points);
  state.SetBytesProcessed(std::int64_t(2 * double(points) * s.bytes_per_particle()));
  if (away)
    for (double& sum : sums) sum += double(distance) * double(s.particles.size());
  check(state, in_order(s, sums), "all particles are in their blocks, once each, where they were");
}

template <class T, int D>
void rebuild(benchmark::State& state, const Scale& scale) {
  Specimen<T, D> s(instruction_sets().front(), scale.particles, false);
  for (auto _ : state) s.link();
  state.SetItemsProcessed(state.iterations() * std::int64_t(s.particles.size()));
  state.counters["blocks"] = double(s.grid.blocks());
  bool right = true;
  for (const auto& b : s.particles.blocks())
    for (int n = 0; n < mpm::GridShape<D>::neighbours; n++) {
      const int x = D == 3 ? n / 9 - 1 : n / 3 - 1, y = D == 3 ? n / 3 % 3 - 1 : n % 3 - 1, z = D == 3 ? n % 3 - 1 : 0;
      const mpm::BlockCoordinate there{b.coordinate[0] + x, b.coordinate[1] + y, b.coordinate[2] + z};
      right = right && b.neighbours[n] < s.grid.blocks() && s.grid.coordinate(b.neighbours[n]) == there;
    }
  check(state, right, "blocks are linked to the blocks around them");
}

template <class T, int D>
void add(const Scale& scale) {
  const std::string kind = std::string(D == 3 ? "/3D/" : "/2D/") + precision_name<T>();
  benchmark::RegisterBenchmark(("sort" + kind + "/moved_percent_of_cell").c_str(), sort<T, D>, scale)->Arg(10)->Arg(100);
  benchmark::RegisterBenchmark(("grid_rebuild" + kind).c_str(), rebuild<T, D>, scale);
}

}  // namespace

void register_order(const Scale& scale) {
  add<float, 3>(scale);
  add<double, 3>(scale);
  add<float, 2>(scale);
  add<double, 2>(scale);
}

}  // namespace cleave::benchmarks
