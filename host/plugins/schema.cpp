#include "plugins/schema.hpp"

namespace cleave::plugins {

const char* name(Kind kind) {
  switch (kind) {
    case Kind::elasticity:
      return "elasticity";
    case Kind::plasticity:
      return "plasticity";
    case Kind::damage:
      return "damage";
    case Kind::constraint:
      return "constraint";
    case Kind::discretization:
      return "discretization";
  }
  return "";
}

std::uint64_t Description::capabilities_with(const GivenParameters& given) const {
  std::uint64_t all = capabilities;
  for (const Parameter& parameter : parameters) {
    const auto it = given.find(parameter.key);
    if (parameter.in_set && it == given.end()) continue;
    const Value& value = it == given.end() ? parameter.default_value : it->second;
    const auto* number = std::get_if<double>(&value);
    const auto* list = std::get_if<std::vector<double>>(&value);
    for (std::size_t i = 0; i < parameter.needs.size(); ++i)
      if (number ? i == 0 && *number != 0 : list && i < list->size() && (*list)[i] != 0) all |= parameter.needs[i];
  }
  return all;
}

std::vector<std::string> capability_names(std::uint64_t capabilities) {
  static constexpr struct {
    cleave_capability bit;
    const char* name;
  } all[] = {
      {CLEAVE_ACCEPTS_B, "accepts b"},
      {CLEAVE_ACCEPTS_F, "accepts F"},
      {CLEAVE_ISOTROPIC, "isotropic"},
      {CLEAVE_INVERSION_SAFE, "inversion safe"},
      {CLEAVE_NEEDS_FIBER, "needs a fiber"},
      {CLEAVE_NEEDS_SECOND_FIBER, "needs a second fiber"},
      {CLEAVE_HAS_ENERGY, "energy"},
      {CLEAVE_HAS_PIOLA, "first Piola-Kirchhoff stress"},
      {CLEAVE_HAS_TANGENT, "tangent"},
      {CLEAVE_HAS_WAVE_MODULUS, "wave modulus"},
      {CLEAVE_HAS_EFFECTIVE_STRESS, "effective stress"},
      {CLEAVE_NEEDS_ISOCHORIC_RESPONSE, "needs the isochoric response"},
      {CLEAVE_NEEDS_TENSILE_ENERGY, "needs the tensile energy"},
      {CLEAVE_NEEDS_EFFECTIVE_STRESS, "needs the effective stress"},
      {CLEAVE_NEEDS_ELASTICITY, "needs an elastic law"},
      {CLEAVE_NEEDS_TETRAHEDRA, "needs tetrahedra"},
      {CLEAVE_FLOW_IS_ISOCHORIC, "isochoric flow"},
      {CLEAVE_DAMAGE_IS_LOCAL, "local damage"},
      {CLEAVE_SINGLE, "single precision"},
      {CLEAVE_DOUBLE, "double precision"},
      {CLEAVE_HAS_ISOCHORIC_RESPONSE, "isochoric response"},
  };
  std::vector<std::string> names;
  for (const auto& entry : all)
    if (capabilities & entry.bit) names.emplace_back(entry.name);
  return names;
}

}  // namespace cleave::plugins
