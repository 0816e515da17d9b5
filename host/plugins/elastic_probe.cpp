#include "plugins/elastic_probe.hpp"

#include <cmath>
#include <limits>

namespace cleave::plugins {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

using Function = cleave_result (*)(const cleave_instance*, const cleave_batch*);
using Deformation = std::array<double, 9>;

/// One output field at F, for fibres along x and y. The point fills a whole tile, so that every lane is computed alike.
template <class T>
std::array<double, 6> evaluate(const Instance& law, Function function, cleave_field_id output, const Deformation& F) {
  constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T);
  enum { deformation = 0, left_cauchy_green = 9, fiber = 15, second_fiber = 18, result = 21, rows = 27 };
  alignas(CLEAVE_TILE_BYTES) T tile[rows][lanes] = {};
  const auto set = [&](int row, double value) { std::fill_n(tile[row], lanes, T(value)); };
  for (int i = 0; i < 9; ++i) set(deformation + i, F[std::size_t(i)]);
  constexpr int at[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
  for (int c = 0; c < 6; ++c) {
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += F[std::size_t(3 * at[c][0] + k)] * F[std::size_t(3 * at[c][1] + k)];
    set(left_cauchy_green + c, sum);
  }
  set(fiber, 1);
  set(second_fiber + 1, 1);

  cleave_component components[rows];
  for (std::uint32_t i = 0; i < rows; ++i) components[i] = {0, i * CLEAVE_TILE_BYTES};
  const std::uint16_t count = output == CLEAVE_FIELD_TENSILE_ENERGY ? 1 : 6;
  cleave_field fields[CLEAVE_FIELD_COUNT] = {};
  if (law.can(CLEAVE_ACCEPTS_F))
    fields[CLEAVE_FIELD_F] = {deformation, 9};
  else
    fields[CLEAVE_FIELD_B] = {left_cauchy_green, 6};
  fields[CLEAVE_FIELD_FIBER] = {fiber, 3};
  fields[CLEAVE_FIELD_SECOND_FIBER] = {second_fiber, 3};
  fields[output] = {result, count};
  cleave_layout layout{};
  layout.struct_size = sizeof layout;
  layout.field_count = CLEAVE_FIELD_COUNT;
  layout.stride[0] = sizeof tile;
  layout.fields = fields;
  layout.components = components;
  cleave_status status = CLEAVE_STATUS_OK;
  cleave_batch batch{};
  batch.struct_size = sizeof batch;
  batch.count = 1;
  batch.layout = &layout;
  batch.streams[0] = tile;
  batch.status = &status;
  const bool usable = function(law.handle(), &batch) == CLEAVE_OK && status < CLEAVE_STATUS_RETRY;
  std::array<double, 6> values{};
  for (int c = 0; c < count; ++c) values[std::size_t(c)] = usable ? double(tile[result + c][0]) : nan;
  return values;
}

/// In double precision where the law offers it.
std::array<double, 6> evaluate(const Instance& law, cleave_field_id output, const Deformation& F) {
  const auto& table = law.elasticity();
  return law.can(CLEAVE_DOUBLE) ? evaluate<double>(law, table.evaluate_f64, output, F)
                                : evaluate<float>(law, table.evaluate_f32, output, F);
}

}  // namespace

ElasticProbe::ElasticProbe(const Instance& elasticity) : cleave_elastic_probe{}, elasticity_(elasticity) {
  struct_size = sizeof(cleave_elastic_probe);
  cleave_elastic_probe::tensile_energy = [](const cleave_elastic_probe* self, const double* F) {
    const Instance& law = static_cast<const ElasticProbe*>(self)->elasticity_;
    if (!law.can(CLEAVE_HAS_ENERGY)) return nan;
    Deformation deformation;
    std::copy(F, F + 9, deformation.begin());
    return evaluate(law, CLEAVE_FIELD_TENSILE_ENERGY, deformation)[0];
  };
  // Central differences: sigma_xy = 2 mu h under F = I + h (e_x e_y + e_y e_x), tr sigma/3 = 3 kappa h under F = (1 + h) I.
  const auto stress = elasticity.can(CLEAVE_HAS_EFFECTIVE_STRESS) ? CLEAVE_FIELD_EFFECTIVE_STRESS : CLEAVE_FIELD_TAU;
  const double h = elasticity.can(CLEAVE_DOUBLE) ? 1e-5 : 1e-2;
  const auto at = [&](double shear, double dilation) {
    const double s = 1 + dilation;
    return evaluate(elasticity, stress, {s, shear, 0, shear, s, 0, 0, 0, s});
  };
  shear_modulus = (at(h, 0)[3] - at(-h, 0)[3]) / (4 * h);
  const auto pressure = [&](double dilation) {
    const auto sigma = at(0, dilation);
    return (sigma[0] + sigma[1] + sigma[2]) / 3;
  };
  bulk_modulus = (pressure(h) - pressure(-h)) / (6 * h);
}

}  // namespace cleave::plugins
