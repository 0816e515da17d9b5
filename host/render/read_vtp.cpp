#include "common/error.hpp"
#include "render/run_frames.hpp"

#include <charconv>
#include <cstring>
#include <fstream>
#include <sstream>

namespace cleave::render {
namespace {

/// One <DataArray> of a file of VTK's XML formats, with its numbers as inline base64 behind a 64-bit count of bytes.
struct Array {
  std::string name, type, format;
  int components = 1;
  std::string_view text;
};

std::string attribute_of(std::string_view tag, const std::string& key) {
  const std::size_t at = tag.find(" " + key + "=\"");
  if (at == std::string_view::npos) return "";
  const std::size_t begin = at + key.size() + 3, end = tag.find('"', begin);
  return end == std::string_view::npos ? "" : std::string(tag.substr(begin, end - begin));
}

std::vector<Array> arrays_of(std::string_view file) {
  std::vector<Array> arrays;
  for (std::size_t at = file.find("<DataArray "); at != std::string_view::npos; at = file.find("<DataArray ", at)) {
    const std::size_t tag_end = file.find('>', at), end = file.find("</DataArray>", at);
    if (tag_end == std::string_view::npos || end == std::string_view::npos || tag_end > end) break;
    const std::string_view tag = file.substr(at, tag_end - at);
    Array array{attribute_of(tag, "Name"), attribute_of(tag, "type"), attribute_of(tag, "format"), 1,
                file.substr(tag_end + 1, end - tag_end - 1)};
    const std::string components = attribute_of(tag, "NumberOfComponents");
    std::from_chars(components.data(), components.data() + components.size(), array.components);
    arrays.push_back(array);
    at = end;
  }
  return arrays;
}

std::vector<char> decoded(std::string_view text) {
  std::vector<char> bytes;
  bytes.reserve(text.size() / 4 * 3);
  unsigned bits = 0;
  int filled = 0;
  for (const char c : text) {
    const int digit = c >= 'A' && c <= 'Z'   ? c - 'A'
                      : c >= 'a' && c <= 'z' ? c - 'a' + 26
                      : c >= '0' && c <= '9' ? c - '0' + 52
                      : c == '+'             ? 62
                      : c == '/'             ? 63
                                             : -1;
    if (digit < 0) continue;
    bits = bits << 6 | unsigned(digit);
    filled += 6;
    if (filled < 8) continue;
    filled -= 8;
    bytes.push_back(char(bits >> filled & 255));
  }
  return bytes;
}

template <class T>
std::vector<double> converted(const std::vector<char>& bytes) {
  std::vector<double> values;
  for (std::size_t at = sizeof(std::uint64_t); at + sizeof(T) <= bytes.size(); at += sizeof(T)) {
    T value;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    values.push_back(double(value));
  }
  return values;
}

std::vector<double> numbers(const Array& array) {
  const std::vector<char> bytes = decoded(array.text);
  if (array.type == "Float32") return converted<float>(bytes);
  if (array.type == "Float64") return converted<double>(bytes);
  if (array.type == "Int32") return converted<std::int32_t>(bytes);
  if (array.type == "Int64") return converted<std::int64_t>(bytes);
  return converted<std::uint8_t>(bytes);
}

template <class T>
std::vector<T> as(const std::vector<double>& values) {
  return std::vector<T>(values.begin(), values.end());
}

template <class Vector>
std::vector<Vector> vectors(const std::vector<double>& values) {
  std::vector<Vector> result;
  using S = typename Vector::Scalar;
  for (std::size_t i = 0; i + 3 <= values.size(); i += 3) result.emplace_back(S(values[i]), S(values[i + 1]), S(values[i + 2]));
  return result;
}

}  // namespace

FileFrame read_vtp(const std::filesystem::path& path, const Wanted& wanted) {
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  const auto fail = [&](const std::string& why) { throw InputError("error: cannot read " + path.string() + ": " + why); };
  if (!in) fail("it cannot be opened");
  FileFrame frame;
  const auto first = [](const std::vector<double>& values) { return values.empty() ? 0 : values.front(); };
  bool polygons = false;
  for (const Array& array : arrays_of(text)) {
    polygons = polygons || (array.text.data() > text.data() + text.find("<Polys>"));
    if (array.name == "TimeValue") frame.time = first(numbers(array));
    if (array.name == "cell_size") frame.cell_size = first(numbers(array));
    if (array.name == "bodies") {
      std::istringstream codes{std::string(array.text)};
      std::string name;
      for (int code; codes >> code;) {
        if (code != 0) {
          name += char(code);
          continue;
        }
        frame.bodies.push_back(name);
        name.clear();
      }
    }
    if (array.name == "Points") frame.positions = vectors<Vector3>(numbers(array));
    if (array.name == "velocity") frame.velocities = vectors<Eigen::Vector3f>(numbers(array));
    if (array.name == "id") frame.id = as<std::int64_t>(numbers(array));
    if (array.name == "body") frame.body = as<std::int32_t>(numbers(array));
    if (array.name == "piece") frame.piece = as<std::int32_t>(numbers(array));
    if (array.name == "pscale") frame.radius = as<float>(numbers(array));
    if (array.name == "connectivity" && polygons) frame.triangles = as<std::uint32_t>(numbers(array));
    static const std::set<std::string> own = {"TimeValue", "frame", "cell_size", "bodies", "Points",       "velocity",
                                              "id",        "body",  "pscale",    "Color",  "connectivity", "offsets"};
    if (own.contains(array.name)) continue;
    frame.names.insert(array.name);
    if (!wanted(array.name)) continue;
    output::Attribute attribute{array.name, array.components, "", as<float>(numbers(array))};
    if (array.components == 6)  // VTK's order ends with yz xz
      for (std::size_t i = 0; i + 6 <= attribute.values.size(); i += 6)
        std::swap(attribute.values[i + 4], attribute.values[i + 5]);
    frame.attributes.push_back(std::move(attribute));
  }
  const std::size_t count = frame.positions.size();
  bool whole = text.find("</VTKFile>") != std::string::npos && frame.body.size() == count;
  for (const output::Attribute& a : frame.attributes)
    whole = whole && a.components > 0 && a.values.size() == count * std::size_t(a.components);
  for (const std::uint32_t corner : frame.triangles) whole = whole && corner < count;
  if (!whole) fail("it is not a frame that cleave run has written, or it is damaged");
  return frame;
}

}  // namespace cleave::render
