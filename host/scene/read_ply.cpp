#include "common/error.hpp"
#include "scene/mesh_formats.hpp"
#include "scene/text_input.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>

namespace cleave::scene {
namespace {

enum class Scalar { int8, uint8, int16, uint16, int32, uint32, float32, float64 };
enum class Encoding { ascii, little_endian, big_endian };

struct Property {
  std::string name;
  Scalar type = Scalar::float32;
  std::optional<Scalar> length_type;  ///< of a list
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  Encoding encoding = Encoding::ascii;
  std::vector<Element> elements;
};

std::optional<Scalar> scalar_named(std::string_view name) {
  if (name == "char" || name == "int8") return Scalar::int8;
  if (name == "uchar" || name == "uint8") return Scalar::uint8;
  if (name == "short" || name == "int16") return Scalar::int16;
  if (name == "ushort" || name == "uint16") return Scalar::uint16;
  if (name == "int" || name == "int32") return Scalar::int32;
  if (name == "uint" || name == "uint32") return Scalar::uint32;
  if (name == "float" || name == "float32") return Scalar::float32;
  if (name == "double" || name == "float64") return Scalar::float64;
  return std::nullopt;
}

Scalar read_scalar_type(TextCursor& cursor) {
  const std::string_view name = cursor.word();
  const std::optional<Scalar> type = scalar_named(name);
  if (!type) cursor.fail("unknown property type '" + std::string(name.substr(0, 40)) + "'");
  return *type;
}

Encoding read_encoding(TextCursor& cursor) {
  const std::string_view name = cursor.word();
  if (name == "ascii") return Encoding::ascii;
  if (name == "binary_little_endian") return Encoding::little_endian;
  if (name == "binary_big_endian") return Encoding::big_endian;
  cursor.fail("unknown format '" + std::string(name.substr(0, 40)) +
              "'; expected ascii, binary_little_endian or binary_big_endian");
}

Header read_header(TextCursor& cursor) {
  Header header;
  bool has_format = false;
  if (cursor.word() != "ply") cursor.fail("a PLY file must start with 'ply'");
  for (cursor.next_line(); !cursor.at_end(); cursor.next_line()) {
    const std::string_view keyword = cursor.word();
    if (keyword.empty() || keyword == "comment" || keyword == "obj_info") continue;
    if (keyword == "end_header") {
      if (!has_format) cursor.fail("the header has no 'format' line");
      cursor.next_line();
      return header;
    }
    if (keyword == "format") {
      header.encoding = read_encoding(cursor);
      has_format = true;
    } else if (keyword == "element") {
      Element element;
      element.name = cursor.word();
      const double count = cursor.number("the number of elements");
      if (count < 0 || count != std::floor(count) || count > std::numeric_limits<int>::max()) {
        cursor.fail("the number of elements must be a whole number below 2^31");
      }
      element.count = static_cast<std::uint64_t>(count);
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      if (header.elements.empty()) cursor.fail("a property before any element");
      Property property;
      TextCursor ahead = cursor;
      if (ahead.word() == "list") {
        cursor.word();
        property.length_type = read_scalar_type(cursor);
      }
      property.type = read_scalar_type(cursor);
      property.name = cursor.word();
      if (property.name.empty()) cursor.fail("a property without a name");
      header.elements.back().properties.push_back(std::move(property));
    } else {
      cursor.fail("unknown header line '" + std::string(keyword.substr(0, 40)) + "'");
    }
  }
  cursor.fail("the header does not end; expected 'end_header'");
}

/// The values after the header, one at a time.
class Values {
 public:
  Values(const std::filesystem::path& file, std::string_view bytes, const TextCursor& after_header, Encoding encoding)
      : file_(file), bytes_(bytes), cursor_(after_header), position_(after_header.position()), encoding_(encoding) {}

  double next(Scalar type) {
    if (encoding_ == Encoding::ascii) return cursor_.number_anywhere("a value");
    switch (type) {
      case Scalar::int8:
        return binary<std::int8_t>();
      case Scalar::uint8:
        return binary<std::uint8_t>();
      case Scalar::int16:
        return binary<std::int16_t>();
      case Scalar::uint16:
        return binary<std::uint16_t>();
      case Scalar::int32:
        return binary<std::int32_t>();
      case Scalar::uint32:
        return binary<std::uint32_t>();
      case Scalar::float32:
        return binary<float>();
      case Scalar::float64:
        return binary<double>();
    }
    return 0;
  }
  /// Passes over a value that nobody needs, which may be NaN as the normals of some writers are.
  void skip(Scalar type) {
    if (encoding_ != Encoding::ascii) {
      next(type);
    } else if (cursor_.word_anywhere().empty()) {
      fail("the file ends too early");
    }
  }
  std::uint64_t next_length(Scalar type) {
    const double length = next(type);
    if (!(length >= 0) || length != std::floor(length)) fail("the length of a list must be a whole number");
    if (length > static_cast<double>(remaining())) fail("a list is longer than the rest of the file");
    return static_cast<std::uint64_t>(length);
  }
  /// Bytes left; no more values than this can follow.
  std::size_t remaining() const {
    return bytes_.size() - std::min(bytes_.size(), encoding_ == Encoding::ascii ? cursor_.position() : position_);
  }
  [[noreturn]] void fail(const std::string& problem) const {
    if (encoding_ == Encoding::ascii) cursor_.fail(problem);
    throw InputError(file_.string() + ": byte " + std::to_string(position_) + ": " + problem);
  }

 private:
  template <class T>
  double binary() {
    if (remaining() < sizeof(T)) fail("the file ends too early");
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), bytes_.data() + position_, sizeof(T));
    const std::endian order = encoding_ == Encoding::big_endian ? std::endian::big : std::endian::little;
    if (order != std::endian::native) std::reverse(raw.begin(), raw.end());
    position_ += sizeof(T);
    return static_cast<double>(std::bit_cast<T>(raw));
  }

  const std::filesystem::path& file_;
  std::string_view bytes_;
  TextCursor cursor_;
  std::size_t position_;
  Encoding encoding_;
};

void skip(Values& values, const Property& property) {
  const std::uint64_t count = property.length_type ? values.next_length(*property.length_type) : 1;
  for (std::uint64_t i = 0; i < count; ++i) values.skip(property.type);
}

void read_vertices(const Element& element, Values& values, PolygonMesh& mesh, const std::filesystem::path& file) {
  int coordinates = 0;
  for (const Property& property : element.properties) {
    coordinates += !property.length_type && (property.name == "x" || property.name == "y" || property.name == "z");
  }
  if (coordinates != 3) throw InputError(file.string() + ": the vertices must have the properties x, y and z, once each");
  mesh.vertices.reserve(std::min<std::size_t>(element.count, values.remaining()));
  for (std::uint64_t row = 0; row < element.count; ++row) {
    Vector3 vertex = Vector3::Zero();
    for (const Property& property : element.properties) {
      if (!property.length_type && property.name.size() == 1 && property.name[0] >= 'x' && property.name[0] <= 'z') {
        vertex[property.name[0] - 'x'] = values.next(property.type);
      } else {
        skip(values, property);
      }
    }
    if (!vertex.allFinite()) values.fail("a vertex coordinate is not finite");
    mesh.vertices.push_back(vertex);
  }
}

void read_faces(const Element& element, std::uint64_t vertex_count, Values& values, PolygonMesh& mesh,
                const std::filesystem::path& file) {
  const auto lists_corners = [](const Property& property) {
    return property.length_type && (property.name == "vertex_indices" || property.name == "vertex_index");
  };
  if (std::count_if(element.properties.begin(), element.properties.end(), lists_corners) != 1) {
    throw InputError(file.string() + ": the faces must have one list property vertex_indices");
  }
  for (std::uint64_t row = 0; row < element.count; ++row) {
    for (const Property& property : element.properties) {
      if (!lists_corners(property)) {
        skip(values, property);
        continue;
      }
      const std::uint64_t corners = values.next_length(*property.length_type);
      if (corners < 3) values.fail("a face needs at least three corners");
      for (std::uint64_t i = 0; i < corners; ++i) {
        const double index = values.next(property.type);
        if (!(index >= 0) || index != std::floor(index) || index >= static_cast<double>(vertex_count)) {
          values.fail("a face uses a vertex that does not exist; the file has " + std::to_string(vertex_count));
        }
        mesh.corners.push_back(static_cast<int>(index));
      }
      mesh.polygon_ends.push_back(mesh.corners.size());
    }
  }
}

}  // namespace

PolygonMesh parse_ply(const std::filesystem::path& file, std::string_view bytes) {
  TextCursor cursor(file, bytes);
  const Header header = read_header(cursor);
  std::uint64_t vertex_count = 0;
  int vertex_elements = 0;
  for (const Element& element : header.elements) {
    if (element.name != "vertex") continue;
    vertex_count = element.count;
    ++vertex_elements;
  }
  if (vertex_elements != 1) throw InputError(file.string() + ": the header must declare one element 'vertex'");

  PolygonMesh mesh;
  Values values(file, bytes, cursor, header.encoding);
  for (const Element& element : header.elements) {
    if (element.properties.empty()) continue;
    if (element.name == "vertex") {
      read_vertices(element, values, mesh, file);
    } else if (element.name == "face") {
      read_faces(element, vertex_count, values, mesh, file);
    } else {
      for (std::uint64_t row = 0; row < element.count; ++row) {
        for (const Property& property : element.properties) skip(values, property);
      }
    }
  }
  if (mesh.vertices.size() != vertex_count) {
    throw InputError(file.string() + ": the vertices must have the properties x, y and z, once each");
  }
  return mesh;
}

}  // namespace cleave::scene
