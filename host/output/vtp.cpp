#include "output/vtp.hpp"

#include "output/atomic_file.hpp"
#include "output/number.hpp"
#include "output/vtk_xml.hpp"

#include <cstring>

namespace cleave::output {

using namespace vtk;

namespace {

void write_attribute(std::ostream& out, const std::string& name, const Attribute& attribute, std::size_t particles) {
  const auto width = static_cast<std::size_t>(attribute.components);
  std::vector<std::string> components = component_suffixes(attribute.components);
  std::vector<std::size_t> order(width);
  for (std::size_t c = 0; c < width; ++c) order[c] = c;
  if (width == 6) std::swap(order[4], order[5]);
  std::vector<std::string> ordered;
  for (const std::size_t c : order) ordered.push_back(components[c]);
  write_array<float>(out, name, ordered, particles, [&](std::size_t i, float* values) {
    for (std::size_t c = 0; c < width; ++c) values[c] = attribute.values[i * width + order[c]];
  });
}

}  // namespace

void write_vtp(const std::filesystem::path& path, const ParticleFrame& frame) {
  AtomicFile file(path);
  std::ostream& out = file.stream();
  const std::size_t particles = frame.particles();
  const std::vector<std::string> scalar{""}, vector = component_suffixes(3);
  write_start(out, "PolyData", frame);
  out << "<Piece NumberOfPoints=\"" << particles << "\" NumberOfVerts=\"" << particles
      << "\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n<PointData>\n";
  write_array<std::int64_t>(out, "id", scalar, particles,
                            [](std::size_t i, std::int64_t* value) { *value = static_cast<std::int64_t>(i); });
  write_array<std::int32_t>(out, "body", scalar, particles,
                            [&](std::size_t i, std::int32_t* value) { *value = frame.body_of(i); });
  write_array<float>(out, "velocity", vector, particles,
                     [&](std::size_t i, float* values) { std::memcpy(values, frame.velocities[i].data(), 3 * sizeof(float)); });
  write_array<float>(out, "pscale", scalar, particles,
                     [&](std::size_t i, float* value) { *value = particle_radius(frame.volumes[i], frame.dimension); });
  if (!frame.colors.empty())
    write_array<std::uint8_t>(out, "Color", {"red", "green", "blue"}, particles,
                              [&](std::size_t i, std::uint8_t* values) { std::memcpy(values, frame.colors[i].data(), 3); });
  const std::vector<std::string> names = attribute_names(frame);
  for (std::size_t a = 0; a < names.size(); ++a) write_attribute(out, names[a], frame.attributes[a], particles);
  out << "</PointData>\n<Points>\n";
  write_array<double>(out, "Points", vector, particles, [&](std::size_t i, double* values) {
    const Vector3 position = position_of(frame, i);
    std::memcpy(values, position.data(), 3 * sizeof(double));
  });
  out << "</Points>\n<Verts>\n";
  write_array<std::int64_t>(out, "connectivity", scalar, particles,
                            [](std::size_t i, std::int64_t* value) { *value = static_cast<std::int64_t>(i); });
  write_array<std::int64_t>(out, "offsets", scalar, particles,
                            [](std::size_t i, std::int64_t* value) { *value = static_cast<std::int64_t>(i) + 1; });
  out << "</Verts>\n";
  write_end(out, "PolyData");
  file.commit();
}

void write_pvd(const std::filesystem::path& path, const std::map<int, SeriesEntry>& series) {
  AtomicFile file(path);
  std::ostream& out = file.stream();
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>\n";
  for (const auto& [index, entry] : series)
    out << "<DataSet timestep=\"" << number(entry.time) << "\" group=\"\" part=\"0\" file=\"" << escaped(entry.file)
        << "\"/>\n";
  out << "</Collection>\n</VTKFile>\n";
  file.commit();
}

}  // namespace cleave::output
