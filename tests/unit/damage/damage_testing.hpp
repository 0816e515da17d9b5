#pragma once

#include "../../reference_data.hpp"
#include "../../reference_table.hpp"
#include "../plugins/law_driver.hpp"
#include "../plugins/strains.hpp"

#include "common/error.hpp"
#include "plugins/elastic_probe.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

namespace cleave::plugins::test {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// An elastic law and what a damage law may ask of it.
class Elastic {
 public:
  explicit Elastic(const GivenParameters& moduli, const char* id = "elasticity/split-neo-hookean")
      : law_(built_plugins().load(id), moduli, {}), probe_(law_) {}

  const Instance& law() const { return law_; }
  /// Surroundings of a law of the same material.
  Context context(double cell_size = 0) const {
    Context context;
    context.cell_size = cell_size;
    context.elastic = probe_.get();
    return context;
  }

 private:
  Instance law_;
  ElasticProbe probe_;
};

inline Instance damage_law(const char* id, const GivenParameters& given, const Context& context = {}) {
  return Instance(built_plugins().load(id), given, context);
}

/// The message with which a damage law refuses its parameters.
inline std::string refusal(const char* id, const GivenParameters& given, const Context& context = {}) {
  try {
    damage_law(id, given, context);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

template <class S>
auto drive(const Instance& law) {
  if constexpr (sizeof(S) == 4)
    return law.damage().drive_f32;
  else
    return law.damage().drive_f64;
}

inline cleave_damage_model model_of(const Instance& law) {
  cleave_damage_model model{};
  model.struct_size = sizeof model;
  law.damage().model(law.handle(), &model);
  return model;
}

inline std::vector<double> stress(const Tensor& s) { return symmetric(s); }

inline Tensor matrix_of(const std::map<std::string, std::string>& row, const std::string& letter) {
  Tensor a;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) a(i, j) = std::stod(row.at(letter + std::to_string(i) + std::to_string(j)));
  return a;
}

/// Symmetric tensors with entries of magnitude up to `size`.
inline std::vector<Tensor> random_stresses(int count, double size, unsigned seed = 11) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-size, size);
  std::vector<Tensor> all;
  for (int i = 0; i < count; ++i) {
    const Tensor a = Tensor::NullaryExpr([&] { return uniform(random); });
    all.push_back((a + a.transpose()) / 2);
  }
  return all;
}

}  // namespace cleave::plugins::test
