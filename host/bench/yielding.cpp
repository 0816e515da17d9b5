#include "bench/yielding.hpp"

#include "bench/law_batch.hpp"
#include "output/atomic_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace cleave::bench {

void ShearingBlock::write(const std::filesystem::path& path) const {
  const double spacing = cell_size / 2;
  const auto edge = std::max<std::int64_t>(1, std::llround(std::pow(double(particles), 1.0 / dimension)));
  const std::int64_t layers = dimension == 3 ? edge : 1;
  const double half = 0.5 * double(edge - 1), volume = std::pow(spacing, dimension);
  output::AtomicFile file(path);
  std::string rows = "x,y,z,vx,vy,vz,volume\n";
  for (std::int64_t k = 0; k < layers; ++k) {
    for (std::int64_t j = 0; j < edge; ++j)
      for (std::int64_t i = 0; i < edge; ++i) {
        const Vector3 x(spacing * (double(i) - half), spacing * (double(j) - half),
                        dimension == 3 ? spacing * (double(k) - half) : 0);
        const Vector3 at = center + x, v = velocity + Vector3(rate * x.y(), 0, 0);
        rows += fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n", at.x(), at.y(), at.z(), v.x(), v.y(), v.z(),
                            volume);
      }
    file.stream() << rows;
    rows.clear();
  }
  file.commit();
}

namespace {

template <class T>
double fraction(const plugins::Instance& law, std::size_t first_state, const std::vector<mpm::ParticleState>& before,
                const std::vector<mpm::ParticleState>& after, double time_step) {
  constexpr std::size_t sample = 20000;
  constexpr int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
  const bool accepts_b = law.can(CLEAVE_ACCEPTS_B);
  const std::size_t stride = (before.size() + sample - 1) / sample, points = (before.size() + stride - 1) / stride;
  const int variables = law.description().state_components();
  LawBatch<T> batch(points);
  batch.add_input(accepts_b ? CLEAVE_FIELD_B : CLEAVE_FIELD_F, accepts_b ? 6 : 9);
  if (variables) batch.add_input(CLEAVE_FIELD_STATE, variables);
  batch.add_output(accepts_b ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT, accepts_b ? 6 : 9);
  if (variables) batch.add_output(CLEAVE_FIELD_STATE_OUT, variables);
  batch.add_output(CLEAVE_FIELD_YIELDED, 1);
  batch.allocate();
  for (std::size_t k = 0; k < points; ++k) {
    const mpm::ParticleState& p = before[k * stride];
    const Matrix3 moved = Matrix3::Identity() + time_step * after[k * stride].velocity_gradient;
    const Matrix3 F = moved * p.strain, b = p.stores_b ? Matrix3(F * moved.transpose()) : Matrix3(F * F.transpose());
    for (int i = 0; accepts_b && i < 6; ++i) batch.set(CLEAVE_FIELD_B, i, k, b(row[i], column[i]));
    for (int i = 0; !accepts_b && i < 9; ++i) batch.set(CLEAVE_FIELD_F, i, k, F(i / 3, i % 3));
    for (int i = 0; i < variables; ++i) batch.set(CLEAVE_FIELD_STATE, i, k, p.state[first_state + std::size_t(i)]);
  }
  const auto& functions = law.plasticity();
  if constexpr (sizeof(T) == sizeof(float))
    batch.call(functions.return_map_f32, law);
  else
    batch.call(functions.return_map_f64, law);
  double yielding = 0;
  for (std::size_t k = 0; k < points; ++k) yielding += batch.get(CLEAVE_FIELD_YIELDED, 0, k);
  return yielding / double(points);
}

}  // namespace

std::optional<double> yielding_fraction(const plugins::Instance& law, std::size_t first_state, bool single,
                                        const std::vector<mpm::ParticleState>& before,
                                        const std::vector<mpm::ParticleState>& after, double time_step) {
  if (law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER) || before.empty()) return std::nullopt;
  return (single ? fraction<float> : fraction<double>)(law, first_state, before, after, time_step);
}

}  // namespace cleave::bench
