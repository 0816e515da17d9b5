#pragma once

#include "plugins/elastic_probe.hpp"
#include "plugins/registry.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace cleave::bench {

/// A law and the parameters it was made with.
struct Law {
  plugins::Instance instance;
  plugins::GivenParameters parameters;
};

/// A law with what is given and, of the rest, the first typical parameters it accepts (`stress`: see typical_parameters).
/// Throws InputError with what it said to the first of them.
std::unique_ptr<Law> make_law(plugins::Registry&, const std::string& id, const plugins::GivenParameters& given, double stress,
                              const plugins::Context&);

/// Elastic laws, among which others find one to build on.
class ElasticLaws {
 public:
  void add(std::unique_ptr<Law>);

  std::size_t size() const { return laws_.size(); }
  const Law& operator[](std::size_t i) const { return *laws_[i].law; }
  const cleave_elastic_probe& probe(std::size_t i) const { return *laws_[i].probe->get(); }

  /// Position of the first law that offers what all of the others need, of b if there is one; only `named` if that is not
  /// empty. Throws InputError if there is none.
  std::size_t partner(const std::vector<const plugins::Description*>& others, const std::string& named) const;

  /// A law on one of these, as strong as typical solids are for their stiffness. Throws InputError.
  std::unique_ptr<Law> make_paired(plugins::Registry&, const std::string& id, const plugins::GivenParameters& given,
                                   std::size_t elastic, plugins::Context) const;

 private:
  struct Entry {
    std::unique_ptr<Law> law;
    std::unique_ptr<plugins::ElasticProbe> probe;
  };
  std::vector<Entry> laws_;
};

}  // namespace cleave::bench
