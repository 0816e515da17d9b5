#include "point/replay.hpp"

#include "common/error.hpp"
#include "mpm/failed_batch.hpp"
#include "mpm/law_layout.hpp"
#include "plugins/elastic_probe.hpp"
#include "plugins/message.hpp"
#include "point/columns.hpp"

#include <algorithm>
#include <array>
#include <cstring>

namespace cleave::point {
namespace {

using plugins::Kind;

/// The laws of the material.
struct Material {
  plugins::Instance elasticity, plasticity, damage;

  const plugins::Instance* find(const std::string& id) const {
    for (const auto* law : {&elasticity, &plasticity, &damage})
      if (*law && law->description().id == id) return law;
    return nullptr;
  }
};

Material make_material(const mpm::FailedBatch& batch, plugins::Registry& registry, std::vector<std::string>& warnings) {
  Material material;
  plugins::Context context{.dimension = batch.dimension, .cell_size = batch.cell_size, .density = batch.density};
  std::optional<plugins::ElasticProbe> probe;
  for (const auto& law : batch.laws) {
    plugins::Instance instance(registry.load(law.id), law.parameters, context);
    const auto& description = instance.description();
    if (description.version != law.version)
      warnings.push_back("warning: " + law.id + " is version " + description.version + " here, and was " + law.version +
                         " in the run");
    plugins::Instance& place = description.kind == Kind::elasticity   ? material.elasticity
                               : description.kind == Kind::plasticity ? material.plasticity
                                                                      : material.damage;
    place = std::move(instance);
    if (description.kind == Kind::elasticity) {
      probe.emplace(material.elasticity);
      context.isochoric = material.elasticity.isochoric_response();
      context.elastic = probe->get();
    }
  }
  return material;
}

using Call = cleave_result (*)(const cleave_instance*, const cleave_batch*);

Call entry_point(const plugins::Instance& law, bool single) {
  switch (law.description().kind) {
    case Kind::plasticity:
      return single ? law.plasticity().return_map_f32 : law.plasticity().return_map_f64;
    case Kind::damage:
      return single ? law.damage().drive_f32 : law.damage().drive_f64;
    default:
      return single ? law.elasticity().evaluate_f32 : law.elasticity().evaluate_f64;
  }
}

const mpm::FieldName& field_name(cleave_field_id id) {
  return *std::find_if(std::begin(mpm::field_names), std::end(mpm::field_names), [&](const auto& f) { return f.id == id; });
}

/// The input that an output replaces in the memory of particles.
std::optional<cleave_field_id> replaced_by(cleave_field_id output) {
  switch (output) {
    case CLEAVE_FIELD_B_OUT:
      return CLEAVE_FIELD_B;
    case CLEAVE_FIELD_F_OUT:
      return CLEAVE_FIELD_F;
    case CLEAVE_FIELD_STATE_OUT:
      return CLEAVE_FIELD_STATE;
    case CLEAVE_FIELD_DAMAGE_OUT:
      return CLEAVE_FIELD_DAMAGE;
    default:
      return std::nullopt;
  }
}

struct Outcome {
  cleave_result result = CLEAVE_OK;
  std::string message;
  std::array<cleave_status, mpm::chunk_points> status{};
  std::uint32_t not_finite = 0;
  mpm::FailedBatch::Fields outputs;
};

template <class T>
Outcome call_again(const mpm::FailedBatch& batch, const plugins::Instance& law) {
  constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T), tiles = std::size_t(mpm::chunk_points) / lanes;
  struct alignas(CLEAVE_TILE_BYTES) Row {
    T lane[lanes]{};
  };
  // One stream; an output lies on the input it replaces, as in the run.
  std::map<cleave_field_id, std::vector<cleave_component>> places;
  std::uint32_t rows = 0;
  const auto take = [&](cleave_field_id id, std::size_t count) {
    for (std::size_t c = 0; c < count; ++c) places[id].push_back({0, CLEAVE_TILE_BYTES * rows++});
  };
  for (const auto& [id, values] : batch.inputs) take(id, values.size());
  for (const auto id : batch.wanted) {
    const auto replaced = replaced_by(id);
    const int components = field_name(id).components;
    if (replaced && places.contains(*replaced))
      places[id] = places[*replaced];
    else
      take(id, std::size_t(components ? components : law.description().state_components()));
  }
  mpm::LawLayout layout{CLEAVE_TILE_BYTES * rows};
  for (const auto& [id, components] : places) layout.add(id, components);

  std::vector<Row> memory(tiles * rows);
  plugins::Message message;
  Outcome outcome;
  cleave_batch call{};
  call.struct_size = sizeof call;
  call.count = std::uint32_t(batch.count);
  call.layout = layout.get();
  call.streams[0] = memory.data();
  call.time_step = batch.time_step;
  call.status = outcome.status.data();
  call.message = message.get();
  // Lanes beyond the last point are computed too.
  for (const auto& [id, values] : batch.inputs)
    for (std::size_t c = 0; c < values.size(); ++c)
      for (std::size_t k = 0; k < lanes * tiles; ++k)
        *mpm::value_at<T>(call, places[id][c], k) = T(values[c][std::min(k, batch.count - 1)]);

  outcome.result = entry_point(law, batch.single)(law.handle(), &call);
  outcome.message = message.text();
  std::vector<cleave_component> results;
  for (const auto id : batch.wanted) results.insert(results.end(), places[id].begin(), places[id].end());
  outcome.not_finite = mpm::refuse_not_finite<T>(call, results.data(), results.size());
  for (const auto id : batch.wanted)
    for (const auto& component : places[id]) {
      auto& values = outcome.outputs[id].emplace_back();
      for (std::size_t k = 0; k < batch.count; ++k) values.push_back(double(*mpm::value_at<T>(call, component, k)));
    }
  return outcome;
}

/// "b_xx", "F01", "fiber2", "tau_xy"; state variables by their names.
std::vector<std::string> column_names(cleave_field_id id, std::size_t components, const plugins::Description& law) {
  const std::string name = field_name(id).name;
  if (id == CLEAVE_FIELD_STATE || id == CLEAVE_FIELD_STATE_OUT) {
    std::vector<std::string> names;
    for (const auto& state : law.states)
      for (int i = 0; i < int(state.tensor); ++i)
        names.push_back(state.name + (state.tensor == CLEAVE_SCALAR ? "" : std::to_string(i)) +
                        (id == CLEAVE_FIELD_STATE ? "" : "_out"));
    return names;
  }
  if (components == 1) return {name};
  if (components == 9) return matrix_columns(name);
  std::vector<std::string> names;
  for (const char* index : {"xx", "yy", "zz", "xy", "xz", "yz"}) names.push_back(name + "_" + index);
  if (components == 3) names = {name + "0", name + "1", name + "2"};
  return names;
}

std::string table_of(const mpm::FailedBatch& batch, const Outcome& outcome, const plugins::Description& law) {
  const auto precision = batch.single ? config::Precision::single_precision : config::Precision::double_precision;
  std::string text = batch.particles.empty() ? "point" : "particle";
  for (const auto* fields : {&batch.inputs, &outcome.outputs})
    for (const auto& [id, values] : *fields)
      for (const auto& name : column_names(id, values.size(), law)) text += "," + name;
  text += ",status\n";
  for (std::size_t k = 0; k < batch.count; ++k) {
    text += std::to_string(batch.particles.empty() ? std::int64_t(k) : batch.particles[k]);
    for (const auto* fields : {&batch.inputs, &outcome.outputs})
      for (const auto& [id, values] : *fields)
        for (const auto& component : values) {
          text += ',';
          append_number(text, component[k], precision);
        }
    text += ",";
    text += name(outcome.status[k]);
    text += '\n';
  }
  return text;
}

bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0 || (std::isnan(a) && std::isnan(b)); }

bool as_in_the_run(const mpm::FailedBatch& batch, const Outcome& outcome) {
  if (outcome.result != batch.result) return false;
  if (!std::equal(batch.status.begin(), batch.status.end(), outcome.status.begin())) return false;
  for (const auto& [id, values] : outcome.outputs) {
    const auto then = batch.outputs.find(id);
    if (then == batch.outputs.end() || then->second.size() != values.size()) return false;
    for (std::size_t c = 0; c < values.size(); ++c)
      if (!std::equal(values[c].begin(), values[c].end(), then->second[c].begin(), same_bits)) return false;
  }
  return true;
}

std::string summary_of(const mpm::FailedBatch& batch, const Outcome& outcome, const plugins::Description& law, bool& fails) {
  std::size_t failing = 0, first = 0;
  for (std::size_t k = batch.count; k-- > 0;) {
    if (outcome.status[k] < CLEAVE_STATUS_RETRY) continue;
    ++failing;
    first = k;
  }
  fails = failing > 0 || outcome.result != CLEAVE_OK;
  std::string text = law.id + " " + law.version + ", material '" + batch.material + "', " +
                     (batch.single ? "single" : "double") + " precision, " + std::to_string(batch.dimension) + "D: ";
  if (outcome.result != CLEAVE_OK)
    text += "cannot go on: " + (outcome.message.empty() ? "result " + std::to_string(outcome.result) : outcome.message);
  else if (failing == 0)
    text += "none of " + std::to_string(batch.count) + " points fails";
  else
    text +=
        std::to_string(failing) + " of " + std::to_string(batch.count) + " points fail, " +
        (batch.particles.empty() ? "point " + std::to_string(first) : "particle " + std::to_string(batch.particles[first])) +
        " first: " +
        (outcome.not_finite >> first & 1 ? "its numbers are not finite" : std::string(name(outcome.status[first])));
  if (!batch.returned) return text + "; in the run it crashed (" + batch.reason + ")";
  return text + (as_in_the_run(batch, outcome) ? "; status and results are those of the run, to the bit"
                                               : "; status or results differ from those of the run");
}

}  // namespace

Replay replay(const std::filesystem::path& file, plugins::Registry& registry) {
  const mpm::FailedBatch batch = mpm::read_batch(file);
  Replay replay;
  const Material material = make_material(batch, registry, replay.warnings);
  const auto* failed = material.find(batch.failed);
  if (!failed) throw InputError(file.string() + ": error: '" + batch.failed + "' failed, but is not among its laws");
  const auto& law = *failed;
  if (!entry_point(law, batch.single))
    throw InputError(file.string() + ": error: " + batch.failed + " " + law.description().version + " does not offer " +
                     (batch.single ? "single" : "double") + " precision");
  const auto state = batch.inputs.find(CLEAVE_FIELD_STATE);
  if (state != batch.inputs.end() && int(state->second.size()) != law.description().state_components())
    throw InputError(file.string() + ": error: has " + std::to_string(state->second.size()) + " state variables, but " +
                     batch.failed + " " + law.description().version + " has " +
                     std::to_string(law.description().state_components()));
  const Outcome outcome = batch.single ? call_again<float>(batch, law) : call_again<double>(batch, law);
  replay.table = table_of(batch, outcome, law.description());
  replay.summary = summary_of(batch, outcome, law.description(), replay.fails);
  return replay;
}

}  // namespace cleave::point
