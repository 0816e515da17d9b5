#include "output/names.hpp"

#include <cmath>
#include <numbers>

namespace cleave::output {

std::string UniqueNames::add(const std::string& wish) {
  std::string name;
  for (const char c : wish) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'), digit = c >= '0' && c <= '9';
    if (digit && name.empty()) name += '_';
    name += letter || digit ? c : '_';
  }
  if (name.empty()) name += '_';
  while (!taken_.insert(name).second) name += '_';
  return name;
}

std::vector<std::string> attribute_names(const ParticleFrame& frame) {
  UniqueNames unique(
      {"P", "id", "v", "velocity", "pscale", "body", "x", "y", "z", "vx", "vy", "vz", "Cd", "Color", "red", "green", "blue"});
  std::vector<std::string> names;
  for (const Attribute& attribute : frame.attributes) names.push_back(unique.add(attribute.name));
  return names;
}

std::vector<std::string> component_suffixes(int components) {
  switch (components) {
    case 1:
      return {""};
    case 3:
      return {"x", "y", "z"};
    case 6:
      return {"xx", "yy", "zz", "xy", "xz", "yz"};
    case 9:
      return {"xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"};
    default: {
      std::vector<std::string> numbers;
      for (int i = 0; i < components; ++i) numbers.push_back(std::to_string(i));
      return numbers;
    }
  }
}

float particle_radius(float volume, int dimension) {
  constexpr double pi = std::numbers::pi;
  const double v = volume > 0 ? volume : 0;
  return static_cast<float>(dimension == 2 ? std::sqrt(v / pi) : std::cbrt(3 * v / (4 * pi)));
}

}  // namespace cleave::output
