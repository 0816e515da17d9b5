#include "lent_law.hpp"

#include "discretization/elastic_response.hpp"

namespace cleave::test {

struct LentLaw::Lent {
  plugins::Instance law;
  discretization::ElasticResponse response;

  Lent(plugins::Instance instance, std::size_t points)
      : law(std::move(instance)),
        response(law, "body",
                 {std::vector<Vector3>(points, Vector3::UnitX()), std::vector<Vector3>(points, Vector3::UnitY())}) {}
};

LentLaw::LentLaw(const std::string& name, const std::map<std::string, double>& parameters, std::size_t points) {
  static plugins::Registry registry({CLEAVE_PLUGINS});
  plugins::GivenParameters given;
  for (const auto& [key, value] : parameters) given.emplace(key, value);
  lent_ = std::make_unique<Lent>(plugins::Instance(registry.load("elasticity/" + name), given, {}), points);
}
LentLaw::~LentLaw() = default;
const cleave_elastic_response* LentLaw::table() const { return lent_->response.table(); }

}  // namespace cleave::test
