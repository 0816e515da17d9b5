#pragma once

#include "config/catalog.hpp"

#include <map>

namespace cleave::config::testing {

/// Laws made up for the tests, one for each thing a schema can say.
class FakeCatalog : public PluginCatalog {
 public:
  FakeCatalog() {
    add(elastic("neo-hookean", CLEAVE_ACCEPTS_B | CLEAVE_SINGLE | CLEAVE_DOUBLE | CLEAVE_HAS_ENERGY |
                                   CLEAVE_HAS_EFFECTIVE_STRESS | CLEAVE_HAS_ISOCHORIC_RESPONSE));
    add(elastic("stress-only", CLEAVE_SINGLE | CLEAVE_DOUBLE));
    add(elastic("double-only", CLEAVE_DOUBLE));
    add(elastic("fibrous", CLEAVE_SINGLE | CLEAVE_DOUBLE | CLEAVE_NEEDS_FIBER));
    add(elastic("woven", CLEAVE_SINGLE | CLEAVE_DOUBLE | CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER));

    plugins::Description yield = law(plugins::Kind::plasticity, "yield",
                                     CLEAVE_ACCEPTS_B | CLEAVE_SINGLE | CLEAVE_DOUBLE | CLEAVE_NEEDS_ISOCHORIC_RESPONSE);
    yield.parameters = {number("yield_stress", "Pa", 0, true), number("hardening", "Pa", 0, false)};
    yield.parameters[0].required = true;
    yield.parameters[1].default_value = 0.0;
    plugins::Parameter steps = number("steps", "1", 1, false);
    steps.type = CLEAVE_TYPE_INTEGER;
    steps.maximum = 10;
    steps.default_value = std::int64_t(4);
    plugins::Parameter closure = number("closure", "", 0, false);
    closure.type = CLEAVE_TYPE_TEXT;
    closure.choices = {"exact", "paper"};
    closure.default_value = std::string("exact");
    plugins::Parameter track = number("track_volume", "", 0, false);
    track.type = CLEAVE_TYPE_BOOLEAN;
    track.default_value = true;
    plugins::Parameter backstress = number("backstress", "Pa", 0, false);
    backstress.type = CLEAVE_TYPE_NUMBER_LIST;
    backstress.minimum = -1e9;
    backstress.maximum = 1e9;
    backstress.min_count = backstress.max_count = 6;
    backstress.default_value = std::vector<double>(6, 0.0);
    yield.parameters.insert(yield.parameters.end(), {steps, closure, track, backstress});
    yield.states.resize(1);
    yield.states[0].name = "alpha";
    add(yield);

    plugins::Description fracture =
        law(plugins::Kind::damage, "fracture", CLEAVE_SINGLE | CLEAVE_DOUBLE | CLEAVE_NEEDS_TENSILE_ENERGY);
    fracture.parameters = {number("toughness", "J/m^2", 0, true)};
    fracture.parameters[0].required = true;
    fracture.parameters[0].description = "energy of a crack per area";
    add(fracture);
    plugins::Description rankine =
        law(plugins::Kind::damage, "rankine", CLEAVE_SINGLE | CLEAVE_DOUBLE | CLEAVE_NEEDS_EFFECTIVE_STRESS);
    rankine.parameters = {number("strength", "Pa", 0, true), number("toughness", "J/m^2", 0, true)};
    for (auto& parameter : rankine.parameters) parameter.in_set = true;
    rankine.alternatives = {{{{"strength"}, {"toughness"}}, true}};
    add(rankine);

    add(law(plugins::Kind::discretization, "cells", CLEAVE_DOUBLE | CLEAVE_NEEDS_ELASTICITY | CLEAVE_NEEDS_TETRAHEDRA));
  }

  const plugins::Description* find(std::string_view id) const override {
    const auto found = laws_.find(id);
    return found == laws_.end() ? nullptr : &found->second;
  }
  std::vector<std::string> ids(plugins::Kind kind) const override {
    std::vector<std::string> ids;
    for (const auto& [id, law] : laws_)
      if (law.kind == kind) ids.push_back(id);
    return ids;
  }
  std::string refusal(std::string_view id) const override {
    return id == "elasticity/broken" ? "/plugins/broken.so: speaks ABI 2, this program speaks ABI 1" : "";
  }

 private:
  static plugins::Parameter number(const std::string& key, const std::string& unit, double minimum, bool minimum_open) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    plugins::Parameter parameter{};
    parameter.key = key;
    parameter.unit = unit;
    parameter.minimum = minimum;
    parameter.minimum_open = minimum_open;
    parameter.maximum = infinity;
    parameter.physical_minimum = -infinity;
    parameter.physical_maximum = infinity;
    parameter.default_value = 0.0;
    return parameter;
  }

  static plugins::Description law(plugins::Kind kind, const std::string& name, std::uint64_t capabilities) {
    plugins::Description law;
    law.kind = kind;
    law.id = plugins::name(kind) + ("/" + name);
    law.capabilities = capabilities;
    return law;
  }

  static plugins::Description elastic(const std::string& name, std::uint64_t capabilities) {
    plugins::Description law = FakeCatalog::law(plugins::Kind::elasticity, name, capabilities);
    plugins::Parameter young = number("youngs_modulus", "Pa", 0, true);
    young.physical_minimum = 1;
    young.physical_maximum = 2e12;
    plugins::Parameter poisson = number("poissons_ratio", "1", -1, true);
    poisson.maximum = 0.5;
    poisson.maximum_open = true;
    law.parameters = {young, poisson, number("shear_modulus", "Pa", 0, true), number("bulk_modulus", "Pa", 0, true)};
    for (auto& parameter : law.parameters) parameter.in_set = true;
    law.alternatives = {
        {{{"youngs_modulus", "poissons_ratio"}, {"shear_modulus", "bulk_modulus"}, {"youngs_modulus", "bulk_modulus"}}, false}};
    return law;
  }

  void add(const plugins::Description& law) { laws_[law.id] = law; }

  std::map<std::string, plugins::Description, std::less<>> laws_;
};

}  // namespace cleave::config::testing
