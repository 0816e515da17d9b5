// Stress by calls of 16 to 256 points through the library's table, as a step calls it with 32.

#include "micro.hpp"
#include "specimen.hpp"

#include "bench/law_batch.hpp"

#include <cmath>

namespace cleave::benchmarks {
namespace {

struct Law {
  const char* id;
  bool takes_b;
};
constexpr Law laws[] = {
    {"elasticity/split-neo-hookean", true}, {"elasticity/qr", false}, {"elasticity/fixed-corotated", false}};

/// Points `first` to `first + count` of an endless row of deformations.
template <class T>
bench::LawBatch<T> batch_of(const Law& law, std::size_t first, std::size_t count) {
  const cleave_field_id strain = law.takes_b ? CLEAVE_FIELD_B : CLEAVE_FIELD_F;
  bench::LawBatch<T> batch(count);
  batch.add_input(strain, law.takes_b ? 6 : 9);
  batch.add_output(CLEAVE_FIELD_TAU, 6);
  batch.allocate();
  for (std::size_t k = 0; k < count; k++) {
    Matrix3 F;
    for (int i = 0; i < 9; i++) F(i / 3, i % 3) = (i % 4 == 0) + 0.1 * std::sin(double(9 * (first + k)) + i);
    const Matrix3 b = F * F.transpose();
    constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int i = 0; i < (law.takes_b ? 6 : 9); i++)
      batch.set(strain, i, k, law.takes_b ? b(row[i], column[i]) : F(i / 3, i % 3));
  }
  return batch;
}

template <class T>
void stress(benchmark::State& state, const Law& law) {
  const std::size_t points = std::size_t(state.range(0));
  const plugins::Instance instance(registry_for(instruction_sets().front()).load(law.id),
                                   {{"youngs_modulus", 1e5}, {"poissons_ratio", 0.3}}, {});
  const auto evaluate = sizeof(T) == 4 ? instance.elasticity().evaluate_f32 : instance.elasticity().evaluate_f64;
  auto batch = batch_of<T>(law, 0, points);
  for (auto _ : state) batch.call(evaluate, instance);
  state.SetItemsProcessed(state.iterations() * std::int64_t(points));
  state.SetBytesProcessed(state.iterations() * std::int64_t(points * sizeof(T) * (law.takes_b ? 12 : 15)));
  bool same = true, some = false;
  for (std::size_t k = 0; k < points; k++) {
    auto alone = batch_of<T>(law, k, 1);
    same = same && alone.call(evaluate, instance) == CLEAVE_OK;
    for (int i = 0; i < 6; i++) {
      same = same && batch.get(CLEAVE_FIELD_TAU, i, k) == alone.get(CLEAVE_FIELD_TAU, i, 0);
      some = some || std::abs(batch.get(CLEAVE_FIELD_TAU, i, k)) > 1;
    }
  }
  check(state, same && some, "stress is that of each point by itself, to the bit");
}

}  // namespace

void register_laws() {
  const auto add = [](const Law& law, const char* precision, auto&& function) {
    auto* b = benchmark::RegisterBenchmark((std::string("call/") + law.id + "/" + precision).c_str(), function, law);
    for (const int points : {16, 32, 64, 256}) b->Arg(points);
  };
  for (const auto& law : laws) {
    add(law, "single", stress<float>);
    add(law, "double", stress<double>);
  }
}

}  // namespace cleave::benchmarks
