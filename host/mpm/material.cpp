#include "mpm/material.hpp"

#include "common/error.hpp"

#include <type_traits>

namespace cleave::mpm {

namespace {
constexpr std::uint32_t row = CLEAVE_TILE_BYTES;
constexpr cleave_component zero{2, 0};

std::vector<cleave_component> rows(std::uint32_t stream, std::uint32_t offset, int count) {
  std::vector<cleave_component> r;
  for (int i = 0; i < count; i++) r.push_back({stream, offset + std::uint32_t(i) * row});
  return r;
}

/// b or F as three-dimensional components over what is stored; `absent` stands for the constant ones in two dimensions.
std::vector<cleave_component> strain_components(const TileLayout& l, int dimension, cleave_component absent) {
  if (dimension == 3) return rows(0, l.strain, l.stores_b ? 6 : 9);
  const auto at = [&](int i) { return cleave_component{0, l.strain + std::uint32_t(i) * row}; };
  if (l.stores_b) return {at(0), at(1), at(2), at(3), absent, absent};
  return {at(0), at(1), absent, at(2), at(3), absent, absent, absent, at(4)};
}

bool accepts_b(const plugins::Instance& law) { return !law || law.description().can(CLEAVE_ACCEPTS_B); }

int fibers_needed(const plugins::Instance& law) {
  if (!law) return 0;
  if (law.description().can(CLEAVE_NEEDS_SECOND_FIBER)) return 2;
  return law.description().can(CLEAVE_NEEDS_FIBER) ? 1 : 0;
}

plugins::Instance instantiate(plugins::Registry& registry, const config::PluginUse& use, const plugins::Context& context) {
  try {
    return plugins::Instance(registry.load(use.id), use.parameters, context);
  } catch (const InputError& e) {
    throw InputError(error_at(use.where) + e.what());
  }
}
}  // namespace

Material::Material(const config::Material& m, plugins::Registry& registry, int dimension, double cell_size)
    : name_(m.name),
      density_(m.density),
      dimension_(dimension),
      elasticity_(instantiate(registry, m.elasticity, {dimension, cell_size, m.density, {}})),
      plasticity_(m.plasticity ? instantiate(registry, *m.plasticity,
                                             {dimension, cell_size, m.density, elasticity_.isochoric_response()})
                               : plugins::Instance()),
      fibers_(m.fibers),
      layout_(dimension, accepts_b(elasticity_) && accepts_b(plasticity_),
              std::max(fibers_needed(elasticity_), fibers_needed(plasticity_)),
              plasticity_ ? plasticity_.description().state_components() : 0),
      stress_{layout_.stride, stress_rows * row, 0},
      return_mapping_{layout_.stride, stress_rows * row, 0},
      energy_{layout_.stride, row, 0},
      wave_modulus_{layout_.stride, row, 0} {
  if (plasticity_) states_ = plasticity_.description().states;
  detects_inversion_ = !elasticity_.description().can(CLEAVE_INVERSION_SAFE);

  const cleave_component discarded{1, discarded_row * row};
  add_inputs(stress_, elasticity_.description());
  stress_.add(CLEAVE_FIELD_TAU, rows(1, 0, 6));
  add_inputs(energy_, elasticity_.description());
  energy_.add(CLEAVE_FIELD_ENERGY, rows(1, 0, 1));
  add_inputs(wave_modulus_, elasticity_.description());
  wave_modulus_.add(CLEAVE_FIELD_WAVE_MODULUS, rows(1, 0, 1));
  if (plasticity_) {
    add_inputs(return_mapping_, plasticity_.description());
    return_mapping_.add(layout_.stores_b ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT,
                        strain_components(layout_, dimension, discarded));
    if (layout_.state_components) {
      return_mapping_.add(CLEAVE_FIELD_STATE, rows(0, layout_.state, layout_.state_components));
      return_mapping_.add(CLEAVE_FIELD_STATE_OUT, rows(0, layout_.state, layout_.state_components));
    }
  }
}

std::vector<std::string> unsupported(const config::Scene& scene, const plugins::Registry& registry) {
  std::vector<std::string> problems;
  for (const auto& m : scene.materials) {
    const auto problem = [&](const config::Location& where, const std::string& what) {
      problems.push_back(error_at(where) + "material '" + m.name + "': " + what);
    };
    for (const auto* use : {&m.damage, &m.constraint})
      if (*use)
        problem((*use)->where, "a scene can use elasticity and plasticity laws; " + (*use)->id + " is of kind " +
                                   (*use)->id.substr(0, (*use)->id.find('/')));
    std::vector<std::pair<const config::PluginUse*, const plugins::Description*>> laws;
    laws.emplace_back(&m.elasticity, registry.find(m.elasticity.id));
    if (m.plasticity) laws.emplace_back(&*m.plasticity, registry.find(m.plasticity->id));
    const plugins::Description* needs_F = nullptr;
    for (const auto& [use, law] : laws)
      if (law && !law->can(CLEAVE_ACCEPTS_B)) needs_F = law;
    for (const auto& [use, law] : laws)
      if (law && needs_F && !law->can(CLEAVE_ACCEPTS_F))
        problem(use->where, law->id + " accepts only b, but " + needs_F->id + " needs F");
    const auto* elasticity = laws[0].second;
    if (elasticity && !scene.simulation.time_step && !elasticity->can(CLEAVE_HAS_WAVE_MODULUS))
      problem(m.elasticity.where, elasticity->id +
                                      " declares no wave modulus, so no step size can be chosen: set simulation.time_step in "
                                      "seconds");
  }
  return problems;
}

void Material::add_inputs(LawLayout& l, const plugins::Description& law) const {
  l.add(layout_.stores_b ? CLEAVE_FIELD_B : CLEAVE_FIELD_F, strain_components(layout_, dimension_, zero));
  if (law.can(CLEAVE_NEEDS_FIBER) || law.can(CLEAVE_NEEDS_SECOND_FIBER)) l.add(CLEAVE_FIELD_FIBER, rows(0, layout_.fiber, 3));
  if (law.can(CLEAVE_NEEDS_SECOND_FIBER)) l.add(CLEAVE_FIELD_SECOND_FIBER, rows(0, layout_.second_fiber, 3));
}

std::vector<double> Material::initial_state() const {
  return layout_.state_components ? plasticity_.initial_state() : std::vector<double>();
}

template <class T>
BoundLaw Material::stress() const {
  const auto& e = elasticity_.elasticity();
  return {elasticity_.handle(), std::is_same_v<T, float> ? e.evaluate_f32 : e.evaluate_f64, stress_.get()};
}

template <class T>
BoundLaw Material::return_mapping() const {
  if (!plasticity_) return {};
  const auto& p = plasticity_.plasticity();
  return {plasticity_.handle(), std::is_same_v<T, float> ? p.return_map_f32 : p.return_map_f64, return_mapping_.get()};
}

template <class T>
BoundLaw Material::measure(Measure what) const {
  BoundLaw law = stress<T>();
  const bool offered = elasticity_.description().can(what == Measure::energy ? CLEAVE_HAS_ENERGY : CLEAVE_HAS_WAVE_MODULUS);
  if (!offered) return {};
  law.layout = (what == Measure::energy ? energy_ : wave_modulus_).get();
  return law;
}

template BoundLaw Material::stress<float>() const;
template BoundLaw Material::stress<double>() const;
template BoundLaw Material::return_mapping<float>() const;
template BoundLaw Material::return_mapping<double>() const;
template BoundLaw Material::measure<float>(Measure) const;
template BoundLaw Material::measure<double>(Measure) const;

}  // namespace cleave::mpm
