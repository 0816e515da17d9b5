#include "bench/typical_parameters.hpp"

#include <cleave/abi.h>

#include <algorithm>
#include <cmath>

namespace cleave::bench {
namespace {

using plugins::GivenParameters;
using plugins::Parameter;

constexpr std::uint64_t fiber_capabilities = CLEAVE_NEEDS_FIBER | CLEAVE_NEEDS_SECOND_FIBER;

/// Energy density over stress at failure: the strain there.
constexpr double strain_at_failure = 0.01;

/// `place` in (0, 1) of the range materials have; on a logarithmic scale where it spans orders of magnitude.
double typical_number(const Parameter& parameter, double stress, double place) {
  const double low = parameter.physical_minimum, high = parameter.physical_maximum;
  if (stress > 0 && parameter.unit == "Pa") return std::clamp(stress, low, high);
  if (stress > 0 && parameter.unit == "J/m^3") return std::clamp(strain_at_failure * stress, low, high);
  if (std::isfinite(low) && std::isfinite(high)) {
    if (low > 0 && high > 100 * low) return low * std::pow(high / low, place);
    return low + place * (high - low);
  }
  if (std::isfinite(low)) return low + 2 * place;
  if (std::isfinite(high)) return high - 2 * place;
  return place;
}

plugins::Value typical_value(const Parameter& parameter, double stress, double place) {
  switch (parameter.type) {
    case CLEAVE_TYPE_NUMBER:
      return typical_number(parameter, stress, place);
    case CLEAVE_TYPE_INTEGER:
      return std::int64_t(std::llround(typical_number(parameter, stress, place)));
    case CLEAVE_TYPE_BOOLEAN:
      return true;
    case CLEAVE_TYPE_TEXT:
      return parameter.choices.empty() ? std::string() : parameter.choices.front();
    case CLEAVE_TYPE_NUMBER_LIST:
      break;
  }
  return std::vector<double>(std::max(1u, parameter.min_count), typical_number(parameter, stress, place));
}

const Parameter& find(const plugins::Description& law, const std::string& key) {
  return *std::find_if(law.parameters.begin(), law.parameters.end(), [&](const Parameter& p) { return p.key == key; });
}

bool contains(const std::vector<std::string>& set, const std::string& key) {
  return std::find(set.begin(), set.end(), key) != set.end();
}

/// The sets that can complete what is given of them; nothing to add if none has to be given.
std::vector<std::vector<std::string>> completions(const plugins::Alternatives& alternatives, const GivenParameters& given) {
  std::vector<std::string> begun;
  for (const auto& set : alternatives.sets)
    for (const auto& key : set)
      if (given.contains(key)) begun.push_back(key);
  if (begun.empty() && alternatives.optional) return {{}};
  std::vector<std::vector<std::string>> sets;
  for (const auto& set : alternatives.sets)
    if (std::all_of(begun.begin(), begun.end(), [&](const auto& key) { return contains(set, key); })) sets.push_back(set);
  // What cannot be completed is left to the law's own refusal.
  return sets.empty() ? std::vector<std::vector<std::string>>{{}} : sets;
}

}  // namespace

std::vector<GivenParameters> typical_parameters(const plugins::Description& law, const GivenParameters& given, double stress) {
  std::vector<std::vector<std::string>> wanted{{}};
  for (const auto& parameter : law.parameters)
    if (parameter.required) wanted[0].push_back(parameter.key);
  for (const auto& alternatives : law.alternatives) {
    std::vector<std::vector<std::string>> extended;
    for (const auto& set : completions(alternatives, given))
      for (auto keys : wanted) {
        keys.insert(keys.end(), set.begin(), set.end());
        extended.push_back(keys);
      }
    wanted = extended;
  }
  std::vector<GivenParameters> all;
  for (double place : {0.5, 0.25, 0.75, 0.1})
    for (const auto& keys : wanted) {
      GivenParameters parameters = given;
      for (const auto& key : keys)
        if (!given.contains(key)) parameters[key] = typical_value(find(law, key), stress, place);
      all.push_back(parameters);
    }
  return all;
}

GivenParameters fiber_parameters(const plugins::Description& law) {
  if (law.capabilities_with({}) & fiber_capabilities) return {};
  GivenParameters parameters;
  for (const auto& parameter : law.parameters)
    if ((parameter.needs[0] | parameter.needs[1]) & fiber_capabilities)
      parameters[parameter.key] = typical_value(parameter, 0, 0.5);
  return parameters;
}

}  // namespace cleave::bench
