#include "output/vtp.hpp"

#include "output/atomic_file.hpp"
#include "output/names.hpp"
#include "output/number.hpp"

#include <array>
#include <bit>
#include <cstring>
#include <span>
#include <type_traits>

namespace cleave::output {
namespace {

static_assert(std::endian::native == std::endian::little,
              "frames are written in the machine's byte order, which must be little endian");

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return result;
}

class Base64 {
 public:
  explicit Base64(std::ostream& out) : out_(out) {}

  void write(std::span<const std::byte> bytes) {
    for (const std::byte byte : bytes) {
      triple_[filled_++] = std::to_integer<unsigned>(byte);
      if (filled_ == 3) encode();
    }
  }

  void finish() {
    if (filled_ > 0) {
      const std::size_t padding = 3 - filled_;
      for (std::size_t i = filled_; i < 3; ++i) triple_[i] = 0;
      encode();
      std::fill_n(text_.begin() + static_cast<std::ptrdiff_t>(used_ - padding), padding, '=');
    }
    flush();
  }

 private:
  void encode() {
    static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const unsigned bits = triple_[0] << 16 | triple_[1] << 8 | triple_[2];
    if (used_ == text_.size()) flush();
    for (const int shift : {18, 12, 6, 0}) text_[used_++] = digits[bits >> shift & 63];
    filled_ = 0;
  }

  void flush() {
    out_.write(text_.data(), static_cast<std::streamsize>(used_));
    used_ = 0;
  }

  std::ostream& out_;
  std::array<unsigned, 3> triple_{};
  std::array<char, 4 * 4096> text_{};
  std::size_t filled_ = 0, used_ = 0;
};

template <class T>
constexpr const char* type_name() {
  if constexpr (std::is_same_v<T, float>) return "Float32";
  if constexpr (std::is_same_v<T, double>) return "Float64";
  if constexpr (std::is_same_v<T, std::int32_t>) return "Int32";
  if constexpr (std::is_same_v<T, std::int64_t>) return "Int64";
}

/// `tuple(i, values)` fills the components of tuple i.
template <class T, class Tuple>
void write_array(std::ostream& out, const std::string& name, const std::vector<std::string>& components, std::size_t tuples,
                 const Tuple& tuple, const std::string& extra = "") {
  const std::size_t width = components.size();
  out << "<DataArray type=\"" << type_name<T>() << "\" Name=\"" << escaped(name) << "\"";
  if (width > 1) out << " NumberOfComponents=\"" << width << "\"";
  for (std::size_t c = 0; width > 1 && c < width; ++c) out << " ComponentName" << c << "=\"" << components[c] << "\"";
  out << extra << " format=\"binary\">\n";
  Base64 base64(out);
  const std::uint64_t bytes = tuples * width * sizeof(T);
  base64.write(std::as_bytes(std::span(&bytes, 1)));
  std::vector<T> values(width);
  for (std::size_t i = 0; i < tuples; ++i) {
    tuple(i, values.data());
    base64.write(std::as_bytes(std::span<const T>(values)));
  }
  base64.finish();
  out << "\n</DataArray>\n";
}

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

/// VTK's strings are arrays of character codes, each string ended by a zero.
void write_body_names(std::ostream& out, const std::vector<std::string>& bodies) {
  out << "<DataArray type=\"String\" Name=\"bodies\" NumberOfTuples=\"" << bodies.size() << "\" format=\"ascii\">\n";
  for (const std::string& body : bodies) {
    for (const char c : body) out << static_cast<int>(static_cast<unsigned char>(c)) << ' ';
    out << "0\n";
  }
  out << "</DataArray>\n";
}

}  // namespace

void write_vtp(const std::filesystem::path& path, const ParticleFrame& frame) {
  AtomicFile file(path);
  std::ostream& out = file.stream();
  const std::size_t particles = frame.particles();
  const std::vector<std::string> scalar{""}, vector = component_suffixes(3);
  const std::string one_tuple = " NumberOfTuples=\"1\"";

  out << "<?xml version=\"1.0\"?>\n"
         "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
         "<PolyData>\n<FieldData>\n";
  write_array<double>(
      out, "TimeValue", scalar, 1, [&](std::size_t, double* value) { *value = frame.time; }, one_tuple);
  write_array<std::int32_t>(
      out, "frame", scalar, 1, [&](std::size_t, std::int32_t* value) { *value = frame.index; }, one_tuple);
  write_array<double>(
      out, "cell_size", scalar, 1, [&](std::size_t, double* value) { *value = frame.cell_size; }, one_tuple);
  write_body_names(out, frame.bodies);
  out << "</FieldData>\n<Piece NumberOfPoints=\"" << particles << "\" NumberOfVerts=\"" << particles
      << "\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n<PointData>\n";
  write_array<std::int64_t>(out, "id", scalar, particles,
                            [](std::size_t i, std::int64_t* value) { *value = static_cast<std::int64_t>(i); });
  write_array<std::int32_t>(out, "body", scalar, particles,
                            [&](std::size_t i, std::int32_t* value) { *value = frame.body_of(i); });
  write_array<float>(out, "velocity", vector, particles,
                     [&](std::size_t i, float* values) { std::memcpy(values, frame.velocities[i].data(), 3 * sizeof(float)); });
  write_array<float>(out, "pscale", scalar, particles,
                     [&](std::size_t i, float* value) { *value = particle_radius(frame.volumes[i], frame.dimension); });
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
  out << "</Verts>\n</Piece>\n</PolyData>\n</VTKFile>\n";
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
