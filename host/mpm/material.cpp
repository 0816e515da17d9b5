#include "mpm/material.hpp"

#include "common/error.hpp"
#include "config/instantiate.hpp"
#include "plugins/elastic_probe.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
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

/// A matrix as nine components over rows; in two dimensions its block 00 01 10 11 is there, 22 may be, and the rest is absent.
std::vector<cleave_component> matrix_components(std::uint32_t stream, int first_row, int dimension, cleave_component absent,
                                                cleave_component last) {
  const std::uint32_t offset = std::uint32_t(first_row) * row;
  if (dimension == 3) return rows(stream, offset, 9);
  const auto at = [&](std::uint32_t i) { return cleave_component{stream, offset + i * row}; };
  return {at(0), at(1), absent, at(2), at(3), absent, absent, absent, last};
}

bool reads_strain(const plugins::Instance& law) { return law.can(CLEAVE_ACCEPTS_B) || law.can(CLEAVE_ACCEPTS_F); }

/// Whether the law does with b alone.
bool accepts_b(const plugins::Instance& law) { return !law || law.can(CLEAVE_ACCEPTS_B) || !reads_strain(law); }

int fibers_needed(const plugins::Instance& law) {
  if (!law) return 0;
  if (law.can(CLEAVE_NEEDS_SECOND_FIBER)) return 2;
  return law.can(CLEAVE_NEEDS_FIBER) ? 1 : 0;
}

int state_components(const plugins::Instance& law) { return law ? law.description().state_components() : 0; }

/// A law that builds on the elastic law of the material.
plugins::Instance instantiate(plugins::Registry& registry, const std::optional<config::PluginUse>& use,
                              plugins::Context context, const plugins::Instance& elasticity) {
  if (!use) return {};
  const plugins::ElasticProbe probe(elasticity);
  context.isochoric = elasticity.isochoric_response();
  context.elastic = probe.get();
  return config::instantiate(registry, *use, context);
}
}  // namespace

Material::Material(const config::Material& m, plugins::Registry& registry, int dimension, double cell_size, bool toughness)
    : name_(m.name),
      density_(m.density),
      dimension_(dimension),
      elasticity_(config::instantiate(registry, m.elasticity, {dimension, cell_size, m.density})),
      plasticity_(instantiate(registry, m.plasticity, {dimension, cell_size, m.density}, elasticity_)),
      damage_(instantiate(registry, m.damage, {dimension, cell_size, m.density}, elasticity_)),
      constraint_(instantiate(registry, m.constraint, {dimension, cell_size, m.density}, elasticity_)),
      layout_({.dimension = dimension,
               .stores_b = accepts_b(elasticity_) && accepts_b(plasticity_) && accepts_b(damage_) && !constraint_,
               .fibers = std::max({fibers_needed(elasticity_), fibers_needed(plasticity_), fibers_needed(damage_),
                                   fibers_needed(constraint_)}),
               .state_components = state_components(plasticity_) + state_components(damage_),
               .damage = bool(damage_),
               .toughness = toughness}),
      stress_{layout_.stride, stress_rows * row, 0},
      degraded_stress_{layout_.stride, stress_rows * row, 0},
      return_mapping_{layout_.stride, stress_rows * row, 0},
      energy_{layout_.stride, 2 * row, 0},
      wave_modulus_{layout_.stride, 2 * row, 0},
      damage_inputs_{layout_.stride, stress_rows * row, 0},
      driving_force_{layout_.stride, stress_rows * row, 0},
      implicit_response_{layout_.stride, implicit_rows * row, 0,
                         std::uint32_t(dimension == 3 ? deformation_rows<3> : deformation_rows<2>) * row},
      implicit_differential_(implicit_response_) {
  for (const auto* law : {&plasticity_, &damage_})
    if (*law) states_.insert(states_.end(), law->description().states.begin(), law->description().states.end());
  detects_inversion_ = !elasticity_.can(CLEAVE_INVERSION_SAFE);

  const auto state = [&](LawLayout& layout, const plugins::Instance& law, int first) {
    const int count = state_components(law);
    if (!count) return;
    const auto components = rows(0, layout_.state + std::uint32_t(first) * row, count);
    layout.add(CLEAVE_FIELD_STATE, components);
    layout.add(CLEAVE_FIELD_STATE_OUT, components);
  };
  for (LawLayout* layout : {&stress_, &degraded_stress_, &energy_, &wave_modulus_, &damage_inputs_})
    add_inputs(*layout, elasticity_);
  stress_.add(CLEAVE_FIELD_TAU, rows(1, 0, 6));
  degraded_stress_.add(CLEAVE_FIELD_TAU, rows(1, 0, 6));
  degraded_stress_.add(CLEAVE_FIELD_DEGRADATION, rows(1, degradation_row * row, 1));
  energy_.add(CLEAVE_FIELD_ENERGY, rows(1, 0, 1));
  if (damage_)
    for (LawLayout* layout : {&energy_, &wave_modulus_}) layout->add(CLEAVE_FIELD_DEGRADATION, rows(1, row, 1));
  wave_modulus_.add(CLEAVE_FIELD_WAVE_MODULUS, rows(1, 0, 1));
  lay_out_implicit_laws();
  if (plasticity_) {
    add_inputs(return_mapping_, plasticity_);
    return_mapping_.add(layout_.stores_b ? CLEAVE_FIELD_B_OUT : CLEAVE_FIELD_F_OUT,
                        strain_components(layout_, dimension, {1, discarded_row * row}));
    state(return_mapping_, plasticity_, 0);
  }
  if (damage_) {
    damage_model_.struct_size = sizeof damage_model_;
    damage_.damage().model(damage_.handle(), &damage_model_);
    check_damage_model(m);
    const bool energy = damage_.can(CLEAVE_NEEDS_TENSILE_ENERGY), stress = damage_.can(CLEAVE_NEEDS_EFFECTIVE_STRESS);
    std::uint32_t at = 0;
    const auto exchange = [&](cleave_field_id out, cleave_field_id in, int count) {
      damage_inputs_.add(out, rows(1, at, count));
      driving_force_.add(in, rows(1, at, count));
      at += std::uint32_t(count) * row;
    };
    // The driving force is the seventh row; the laws of this ABI want one of the two, or the energy in the row of g.
    if (stress) exchange(CLEAVE_FIELD_EFFECTIVE_STRESS, CLEAVE_FIELD_EFFECTIVE_STRESS_IN, 6);
    if (stress) at = degradation_row * row;
    if (energy) exchange(CLEAVE_FIELD_TENSILE_ENERGY, CLEAVE_FIELD_TENSILE_ENERGY_IN, 1);
    has_damage_inputs_ = energy || stress;
    if (reads_strain(damage_) || fibers_needed(damage_)) add_inputs(driving_force_, damage_);
    const auto damage = rows(0, layout_.damage, 1);
    driving_force_.add(CLEAVE_FIELD_DAMAGE, damage);
    if (layout_.toughness) driving_force_.add(CLEAVE_FIELD_TOUGHNESS, rows(0, layout_.toughness, 1));
    if (damage_.can(CLEAVE_DAMAGE_IS_LOCAL))
      driving_force_.add(CLEAVE_FIELD_DAMAGE_OUT, damage);
    else
      driving_force_.add(CLEAVE_FIELD_DRIVING_FORCE, rows(1, driving_force_row * row, 1));
    state(driving_force_, damage_, state_components(plasticity_));
  }
}

void Material::lay_out_implicit_laws() {
  constexpr cleave_component discarded{1, implicit_discarded_row * row};
  const auto deformation = matrix_components(3, 0, dimension_, zero, {3, 4 * row});
  const auto stress = matrix_components(1, 0, dimension_, discarded, {1, 4 * row});
  for (LawLayout* layout : {&implicit_response_, &implicit_differential_}) {
    add_fibers(*layout, elasticity_);
    if (damage_) layout->add(CLEAVE_FIELD_DEGRADATION, rows(1, implicit_degradation_row * row, 1));
  }
  if (response_takes_b())
    implicit_response_.add(CLEAVE_FIELD_B, rows(1, implicit_b_row * row, 6));
  else
    implicit_response_.add(CLEAVE_FIELD_F, deformation);
  if (gives_piola())
    implicit_response_.add(CLEAVE_FIELD_PIOLA, stress);
  else
    implicit_response_.add(CLEAVE_FIELD_TAU, rows(1, 0, 6));
  if (gives_energy()) implicit_response_.add(CLEAVE_FIELD_ENERGY, rows(1, implicit_energy_row * row, 1));
  implicit_differential_.add(CLEAVE_FIELD_F, deformation);
  implicit_differential_.add(CLEAVE_FIELD_DELTA_F, matrix_components(1, implicit_delta_row, dimension_, zero, zero));
  implicit_differential_.add(CLEAVE_FIELD_DELTA_P, stress);
}

void Material::check_damage_model(const config::Material& m) const {
  const auto& model = damage_model_;
  const bool local = damage_.can(CLEAVE_DAMAGE_IS_LOCAL);
  const auto refuse = [&](const std::string& what) {
    throw InputError(error_at(m.damage->where) + damage_.description().id + " " + damage_.description().version + " gives " +
                     what);
  };
  if (!(model.residual >= 0 && model.residual < 1)) refuse(fmt::format("the residual r = {:g}, not in [0, 1)", model.residual));
  if (local) return;
  if (!(model.viscosity > 0) || !std::isfinite(model.viscosity))
    refuse(fmt::format("the viscosity eta = {:g} s, not positive", model.viscosity));
  if (!(model.length >= 0) || !std::isfinite(model.length)) refuse(fmt::format("the length l = {:g} m", model.length));
  if (model.integration > CLEAVE_INTEGRATION_EXPLICIT) refuse("an integration this host does not know");
}

std::vector<std::string> unsupported(const config::Scene& scene, const plugins::Registry& registry) {
  std::vector<std::string> problems;
  for (const auto& m : scene.materials) {
    if (m.discretization) continue;
    const auto problem = [&](const config::Location& where, const std::string& what) {
      problems.push_back(error_at(where) + "material '" + m.name + "': " + what);
    };
    struct Law {
      const config::PluginUse* use;
      const plugins::Description* description;
      std::uint64_t capabilities;
    };
    std::vector<Law> laws;
    for (const auto* use : {&m.elasticity, m.plasticity ? &*m.plasticity : nullptr, m.damage ? &*m.damage : nullptr})
      if (const auto* law = use ? registry.find(use->id) : nullptr)
        laws.push_back({use, law, law->capabilities_with(use->parameters)});
    constexpr std::uint64_t any_strain = CLEAVE_ACCEPTS_B | CLEAVE_ACCEPTS_F;
    const plugins::Description* needs_F = m.constraint ? registry.find(m.constraint->id) : nullptr;
    for (const auto& law : laws)
      if ((law.capabilities & any_strain) == CLEAVE_ACCEPTS_F) needs_F = law.description;
    for (const auto& law : laws)
      if (needs_F && (law.capabilities & any_strain) == CLEAVE_ACCEPTS_B)
        problem(law.use->where, law.description->id + " accepts only b, but " + needs_F->id + " needs F");
    const auto* elasticity = registry.find(m.elasticity.id);
    const bool implicit = scene.simulation.integrator == config::Integrator::implicit;
    if (elasticity && scene.simulation.integrator != config::Integrator::symplectic && !elasticity->can(CLEAVE_HAS_TANGENT)) {
      std::vector<std::string> able;
      for (const auto& id : registry.ids(plugins::Kind::elasticity))
        if (const auto* law = registry.find(id); law && law->can(CLEAVE_HAS_TANGENT)) able.push_back(id);
      problem(m.elasticity.where,
              fmt::format("{} declares no tangent, which simulation.integrator = \"{}\" needs; laws that do: {}",
                          elasticity->id, implicit ? "implicit" : "auto", fmt::join(able, ", ")));
    }
    if (elasticity && !implicit && !scene.simulation.time_step && !elasticity->can(CLEAVE_HAS_WAVE_MODULUS))
      problem(m.elasticity.where, elasticity->id +
                                      " declares no wave modulus, so no step size can be chosen: set simulation.time_step in "
                                      "seconds");
  }
  return problems;
}

void Material::add_inputs(LawLayout& l, const plugins::Instance& law) const {
  if (reads_strain(law))
    l.add(layout_.stores_b ? CLEAVE_FIELD_B : CLEAVE_FIELD_F, strain_components(layout_, dimension_, zero));
  add_fibers(l, law);
}

void Material::add_fibers(LawLayout& l, const plugins::Instance& law) const {
  if (fibers_needed(law) > 0) l.add(CLEAVE_FIELD_FIBER, rows(0, layout_.fiber, 3));
  if (fibers_needed(law) > 1) l.add(CLEAVE_FIELD_SECOND_FIBER, rows(0, layout_.second_fiber, 3));
}

std::vector<double> Material::initial_state() const {
  std::vector<double> values;
  for (const auto* law : {&plasticity_, &damage_}) {
    if (!*law) continue;
    const auto own = law->initial_state();
    values.insert(values.end(), own.begin(), own.end());
  }
  return values;
}

template <class T>
BoundLaw Material::elastic(const LawLayout& layout) const {
  const auto& e = elasticity_.elasticity();
  return {elasticity_.handle(), std::is_same_v<T, float> ? e.evaluate_f32 : e.evaluate_f64, layout.get()};
}

template <class T>
BoundLaw Material::stress() const {
  return elastic<T>(stress_);
}

template <class T>
BoundLaw Material::degraded_stress() const {
  return elastic<T>(degraded_stress_);
}

template <class T>
BoundLaw Material::implicit_response() const {
  return elastic<T>(implicit_response_);
}

template <class T>
BoundLaw Material::implicit_differential() const {
  return elastic<T>(implicit_differential_);
}

template <class T>
BoundLaw Material::return_mapping() const {
  if (!plasticity_) return {};
  const auto& p = plasticity_.plasticity();
  return {plasticity_.handle(), std::is_same_v<T, float> ? p.return_map_f32 : p.return_map_f64, return_mapping_.get()};
}

template <class T>
BoundLaw Material::damage_inputs() const {
  return has_damage_inputs_ ? elastic<T>(damage_inputs_) : BoundLaw{};
}

template <class T>
BoundLaw Material::driving_force() const {
  if (!damage_) return {};
  const auto& d = damage_.damage();
  return {damage_.handle(), std::is_same_v<T, float> ? d.drive_f32 : d.drive_f64, driving_force_.get()};
}

template <class T>
BoundLaw Material::measure(Measure what) const {
  if (!elasticity_.can(what == Measure::energy ? CLEAVE_HAS_ENERGY : CLEAVE_HAS_WAVE_MODULUS)) return {};
  return elastic<T>(what == Measure::energy ? energy_ : wave_modulus_);
}

template BoundLaw Material::stress<float>() const;
template BoundLaw Material::stress<double>() const;
template BoundLaw Material::degraded_stress<float>() const;
template BoundLaw Material::degraded_stress<double>() const;
template BoundLaw Material::implicit_response<float>() const;
template BoundLaw Material::implicit_response<double>() const;
template BoundLaw Material::implicit_differential<float>() const;
template BoundLaw Material::implicit_differential<double>() const;
template BoundLaw Material::return_mapping<float>() const;
template BoundLaw Material::return_mapping<double>() const;
template BoundLaw Material::damage_inputs<float>() const;
template BoundLaw Material::damage_inputs<double>() const;
template BoundLaw Material::driving_force<float>() const;
template BoundLaw Material::driving_force<double>() const;
template BoundLaw Material::measure<float>(Measure) const;
template BoundLaw Material::measure<double>(Measure) const;

}  // namespace cleave::mpm
