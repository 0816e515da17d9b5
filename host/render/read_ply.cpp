#include "common/error.hpp"
#include "output/names.hpp"
#include "render/run_frames.hpp"

#include <charconv>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>

namespace cleave::render {
namespace {

struct Property {
  std::string name, type;
  std::size_t offset = 0;
};

std::size_t size_of(const std::string& type) {
  static const std::map<std::string, std::size_t> sizes = {{"uchar", 1}, {"int", 4}, {"float", 4}, {"double", 8}};
  const auto found = sizes.find(type);
  return found == sizes.end() ? 0 : found->second;
}

double number_at(const char* row, const Property& p) {
  const auto as = [&](auto value) {
    std::memcpy(&value, row + p.offset, sizeof value);
    return double(value);
  };
  return p.type == "float"    ? as(float())
         : p.type == "double" ? as(double())
         : p.type == "int"    ? as(std::int32_t())
                              : as(std::uint8_t());
}

/// Names of the properties that are not the format's own, as attributes: x y z and xx ... belong together.
std::map<std::string, std::vector<std::string>> grouped(const std::vector<Property>& properties) {
  static const std::set<std::string> own = {"x", "y", "z", "vx", "vy", "vz", "id", "body", "pscale", "red", "green", "blue"};
  std::set<std::string> names;
  for (const Property& p : properties)
    if (!own.contains(p.name)) names.insert(p.name);
  std::map<std::string, std::vector<std::string>> groups;
  for (const int components : {9, 6, 3})
    for (const std::string& name : std::set<std::string>(names)) {
      const auto suffixes = output::component_suffixes(components);
      if (!name.ends_with("_" + suffixes[0])) continue;
      const std::string stem = name.substr(0, name.size() - suffixes[0].size() - 1);
      std::vector<std::string> members;
      for (const std::string& suffix : suffixes)
        if (names.contains(stem + "_" + suffix)) members.push_back(stem + "_" + suffix);
      if (members.size() != suffixes.size()) continue;
      for (const std::string& member : members) names.erase(member);
      groups[stem] = members;
    }
  for (const std::string& name : names) groups[name] = {name};
  return groups;
}

}  // namespace

FileFrame read_ply(const std::filesystem::path& path, const Wanted& wanted) {
  std::ifstream in(path, std::ios::binary);
  const auto fail = [&](const std::string& why) { throw InputError("error: cannot read " + path.string() + ": " + why); };
  if (!in) fail("it cannot be opened");
  FileFrame frame;
  std::vector<Property> properties;
  std::size_t vertices = 0, faces = 0, width = 0;
  std::string line, element;
  while (std::getline(in, line) && line != "end_header") {
    std::istringstream words(line);
    std::string word, type, name;
    words >> word;
    if (word == "format" && words >> word && word != "binary_little_endian")
      fail("it is not a frame that cleave run has written");
    if (word == "comment") {
      words >> word;
      if (word == "time") words >> frame.time;
      if (word == "cell_size") words >> frame.cell_size;
      std::size_t number = 0;
      if (word == "body" && words >> number && number < 1000000) {
        if (frame.bodies.size() <= number) frame.bodies.resize(number + 1);
        std::getline(words >> std::ws, frame.bodies[number]);
      }
    } else if (word == "element") {
      words >> element;
      words >> (element == "vertex" ? vertices : faces);
    } else if (word == "property" && element == "vertex") {
      words >> type >> name;
      if (size_of(type) == 0) fail("it is not a frame that cleave run has written");
      properties.push_back({name, type, width});
      width += size_of(type);
    }
  }
  if (!in || width == 0) fail("it is not a frame that cleave run has written");
  const auto property = [&](const std::string& name) {
    const auto found = std::find_if(properties.begin(), properties.end(), [&](const Property& p) { return p.name == name; });
    return found == properties.end() ? nullptr : &*found;
  };
  const auto groups = grouped(properties);
  for (const auto& [name, members] : groups) frame.names.insert(name);
  const std::streamoff here = in.tellg();
  in.seekg(0, std::ios::end);
  if (vertices > std::size_t(in.tellg() - here) / width) fail("it ends early");
  in.seekg(here);
  std::vector<char> rows(vertices * width);
  in.read(rows.data(), std::streamsize(rows.size()));

  const auto column = [&](const std::string& name, auto& values, auto convert) {
    if (const Property* p = property(name))
      for (std::size_t i = 0; i < vertices; i++) values.push_back(convert(number_at(rows.data() + i * width, *p)));
  };
  const auto vectors = [&](const char* x, const char* y, const char* z, auto& values) {
    if (!property(x) || !property(y) || !property(z)) return;
    for (std::size_t i = 0; i < vertices; i++) {
      const char* const row = rows.data() + i * width;
      using Vector = typename std::decay_t<decltype(values)>::value_type;
      using S = typename Vector::Scalar;
      values.push_back(
          Vector(S(number_at(row, *property(x))), S(number_at(row, *property(y))), S(number_at(row, *property(z)))));
    }
  };
  vectors("x", "y", "z", frame.positions);
  vectors("vx", "vy", "vz", frame.velocities);
  column("id", frame.id, [](double v) { return std::int64_t(v); });
  column("body", frame.body, [](double v) { return std::int32_t(v); });
  column("piece", frame.piece, [](double v) { return std::int32_t(v); });
  column("pscale", frame.radius, [](double v) { return float(v); });
  if (frame.positions.size() != vertices || frame.body.size() != vertices)
    fail("it is not a frame that cleave run has written");
  for (const auto& [name, members] : groups) {
    if (!wanted(name)) continue;
    output::Attribute attribute{name, int(members.size()), "", {}};
    attribute.values.resize(vertices * members.size());
    for (std::size_t c = 0; c < members.size(); c++)
      for (std::size_t i = 0; i < vertices; i++)
        attribute.values[i * members.size() + c] = float(number_at(rows.data() + i * width, *property(members[c])));
    frame.attributes.push_back(std::move(attribute));
  }
  for (std::size_t f = 0; f < faces; f++) {
    char face[13];
    if (!in.read(face, sizeof face) || face[0] != 3) fail("it ends early, or has faces that are no triangles");
    std::uint32_t corners[3];
    std::memcpy(corners, face + 1, sizeof corners);
    for (const std::uint32_t corner : corners)
      if (corner >= vertices) fail("a triangle has a vertex that there is not");
    frame.triangles.insert(frame.triangles.end(), corners, corners + 3);
  }
  if (!in) fail("it ends early");
  return frame;
}

}  // namespace cleave::render
