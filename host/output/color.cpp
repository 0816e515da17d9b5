#include "output/color.hpp"

#include "common/error.hpp"

#include <cmath>

namespace cleave::output {
namespace {

constexpr Color grey{128, 128, 128};

double length(const float* values, int components) {
  if (components == 1) return double(values[0]);
  double sum = 0;
  for (int c = 0; c < components; c++)  // the last three of a symmetric tensor stand for two entries each
    sum += (components == 6 && c > 2 ? 2 : 1) * double(values[c]) * double(values[c]);
  return std::sqrt(sum);
}

}  // namespace

Color viridis(double x) {
  static constexpr Color colors[] = {{0x44, 0x01, 0x54}, {0x48, 0x28, 0x78}, {0x3e, 0x49, 0x89}, {0x31, 0x68, 0x8e},
                                     {0x26, 0x82, 0x8e}, {0x1f, 0x9e, 0x89}, {0x35, 0xb7, 0x79}, {0x6e, 0xce, 0x58},
                                     {0xb5, 0xde, 0x2b}, {0xfd, 0xe7, 0x25}};
  constexpr int last = int(std::size(colors)) - 1;
  if (std::isnan(x)) return grey;
  const double place = std::clamp(x, 0.0, 1.0) * last;
  const int first = std::min(int(place), last - 1);
  Color color;
  for (std::size_t c = 0; c < 3; c++)
    color[c] = std::uint8_t(std::lround(std::lerp(double(colors[first][c]), double(colors[first + 1][c]), place - first)));
  return color;
}

Color color_of_number(std::int64_t number) {
  static constexpr Color colors[] = {{0x00, 0x72, 0xb2}, {0xe6, 0x9f, 0x00}, {0x00, 0x9e, 0x73}, {0xd5, 0x5e, 0x00},
                                     {0x56, 0xb4, 0xe9}, {0xcc, 0x79, 0xa7}, {0xf0, 0xe4, 0x42}, {0x5a, 0x5a, 0x5a}};
  return number < 0 ? grey : colors[std::size_t(number) % std::size(colors)];
}

void color(ParticleFrame& frame, const ColorBy& by) {
  frame.colors.resize(frame.particles());
  for (auto& mesh : frame.meshes) mesh.colors.clear();
  if (by.name == "body") {
    for (std::size_t i = 0; i < frame.particles(); i++) frame.colors[i] = color_of_number(frame.body_of(i));
    for (auto& mesh : frame.meshes) mesh.colors.assign(mesh.vertex_count(), color_of_number(mesh.body));
    return;
  }
  const auto attribute =
      std::find_if(frame.attributes.begin(), frame.attributes.end(), [&](const Attribute& a) { return a.name == by.name; });
  const bool speed = by.name == "speed", piece = by.name == "piece";
  if (!speed && attribute == frame.attributes.end()) {
    std::string there = "body, speed";
    for (const Attribute& a : frame.attributes) there += ", " + a.name;
    throw InputError("error: output.color: frames do not hold \"" + by.name + "\" to colour by; there are: " + there);
  }
  const auto number_of = [&](std::size_t i) {
    return speed ? double(frame.velocities[i].norm())
                 : length(attribute->values.data() + i * std::size_t(attribute->components), attribute->components);
  };
  if (piece) {
    for (std::size_t i = 0; i < frame.particles(); i++) frame.colors[i] = color_of_number(std::int64_t(number_of(i)));
    for (auto& mesh : frame.meshes)
      for (const std::int32_t number : mesh.piece) mesh.colors.push_back(color_of_number(number));
    return;
  }
  auto range = by.range;
  if (!range && by.name == "damage") range = {0, 1};
  if (!range)
    throw InputError("error: output.color: which values of \"" + by.name +
                     "\" have the first and the last colour? add: range = [least, most]");
  const auto shade = [&](double value) { return viridis((value - range->first) / (range->second - range->first)); };
  for (std::size_t i = 0; i < frame.particles(); i++) frame.colors[i] = shade(number_of(i));
  for (auto& mesh : frame.meshes)
    for (std::size_t i = 0; i < mesh.vertex_count(); i++)
      if (speed && !mesh.velocity.empty())
        mesh.colors.push_back(shade(length(mesh.velocity.data() + 3 * i, 3)));
      else if (by.name == "damage" && !mesh.damage.empty())
        mesh.colors.push_back(shade(double(mesh.damage[i])));
}

}  // namespace cleave::output
