#include "output/ply.hpp"

#include "output/atomic_file.hpp"
#include "output/names.hpp"
#include "output/number.hpp"

#include <algorithm>
#include <bit>
#include <limits>

namespace cleave::output {
namespace {

static_assert(std::endian::native == std::endian::little,
              "frames are written in the machine's byte order, which must be little endian");

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  return text;
}

}  // namespace

void write_ply(const std::filesystem::path& path, const ParticleFrame& frame) {
  AtomicFile file(path);
  std::ostream& out = file.stream();

  // PLY has no 64-bit integers; a double holds the ids beyond an int exactly.
  const bool wide_ids = frame.particles() > std::size_t(std::numeric_limits<std::int32_t>::max());
  out << "ply\nformat binary_little_endian 1.0\ncomment time " << number(frame.time) << " s\ncomment frame " << frame.index
      << "\ncomment cell_size " << number(frame.cell_size) << " m\n";
  for (std::size_t b = 0; b < frame.bodies.size(); ++b) out << "comment body " << b << ' ' << one_line(frame.bodies[b]) << '\n';
  out << "element vertex " << frame.particles() << '\n';
  for (const char* name : {"x", "y", "z", "vx", "vy", "vz"}) out << "property float " << name << '\n';
  out << "property " << (wide_ids ? "double" : "int") << " id\nproperty int body\nproperty float pscale\n";
  if (!frame.colors.empty()) out << "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  const std::vector<std::string> names = attribute_names(frame);
  UniqueNames unique(std::set<std::string>(names.begin(), names.end()));
  for (std::size_t a = 0; a < names.size(); ++a) {
    if (frame.attributes[a].components == 1) {
      out << "property float " << names[a] << '\n';
      continue;
    }
    for (const std::string& suffix : component_suffixes(frame.attributes[a].components))
      out << "property float " << unique.add(names[a] + '_' + suffix) << '\n';
  }
  out << "end_header\n";

  std::vector<char> row;
  const auto put = [&row](const auto& value) {
    const auto* bytes = reinterpret_cast<const char*>(&value);
    row.insert(row.end(), bytes, bytes + sizeof value);
  };
  for (std::size_t i = 0; i < frame.particles(); ++i) {
    row.clear();
    const Eigen::Vector3f position = position_of(frame, i).cast<float>();
    for (const float x : position) put(x);
    for (const float v : frame.velocities[i]) put(v);
    if (wide_ids)
      put(static_cast<double>(i));
    else
      put(static_cast<std::int32_t>(i));
    put(frame.body_of(i));
    put(particle_radius(frame.volumes[i], frame.dimension));
    if (!frame.colors.empty()) put(frame.colors[i]);
    for (const Attribute& attribute : frame.attributes) {
      const auto width = static_cast<std::size_t>(attribute.components);
      for (std::size_t c = 0; c < width; ++c) put(attribute.values[i * width + c]);
    }
    out.write(row.data(), static_cast<std::streamsize>(row.size()));
  }
  file.commit();
}

}  // namespace cleave::output
