// Von Mises plasticity, whole except for the one defect of defects.def it was loaded to have: q <= yield_stress, kept volume,
//
//   s_new = k s, k = yield_stress/q,     flow += (q - yield_stress)/(mu J^(-2/3) tr b),     excess += the same
//
// Defects that the SDK's header would not let through are made to what it wrote.
#include <cleave/isochoric_return.hpp>
#include <cleave/plasticity.hpp>

#include "kit/broken.hpp"

namespace {
using namespace cleave;

struct BrokenPlasticity {
  static constexpr About about{.id = "plasticity/broken",
                               .version = "1.0.0",
                               .author = "somebody",
                               .summary = "von Mises plasticity to be broken",
                               .source = "no paper"};
  static constexpr Accepts accepts = Accepts::left_cauchy_green;
  static constexpr bool isochoric_flow = true;

  double yield_stress;
  static constexpr auto parameters = describe(number(
      &BrokenPlasticity::yield_stress,
      {.key = "yield_stress", .unit = "Pa", .valid = positive, .physical = between(1, 1e9), .description = "in tension"}));
  static constexpr auto states =
      describe(scalar_state({.name = "flow", .change = Change::never_decreases, .description = "summed plastic strain"}),
               scalar_state({.name = "excess", .description = "summed plastic strain, of no declared direction"}));

  template <class T>
  Returned<Symmetric3<T>, 2> return_map(const YieldContext& elastic, const Symmetric3<T>& b,
                                        const std::array<T, 2>& state) const {
    const IsochoricTrial<T> trial(b);
    const double limit = yield_stress / elastic.deviatoric_modulus;
    const T q = sqrt(1.5 * trial.squared_shape), rounding = yield_tolerance<T> * (limit + trial.mean);
    mask_of<T> outside = q > limit + rounding;
    if (broken("forgets_far_trials")) outside = outside & (q < T(5 * limit));
    if (broken("flows_on_surface")) outside = q > T(limit * (1 - 1e-9));
    if (none(outside)) return {.strain = b, .state = state, .yielded = outside};

    T k = limit / q;
    if (broken("returns_short")) k = k * 1.001;
    if (broken("returns_too_far")) k = k * 0.99;
    if (broken("flows_backwards")) k = -0.999 * k;
    if (broken("fails_far_away")) k = select(trial.squared_shape > T(400), T(1.1 * k), k);
    Symmetric3<T> strain = isochoric_return<T>(Closure::exact, trial, k);
    if (broken("gains_volume")) strain = T(1 + 3e-11) * strain;
    if (broken("turns_axes")) {
      const T half = 0.1 * (1 - k), c = (1 - half * half) / (1 + half * half), s = 2 * half / (1 + half * half);
      strain = symmetric_product(Matrix3<T>(c, -s, T(0), s, c, T(0), T(0), T(0), T(1)), strain);
    }
    T flow = (q - limit) / (3 * trial.mean), excess = flow;
    if (broken("flows_on_surface")) flow = excess = flow + 1e-3;
    if (broken("unlearns")) flow = select(trial.squared_jacobian < T(0.9), T(-flow), flow);
    if (broken("changes_its_mind")) excess = select(excess > T(0.1), T(-excess), excess);
    return {.strain = strain, .state = {state[0] + flow, state[1] + excess}, .yielded = outside};
  }
};

using Plugin = detail::PluginOf<BrokenPlasticity>;

/// Lanes of a batch, one by one.
template <class S>
struct Numbers {
  const cleave_batch& batch;
  bool has(cleave_field_id field) const {
    return std::uint32_t(field) < batch.layout->field_count && batch.layout->fields[field].count > 0;
  }
  S& at(cleave_field_id field, int component, std::uint32_t point) const {
    const cleave_component& c = batch.layout->components[batch.layout->fields[field].first + component];
    constexpr std::uint32_t lanes = CLEAVE_TILE_BYTES / sizeof(S);
    char* tile = static_cast<char*>(batch.streams[c.stream]) + std::size_t(point / lanes) * batch.layout->stride[c.stream];
    return reinterpret_cast<S*>(tile + c.offset)[point % lanes];
  }
};

template <class S>
cleave_result return_map(const cleave_instance* instance, const cleave_batch* batch) {
  const auto& whole = *static_cast<const cleave_plasticity*>(Plugin::Table::table());
  const cleave_result result = (sizeof(S) == 4 ? whole.return_map_f32 : whole.return_map_f64)(instance, batch);
  const Numbers<S> numbers{*batch};
  const bool of_F = numbers.has(CLEAVE_FIELD_F_OUT);
  const auto in = of_F ? CLEAVE_FIELD_F : CLEAVE_FIELD_B, out = of_F ? CLEAVE_FIELD_F_OUT : CLEAVE_FIELD_B_OUT;
  for (std::uint32_t point = 0; numbers.has(out) && point < batch->count; ++point) {
    bool untouched = true;
    for (int i = 0; i < (of_F ? 9 : 6); ++i) untouched = untouched && numbers.at(in, i, point) == numbers.at(out, i, point);
    if (broken("touches_elastic") && untouched) numbers.at(out, 0, point) *= 1 + std::numeric_limits<S>::epsilon();
    if (broken("turns_F") && !untouched && of_F)
      for (int i = 0; i < 3; ++i) {
        S &x = numbers.at(out, 3 * i, point), &y = numbers.at(out, 3 * i + 1, point);
        const S before = x;
        x = S(0.6) * before + S(0.8) * y;
        y = S(0.6) * y - S(0.8) * before;
      }
  }
  if (broken("counts_F_double") && numbers.has(CLEAVE_FIELD_F) && numbers.has(CLEAVE_FIELD_STATE_OUT))
    for (std::uint32_t point = 0; point < batch->count; ++point) {
      const S before = numbers.at(CLEAVE_FIELD_STATE, 0, point);
      S& after = numbers.at(CLEAVE_FIELD_STATE_OUT, 0, point);
      after = before + 2 * (after - before);
    }
  return result;
}

const void* kind(const char* id) {
  static constexpr cleave_plasticity table{sizeof(cleave_plasticity), 0, &return_map<float>, &return_map<double>};
  return Plugin::kind_table(id) ? &table : nullptr;
}

}  // namespace

extern "C" CLEAVE_EXPORT cleave_result cleave_plugin_entry(const cleave_host* host, const cleave_plugin** plugin) {
  static cleave_plugin table;
  const cleave_result result = Plugin::entry(host, plugin);
  if (result != CLEAVE_OK) return result;
  table = **plugin;
  table.kind = &kind;
  *plugin = &table;
  return CLEAVE_OK;
}
