#include "point/laws.hpp"

#include "common/error.hpp"
#include "config/law_reader.hpp"
#include "config/overrides.hpp"
#include "plugins/elastic_probe.hpp"
#include "scene/fiber_field.hpp"

#include <charconv>
#include <cmath>

namespace cleave::point {
namespace {

using plugins::Kind;

constexpr config::Remedies remedies{.fiber = "give --fiber x,y,z",
                                    .both_fibers = "give --fiber x,y,z (and --fiber2 x,y,z)",
                                    .second_fiber = "give --fiber2 x,y,z",
                                    .single_precision = "give --precision single",
                                    .double_precision = "give --precision double"};

[[noreturn]] void refuse(const std::string& option, const std::string& what) { throw InputError(option + ": error: " + what); }

Vector3 parse_direction(const char* option, const std::string& text) {
  const std::string location = std::string(option) + " " + text;
  Vector3 direction;
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  for (int i = 0; i < 3; ++i) {
    const auto [next, problem] = std::from_chars(at, end, direction[i]);
    const bool closed = i < 2 ? next != end && *next == ',' : next == end;
    if (problem != std::errc() || !closed || !std::isfinite(direction[i])) refuse(location, "must be three numbers x,y,z");
    at = next + 1;
  }
  const double length = direction.stableNorm();
  if (!(length > 0)) refuse(location, "must be a direction: not all of its numbers may be 0");
  // A unit vector is kept to the bit.
  return std::abs(direction.squaredNorm() - 1) < 1e-14 ? direction : Vector3(direction / length);
}

std::optional<config::Fibers> read_fibers(const LawChoice& choice) {
  if (!choice.fiber) {
    if (choice.second_fiber) refuse("--fiber2", "is given without --fiber");
    return std::nullopt;
  }
  config::Fibers fibers{parse_direction("--fiber", *choice.fiber), std::nullopt};
  if (!choice.second_fiber) {
    fibers.second = scene::perpendicular_to(fibers.direction);
    return fibers;
  }
  constexpr double tolerance = 1e-6;
  const Vector3 second = parse_direction("--fiber2", *choice.second_fiber);
  const double cosine = second.dot(fibers.direction);
  if (std::abs(cosine) > tolerance)
    refuse("--fiber2 " + *choice.second_fiber,
           "must be orthogonal to --fiber " + *choice.fiber + ", the cosine of their angle is " + std::to_string(cosine));
  fibers.second = cosine == 0 ? second : Vector3((second - cosine * fibers.direction).normalized());
  return fibers;
}

config::Precision read_precision(const std::string& word) {
  if (word == "single") return config::Precision::single_precision;
  if (word == "double") return config::Precision::double_precision;
  refuse("--precision " + word, "must be single or double");
}

/// { plugin = ID } located at the option that names it.
toml::table law_table(Kind kind, const std::string& id) {
  std::string quoted;
  for (const char c : id) quoted += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
  const std::string option = std::string(config::option_prefix) + plugins::name(kind);
  try {
    return toml::parse(std::string(plugins::name(kind)) + " = { plugin = \"" + quoted + "\" }", option);
  } catch (const toml::parse_error&) {
    refuse(option, "'" + id + "' is not the name of a plugin");
  }
}

plugins::Instance instantiate(const config::PluginUse& use, plugins::Registry& registry, const plugins::Context& context) {
  try {
    return plugins::Instance(registry.load(use.id), use.parameters, context);
  } catch (const InputError& e) {
    refuse(to_string(use.where), e.what());
  }
}

config::Override parse_set(const std::string& text) {
  const auto equals = text.find('='), dot = text.find('.');
  if (equals == std::string::npos || dot == 0 || dot > equals || dot + 1 == equals)
    refuse(std::string(config::override_prefix) + text,
           "expected law.parameter=value, for example elasticity.youngs_modulus=1e6");
  return config::parse_override(text);
}

/// The laws as a material of a scene, so that both are checked by the same code.
config::Material read_material(const LawChoice& choice, config::Precision precision, config::ReadContext& context) {
  config::Material material;
  material.name = "point";
  material.where = {"--fiber"};
  material.fibers = read_fibers(choice);

  toml::table root;
  const auto add = [&](Kind kind, const std::optional<std::string>& id) {
    if (!id) return;
    toml::table law = law_table(kind, *id);
    auto& table = *law.get_as<toml::table>(plugins::name(kind));
    table.is_inline(false);
    root.insert_or_assign(plugins::name(kind), std::move(table));
  };
  add(Kind::elasticity, choice.elasticity);
  add(Kind::plasticity, choice.plasticity);
  add(Kind::damage, choice.damage);
  for (const std::string& set : choice.sets) apply_override(root, parse_set(set), context.diagnostics);

  config::TableReader reader(root, "a material point", context);
  const auto read = [&](Kind kind, bool chosen) -> std::optional<config::PluginUse> {
    const std::string key = plugins::name(kind);
    auto table = reader.table(key, key);
    if (!table) return std::nullopt;
    if (chosen) return read_law(*table, kind);
    for (const auto& [parameter, value] : *root.get_as<toml::table>(key))
      table->error(table->where(parameter.str()), "there is no " + key + " law to set this for; give --" + key);
    return std::nullopt;
  };
  if (auto elasticity = read(Kind::elasticity, true)) material.elasticity = std::move(*elasticity);
  material.plasticity = read(Kind::plasticity, choice.plasticity.has_value());
  material.damage = read(Kind::damage, choice.damage.has_value());
  reader.finish();
  context.diagnostics.throw_errors();

  check_combination(material, precision, context, remedies);
  context.diagnostics.throw_errors();
  return material;
}

}  // namespace

double Laws::damage_after(double seconds, double damage, double driving_force) const {
  const double rest = driving_force / (1 + driving_force);
  return damage >= rest ? damage : rest + (damage - rest) * std::exp(-(1 + driving_force) * seconds / viscosity);
}

Laws make_laws(const LawChoice& choice, plugins::Registry& registry, std::vector<std::string>& warnings) {
  if (choice.elasticity.empty()) refuse("--elasticity", "is needed: the name of an elasticity law");
  if (!(choice.cell_size >= 0) || !std::isfinite(choice.cell_size)) refuse("--cell-size", "must be a length in metres");

  config::Diagnostics diagnostics;
  const auto catalog = config::catalog_of(registry);
  config::ReadContext context{diagnostics, *catalog, {}, {}, 3};
  const config::Precision precision = read_precision(choice.precision);
  const config::Material material = read_material(choice, precision, context);
  const auto said = diagnostics.warnings();
  warnings.insert(warnings.end(), said.begin(), said.end());
  return laws_of(material, precision, {.dimension = 3, .cell_size = choice.cell_size}, registry);
}

Laws laws_of(const config::Material& material, config::Precision precision, plugins::Context surroundings,
             plugins::Registry& registry) {
  Laws laws;
  laws.precision = precision;
  laws.elasticity = instantiate(material.elasticity, registry, surroundings);
  const plugins::ElasticProbe probe(laws.elasticity);
  surroundings.isochoric = laws.elasticity.isochoric_response();
  surroundings.elastic = probe.get();
  laws.stiffness = probe.get()->bulk_modulus + 4. / 3 * probe.get()->shear_modulus;
  if (material.plasticity) laws.plasticity = instantiate(*material.plasticity, registry, surroundings);
  if (material.damage) {
    laws.damage = instantiate(*material.damage, registry, surroundings);
    laws.damage_is_local = laws.damage.description().can(CLEAVE_DAMAGE_IS_LOCAL);
    cleave_damage_model model{};
    model.struct_size = sizeof model;
    laws.damage.damage().model(laws.damage.handle(), &model);
    laws.residual = model.residual;
    laws.viscosity = model.viscosity;
  }
  laws.fibers = material.fibers;
  return laws;
}

}  // namespace cleave::point
