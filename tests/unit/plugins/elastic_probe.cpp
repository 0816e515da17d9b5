#include "plugins/elastic_probe.hpp"
#include "law_driver.hpp"

#include <cmath>

namespace cleave::plugins {
namespace {

constexpr double mu = 400, kappa = 900;

cleave_elastic_probe probe(const char* id) {
  auto registry = test::built_plugins();
  const Instance law(registry.load(id), {{"shear_modulus", mu}, {"bulk_modulus", kappa}}, {});
  cleave_elastic_probe result = *ElasticProbe(law).get();
  result.tensile_energy = nullptr;  // it looks at a law that is gone by now
  return result;
}

TEST(ElasticProbe, FindsTheModuliAtRest) {
  for (const char* id : {"elasticity/split-neo-hookean", "elasticity/fixed-corotated"}) {
    EXPECT_NEAR(probe(id).shear_modulus, mu, 1e-8 * mu) << id;
    EXPECT_NEAR(probe(id).bulk_modulus, kappa, 1e-8 * kappa) << id;
  }
}

TEST(ElasticProbe, GivesTheTensileEnergyOfTheLaw) {
  auto registry = test::built_plugins();
  const Instance law(registry.load("elasticity/split-neo-hookean"), {{"shear_modulus", mu}, {"bulk_modulus", kappa}}, {});
  const ElasticProbe probe(law);
  const double stretch = 1.02, J = std::pow(stretch, 3);
  const double F[9] = {stretch, 0, 0, 0, stretch, 0, 0, 0, stretch};
  EXPECT_NEAR(probe.get()->tensile_energy(probe.get(), F), kappa / 2 * ((J * J - 1) / 2 - std::log(J)), 1e-10);
  const double squeezed[9] = {0.9, 0, 0, 0, 0.9, 0, 0, 0, 0.9};
  EXPECT_NEAR(probe.get()->tensile_energy(probe.get(), squeezed), 0, 1e-10);
}

TEST(ElasticProbe, HasNoEnergyWhereTheLawIsUndefinedOrOffersNone) {
  auto registry = test::built_plugins();
  const Instance law(registry.load("elasticity/split-neo-hookean"), {{"shear_modulus", mu}, {"bulk_modulus", kappa}}, {});
  const ElasticProbe probe(law);
  const double inverted[9] = {-1, 0, 0, 0, 1, 0, 0, 0, 1};
  EXPECT_TRUE(std::isnan(probe.get()->tensile_energy(probe.get(), inverted)));
}

}  // namespace
}  // namespace cleave::plugins
