#include "output/usd.hpp"

#include "output/atomic_file.hpp"
#include "output/color.hpp"
#include "output/names.hpp"
#include "output/number.hpp"

#include <Eigen/Geometry>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <ostream>
#include <span>

namespace cleave::output {
namespace {

/// Time codes are numbers of frames, which need not be whole at the end of a run.
std::string time_code(int index, double time, const Playback& playback) {
  const double code = time * playback.frame_rate;
  return number(std::abs(code - index) <= 1e-6 * std::max(1, index) ? double(index) : code);
}

void write_header(std::ostream& out, const Playback& playback, const std::string& first, const std::string& last) {
  out << "#usda 1.0\n(\n    defaultPrim = \"cleave\"\n    doc = \"Written by Cleave\"\n    endTimeCode = " << last
      << "\n    metersPerUnit = 1\n    startTimeCode = " << first
      << "\n    timeCodesPerSecond = " << number(playback.frame_rate) << "\n    upAxis = \""
      << (playback.up_axis == 2 ? 'Z' : 'Y') << "\"\n)\n\n";
}

/// Attributes of one prim, each as its declaration and one time sample.
class Prim {
 public:
  Prim(std::ostream& out, const char* type, const std::string& name, std::string code) : out_(out), code_(std::move(code)) {
    out_ << "    def " << type << " \"" << name << "\"\n    {\n";
  }
  ~Prim() { out_ << "    }\n\n"; }
  Prim(const Prim&) = delete;
  Prim& operator=(const Prim&) = delete;

  void uniform(const std::string& declaration) { out_ << "        uniform " << declaration << "\n"; }

  /// An array of `count` tuples; value(i, values) fills the numbers of one.
  template <std::size_t Width, class T, class Value>
  void array(const std::string& type, const std::string& name, const char* metadata, std::size_t count, const Value& value) {
    if (*metadata) out_ << "        " << type << ' ' << name << " (\n            " << metadata << "\n        )\n";
    out_ << "        " << type << ' ' << name << ".timeSamples = {\n            " << code_ << ": [";
    std::array<T, Width> values;
    for (std::size_t i = 0; i < count; i++) {
      value(i, values.data());
      if (i > 0) put(", ");
      if (Width > 1) put("(");
      for (std::size_t c = 0; c < Width; c++) {
        if (c > 0) put(", ");
        put(values[c]);
      }
      if (Width > 1) put(")");
    }
    flush();
    out_ << "],\n        }\n";
  }

 private:
  template <class T>
  void put(T value) {
    if (used_ + 32 > text_.size()) flush();
    if constexpr (std::is_floating_point_v<T>)
      if (std::isnan(value)) return put("nan");  // whatever its sign
    used_ = std::size_t(std::to_chars(text_.data() + used_, text_.data() + text_.size(), value).ptr - text_.data());
  }
  void put(const char* text) {
    if (used_ + 32 > text_.size()) flush();
    while (*text) text_[used_++] = *text++;
  }
  void flush() {
    out_.write(text_.data(), std::streamsize(used_));
    used_ = 0;
  }

  std::ostream& out_;
  std::string code_;
  std::array<char, 1 << 14> text_;
  std::size_t used_ = 0;
};

constexpr const char* per_vertex = "interpolation = \"vertex\"";

template <class Point>
void write_extent(Prim& prim, std::size_t count, const Point& point) {
  Eigen::AlignedBox3f box;
  for (std::size_t i = 0; i < count; i++) {
    Eigen::Vector3f x;
    point(i, x.data());
    if (x.allFinite()) box.extend(x);
  }
  if (box.isEmpty()) box.extend(Eigen::Vector3f::Zero());
  prim.array<3, float>("float3[]", "extent", "", 2, [&](std::size_t i, float* values) {
    Eigen::Map<Eigen::Vector3f>{values} = i == 0 ? box.min() : box.max();
  });
}

/// One colour for all, or one each.
void write_colors(Prim& prim, std::span<const Color> colors, std::int32_t body) {
  const Color own = color_of_number(body);
  const bool each = !colors.empty();
  prim.array<3, float>("color3f[]", "primvars:displayColor", each ? per_vertex : "interpolation = \"constant\"",
                       each ? colors.size() : 1, [&](std::size_t i, float* values) {
                         const Color& color = each ? colors[i] : own;
                         for (std::size_t c = 0; c < 3; c++) {  // from sRGB to the linear values USD is in
                           const double s = color[c] / 255.0;
                           values[c] = float(s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4));
                         }
                       });
}

void write_points(std::ostream& out, const std::string& prim_name, const ParticleFrame& frame, std::size_t body,
                  const std::vector<std::string>& names, const std::string& code) {
  const std::size_t begin = frame.body_begin(body), count = frame.body_ends[body] - begin;
  Prim prim(out, "Points", prim_name, code);
  const auto position = [&](std::size_t i, float* values) {
    Eigen::Map<Eigen::Vector3f>{values} = position_of(frame, begin + i).cast<float>();
  };
  write_extent(prim, count, position);
  prim.array<1, std::int64_t>("int64[]", "ids", "", count,
                              [&](std::size_t i, std::int64_t* value) { *value = std::int64_t(begin + i); });
  prim.array<3, float>("point3f[]", "points", "", count, position);
  prim.array<3, float>("vector3f[]", "velocities", "", count, [&](std::size_t i, float* values) {
    Eigen::Map<Eigen::Vector3f>{values} = frame.velocities[begin + i];
  });
  prim.array<1, float>("float[]", "widths", per_vertex, count, [&](std::size_t i, float* value) {
    *value = 2 * particle_radius(frame.volumes[begin + i], frame.dimension);
  });
  const std::span<const Color> colors(frame.colors);
  write_colors(prim, colors.empty() ? colors : colors.subspan(begin, count), std::int32_t(body));
  for (std::size_t a = 0; a < names.size(); a++) {
    const auto width = std::size_t(frame.attributes[a].components);
    const float* values = frame.attributes[a].values.data() + width * begin;
    const std::string name = "primvars:" + names[a];
    if (width == 3)
      prim.array<3, float>("float3[]", name, per_vertex, count,
                           [&](std::size_t i, float* to) { std::copy_n(values + 3 * i, 3, to); });
    else
      prim.array<1, float>(
          "float[]", name,
          width == 1 ? per_vertex : ("elementSize = " + std::to_string(width) + "\n            " + per_vertex).c_str(),
          width * count, [&](std::size_t i, float* to) { *to = values[i]; });
  }
}

void write_mesh(std::ostream& out, const std::string& prim_name, const BodyMesh& mesh, const std::string& code) {
  const std::size_t vertices = mesh.vertex_count(), triangles = mesh.triangles.size() / 3;
  Prim prim(out, "Mesh", prim_name, code);
  prim.uniform("token subdivisionScheme = \"none\"");
  const auto position = [&](std::size_t i, float* values) {
    for (std::size_t c = 0; c < 3; c++) values[c] = float(mesh.vertices[3 * i + c]);
  };
  write_extent(prim, vertices, position);
  prim.array<1, int>("int[]", "faceVertexCounts", "", triangles, [](std::size_t, int* value) { *value = 3; });
  prim.array<1, std::uint32_t>("int[]", "faceVertexIndices", "", 3 * triangles,
                               [&](std::size_t i, std::uint32_t* value) { *value = mesh.triangles[i]; });
  prim.array<3, float>("point3f[]", "points", "", vertices, position);
  if (!mesh.velocity.empty())
    prim.array<3, float>("vector3f[]", "velocities", "", vertices,
                         [&](std::size_t i, float* values) { std::copy_n(mesh.velocity.data() + 3 * i, 3, values); });
  write_colors(prim, mesh.colors, mesh.body);
  prim.array<1, std::int32_t>("int[]", "primvars:piece", per_vertex, vertices,
                              [&](std::size_t i, std::int32_t* value) { *value = mesh.piece[i]; });
  if (!mesh.damage.empty())
    prim.array<1, float>("float[]", "primvars:damage", per_vertex, vertices,
                         [&](std::size_t i, float* value) { *value = mesh.damage[i]; });
}

}  // namespace

void write_usd(const std::filesystem::path& path, const ParticleFrame& frame) {
  AtomicFile file(path);
  std::ostream& out = file.stream();
  const std::string code = time_code(frame.index, frame.time, frame.playback);
  write_header(out, frame.playback, code, code);
  out << "def Xform \"cleave\"\n{\n";
  UniqueNames unique;
  const std::vector<std::string> names = attribute_names(frame);
  std::vector<std::string> prims;
  for (std::size_t b = 0; b < frame.bodies.size(); b++) prims.push_back(unique.add(frame.bodies[b]));
  for (std::size_t b = 0; b < frame.bodies.size(); b++) write_points(out, prims[b], frame, b, names, code);
  for (const BodyMesh& mesh : frame.meshes) write_mesh(out, unique.add(prims[std::size_t(mesh.body)] + "_surface"), mesh, code);
  out << "}\n";
  file.commit();
}

void write_usd_series(const std::filesystem::path& path, const std::map<int, SeriesEntry>& series, const Playback& playback) {
  if (series.empty()) return;
  AtomicFile file(path);
  std::ostream& out = file.stream();
  std::string active, assets, times;
  std::vector<std::string> codes;
  for (const auto& [index, entry] : series) {
    const std::string code = time_code(index, entry.time, playback), comma = codes.empty() ? "" : ", ";
    active += comma + "(" + code + ", " + std::to_string(codes.size()) + ")";
    assets += comma + "@./" + entry.file + "@";
    times += comma + "(" + code + ", " + code + ")";
    codes.push_back(code);
  }
  const std::string first = "@./" + series.begin()->second.file + "@";
  write_header(out, playback, codes.front(), codes.back());
  out << "def Xform \"cleave\" (\n    prepend references = " << first
      << "</cleave>\n    clips = {\n        dictionary default = {\n"
      << "            double2[] active = [" << active << "]\n            asset[] assetPaths = [" << assets
      << "]\n            asset manifestAssetPath = " << first
      << "\n            string primPath = \"/cleave\"\n            double2[] times = [" << times
      << "]\n        }\n    }\n)\n{\n}\n";
  file.commit();
}

}  // namespace cleave::output
