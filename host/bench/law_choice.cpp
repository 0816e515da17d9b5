#include "bench/law_choice.hpp"

#include "bench/typical_parameters.hpp"
#include "common/error.hpp"

#include <algorithm>
#include <optional>

namespace cleave::bench {
namespace {

/// Strength of a typical solid over its shear modulus.
constexpr double strength_over_stiffness = 0.01;

bool offers_what_is_needed(const plugins::Instance& elastic, const plugins::Description& law) {
  return (!law.can(CLEAVE_NEEDS_ISOCHORIC_RESPONSE) || elastic.can(CLEAVE_HAS_ISOCHORIC_RESPONSE)) &&
         (!law.can(CLEAVE_NEEDS_TENSILE_ENERGY) || elastic.can(CLEAVE_HAS_ENERGY)) &&
         (!law.can(CLEAVE_NEEDS_EFFECTIVE_STRESS) || elastic.can(CLEAVE_HAS_EFFECTIVE_STRESS));
}

}  // namespace

std::unique_ptr<Law> make_law(plugins::Registry& registry, const std::string& id, const plugins::GivenParameters& given,
                              double stress, const plugins::Context& context) {
  const auto plugin = registry.load(id);
  std::string refusal;
  for (const auto& parameters : typical_parameters(plugin->description(), given, stress)) {
    try {
      return std::make_unique<Law>(Law{plugins::Instance(plugin, parameters, context), parameters});
    } catch (const InputError& error) {
      if (refusal.empty()) refusal = error.what();
    }
  }
  throw InputError(refusal);
}

void ElasticLaws::add(std::unique_ptr<Law> law) {
  auto probe = std::make_unique<plugins::ElasticProbe>(law->instance);
  laws_.push_back({std::move(law), std::move(probe)});
}

std::size_t ElasticLaws::partner(const std::vector<const plugins::Description*>& others, const std::string& named) const {
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < laws_.size(); ++i) {
    const plugins::Instance& candidate = laws_[i].law->instance;
    const bool suits =
        std::all_of(others.begin(), others.end(), [&](const auto* other) { return offers_what_is_needed(candidate, *other); });
    if (!suits || (!named.empty() && candidate.description().id != named)) continue;
    if (!found || (candidate.can(CLEAVE_ACCEPTS_B) && !laws_[*found].law->instance.can(CLEAVE_ACCEPTS_B))) found = i;
  }
  if (!found) throw InputError(named.empty() ? "no elastic law offers what it needs" : named + " does not offer what it needs");
  return *found;
}

std::unique_ptr<Law> ElasticLaws::make_paired(plugins::Registry& registry, const std::string& id,
                                              const plugins::GivenParameters& given, std::size_t elastic,
                                              plugins::Context context) const {
  context.isochoric = laws_[elastic].law->instance.isochoric_response();
  context.elastic = laws_[elastic].probe->get();
  return make_law(registry, id, given, strength_over_stiffness * context.elastic->shear_modulus, context);
}

}  // namespace cleave::bench
