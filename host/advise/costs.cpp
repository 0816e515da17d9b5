#include "advise/costs.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

namespace cleave::advise {
namespace {

constexpr char shipped_costs[] =
#include "advise/costs.inc"
    ;

}  // namespace

Costs Costs::parse(const std::string& text, const std::string& name) try {
  auto documents = nlohmann::json::parse(text);
  if (!documents.is_array()) documents = nlohmann::json::array({documents});
  Costs costs;
  for (const auto& document : documents)
    for (const auto& result : document.at("results")) {
      Entry entry;
      for (const auto& [id, parameters] : result.at("laws").items()) entry.laws.insert(id);
      entry.precision =
          result.at("precision") == "single" ? config::Precision::single_precision : config::Precision::double_precision;
      entry.dimension = document.at("dimension");
      entry.nanoseconds = result.at("fastest_ns").get<double>() * result.at("threads").get<double>();
      costs.entries_.push_back(std::move(entry));
    }
  return costs;
} catch (const nlohmann::json::exception& problem) {
  throw InputError(name + ": error: is no record of `cleave bench steps --json`: " + problem.what());
}

Costs Costs::shipped() { return parse(shipped_costs, "costs"); }

Costs Costs::read(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path.string() + ": error: cannot be read");
  std::ostringstream text;
  text << file.rdbuf();
  return parse(text.str(), path.string());
}

void Costs::add(const Costs& other) { entries_.insert(entries_.begin(), other.entries_.begin(), other.entries_.end()); }

std::optional<double> Costs::nanoseconds(const std::set<std::string>& laws, config::Precision precision, int dimension) const {
  const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& e) {
    return e.laws == laws && e.precision == precision && e.dimension == dimension;
  });
  return found == entries_.end() ? std::nullopt : std::optional(found->nanoseconds);
}

std::set<std::string> Costs::laws_of(const config::Material& material) {
  std::set<std::string> ids{material.elasticity.id};
  for (const auto* law : {&material.plasticity, &material.damage, &material.constraint})
    if (*law) ids.insert((*law)->id);
  return ids;
}

}  // namespace cleave::advise
