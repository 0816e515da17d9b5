#include "report/points.hpp"

#include "common/error.hpp"
#include "render/run_frames.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace cleave::report {
namespace {

using nlohmann::json;

/// A mixture of all bits (S. Vigna's splitmix64): neighbouring ids are scattered.
std::uint64_t scattered(std::uint64_t id) {
  id += 0x9e3779b97f4a7c15;
  id = (id ^ (id >> 30)) * 0xbf58476d1ce4e5b9;
  id = (id ^ (id >> 27)) * 0x94d049bb133111eb;
  return id ^ (id >> 31);
}

std::vector<std::size_t> sample(std::size_t particles, std::size_t most) {
  std::vector<std::size_t> order(particles);
  std::iota(order.begin(), order.end(), std::size_t(0));
  if (particles > most) {
    std::nth_element(order.begin(), order.begin() + std::ptrdiff_t(most), order.end(),
                     [](std::size_t a, std::size_t b) { return scattered(a) < scattered(b); });
    order.resize(most);
    std::sort(order.begin(), order.end());
  }
  return order;
}

std::vector<int> evenly(const std::vector<int>& indices, int most) {
  const auto n = int(indices.size());
  if (n <= most) return indices;
  std::vector<int> chosen;
  for (int i = 0; i < most; i++) chosen.push_back(indices[std::size_t(std::int64_t(i) * (n - 1) / std::max(most - 1, 1))]);
  return chosen;
}

struct Shown {
  std::string name, unit;
  bool numbered = false;
  std::size_t components = 1;
};

/// What the view can be coloured by: the speed, bodies if there are several, and what numbers there are of particles.
std::vector<Shown> shown_attributes(const output::ParticleFrame& frame) {
  std::vector<Shown> shown;
  const auto add = [&](const char* name) {
    for (const auto& a : frame.attributes)
      if (a.name == name && a.components == 1) shown.push_back({a.name, a.unit, a.name == "piece"});
  };
  add("damage");
  add("piece");
  if (frame.bodies.size() > 1) shown.push_back({"body", "", true});
  shown.push_back({"speed", "m/s"});
  for (const auto& a : frame.attributes)
    if (a.components == 1 && a.name != "damage" && a.name != "piece" && shown.size() < 8) shown.push_back({a.name, a.unit});
  return shown;
}

/// From small to large, without the thousandth at either end, with half as much around: what is thrown far away does not make
/// all the rest small.
std::pair<double, double> extent(std::vector<float>& values) {
  std::erase_if(values, [](float x) { return !std::isfinite(x); });
  if (values.empty()) return {0, 0};
  const std::size_t beyond = values.size() / 1000, last = values.size() - 1 - beyond;
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(beyond), values.end());
  const auto low = double(values[beyond]);
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(last), values.end());
  const auto high = double(values[last]);
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  const double room = 0.5 * (high - low);
  return {std::max(low - room, double(*least)), std::min(high + room, double(*most))};
}

}  // namespace

std::string base64(std::span<const std::byte> bytes) {
  static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    unsigned triple = 0;
    for (std::size_t k = 0; k < 3; k++) triple = triple << 8 | (k < count ? std::to_integer<unsigned>(bytes[i + k]) : 0);
    for (std::size_t k = 0; k < 4; k++) text += k <= count ? digits[triple >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

json points_of(const std::filesystem::path& run, const Limits& limits) {
  struct View {
    int index;
    double time;
    std::vector<float> places;               // x of all, y of all, z of all
    std::vector<std::vector<float>> values;  // of each attribute
  };
  std::vector<View> views;
  std::vector<Shown> shown;
  std::vector<std::size_t> chosen;
  std::vector<std::string> bodies;
  std::size_t total = 0;
  double radius = 0;
  try {
    const render::RunFrames frames(run);
    const auto indices = evenly(frames.indices(), limits.frames);
    for (const int index : indices) {
      const auto frame = frames.load(
          index, [](const std::string&) { return true; }, 3);
      if (views.empty()) {
        shown = shown_attributes(frame);
        total = frame.particles();
        if (total == 0) return nullptr;
        bodies = frame.bodies;
        const double per_point = double(indices.size()) * double(6 + shown.size());
        chosen = sample(total, std::size_t(std::clamp(limits.megabytes * 1e6 / per_point, 1., double(limits.points))));
        std::vector<float> volumes = frame.volumes;
        std::nth_element(volumes.begin(), volumes.begin() + std::ptrdiff_t(total / 2), volumes.end());
        radius = std::cbrt(3 * double(volumes[total / 2]) / (4 * M_PI));
      }
      if (frame.particles() != total) throw InputError("frames hold different numbers of particles");
      View view{index, frame.time, {}, {}};
      for (int a = 0; a < 3; a++)
        for (const std::size_t i : chosen) view.places.push_back(float(frame.positions[i][a]));
      for (const Shown& attribute : shown) {
        std::vector<float>& values = view.values.emplace_back();
        const auto found = std::find_if(frame.attributes.begin(), frame.attributes.end(),
                                        [&](const auto& a) { return a.name == attribute.name && a.components == 1; });
        for (const std::size_t i : chosen)
          values.push_back(attribute.name == "body"          ? float(frame.body_of(i))
                           : attribute.name == "speed"       ? frame.velocities[i].norm()
                           : found != frame.attributes.end() ? found->values[i]
                                                             : std::numeric_limits<float>::quiet_NaN());
      }
      views.push_back(std::move(view));
    }
  } catch (const InputError&) {
    if (views.empty()) return nullptr;  // a frame that cannot be read ends the series
  }
  if (views.empty()) return nullptr;

  const std::size_t n = chosen.size();
  json points{{"total", total}, {"shown", n}, {"radius", radius}, {"bodies", bodies}};
  std::array<std::pair<double, double>, 3> box;
  for (std::size_t a = 0; a < 3; a++) {
    std::vector<float> all;
    for (const View& view : views)
      all.insert(all.end(), view.places.begin() + std::ptrdiff_t(a * n), view.places.begin() + std::ptrdiff_t((a + 1) * n));
    box[a] = extent(all);
    points["low"].push_back(box[a].first);
    points["high"].push_back(box[a].second);
  }
  std::vector<std::pair<double, double>> ranges;
  for (std::size_t k = 0; k < shown.size(); k++) {
    std::vector<float> all;
    for (const View& view : views) all.insert(all.end(), view.values[k].begin(), view.values[k].end());
    ranges.push_back(shown[k].name == "damage" ? std::pair(0., 1.) : extent(all));
    json attribute{{"name", shown[k].name}, {"unit", shown[k].unit == "1" ? "" : shown[k].unit}};
    if (shown[k].numbered)
      attribute["numbered"] = true;
    else
      attribute["least"] = ranges[k].first, attribute["most"] = ranges[k].second;
    points["attributes"].push_back(attribute);
  }
  const auto part = [](double x, const std::pair<double, double>& range, double parts) {
    return range.second > range.first
               ? std::lround(parts * std::clamp((x - range.first) / (range.second - range.first), 0., 1.))
               : 0L;
  };
  for (const View& view : views) {
    std::vector<std::byte> data;
    data.reserve(n * (6 + shown.size()));
    for (std::size_t a = 0; a < 3; a++)
      for (std::size_t i = 0; i < n; i++) {
        const float x = view.places[a * n + i];
        const auto value = std::uint16_t(std::isfinite(x) ? part(double(x), box[a], 65535) : 65535);
        data.push_back(std::byte(value & 255));
        data.push_back(std::byte(value >> 8));
      }
    for (std::size_t k = 0; k < shown.size(); k++)
      for (const float x : view.values[k])
        data.push_back(!std::isfinite(x) || (shown[k].numbered && x < 0) ? std::byte(255)
                       : shown[k].numbered                               ? std::byte(std::int64_t(x) % 255)
                                                                         : std::byte(part(double(x), ranges[k], 255)));
    points["frames"].push_back({{"index", view.index}, {"time", view.time}, {"data", base64(data)}});
  }
  return points;
}

}  // namespace cleave::report
