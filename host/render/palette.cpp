#include "output/color.hpp"
#include "render/painter.hpp"

#include <algorithm>
#include <cmath>

namespace cleave::render {

Color palette_color(Palette palette, double x) {
  static constexpr Color heat[] = {{255, 247, 236}, {254, 232, 200}, {253, 212, 158}, {253, 187, 132}, {252, 141, 89},
                                   {239, 101, 72},  {215, 48, 31},   {179, 0, 0},     {127, 0, 0}};
  constexpr int last = int(std::size(heat)) - 1;
  if (palette != Palette::heat || std::isnan(x)) return output::viridis(x);
  const double place = std::clamp(x, 0.0, 1.0) * last;
  const int first = std::min(int(place), last - 1);
  Color color;
  for (std::size_t c = 0; c < 3; c++)
    color[c] = std::uint8_t(std::lround(std::lerp(double(heat[first][c]), double(heat[first + 1][c]), place - first)));
  return color;
}

std::string default_color(const output::ParticleFrame& frame) {
  const auto any = [](const std::vector<float>& damage) {
    return std::any_of(damage.begin(), damage.end(), [](float d) { return d > 0.05f; });
  };
  bool damaged = false;
  for (const output::Attribute& a : frame.attributes) damaged = damaged || (a.name == "damage" && any(a.values));
  for (const output::BodyMesh& mesh : frame.meshes) damaged = damaged || any(mesh.damage);
  return damaged ? "damage" : "body";
}

bool is_needed(const Look& look, const std::string& attribute) { return attribute == look.color || attribute == "damage"; }

}  // namespace cleave::render
