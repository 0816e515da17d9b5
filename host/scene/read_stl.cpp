#include "common/error.hpp"
#include "scene/mesh_formats.hpp"
#include "scene/text_input.hpp"

#include <algorithm>
#include <bit>
#include <cctype>
#include <cstdint>

namespace cleave::scene {
namespace {

std::string lower_case(std::string_view word) {
  std::string lower(word);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return lower;
}

std::uint32_t little_endian_word(std::string_view bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 4; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[offset + i]);
  return value;
}

std::vector<Vector3> ascii_corners(const std::filesystem::path& file, std::string_view bytes) {
  std::vector<Vector3> corners;
  TextCursor cursor(file, bytes);
  bool in_facet = false;
  int in_loop = -1;  // corners seen in the current loop; -1 outside
  for (; !cursor.at_end(); cursor.next_line()) {
    const std::string keyword = lower_case(cursor.word());
    if (keyword.empty() || keyword == "solid" || keyword == "endsolid") {
      if (!keyword.empty() && in_facet) cursor.fail("'" + keyword + "' inside a facet");
    } else if (keyword == "facet") {
      if (in_facet) cursor.fail("'facet' inside a facet");
      in_facet = true;
    } else if (keyword == "outer") {
      if (!in_facet || in_loop >= 0) cursor.fail("'outer loop' must follow 'facet'");
      in_loop = 0;
    } else if (keyword == "vertex") {
      if (in_loop < 0) cursor.fail("'vertex' outside a loop");
      if (++in_loop > 3) cursor.fail("a facet has more than three vertices");
      Vector3 corner;
      for (double& component : corner) component = cursor.number("a vertex coordinate");
      corners.push_back(corner);
    } else if (keyword == "endloop") {
      if (in_loop != 3) cursor.fail("a facet needs three vertices");
      in_loop = -1;
    } else if (keyword == "endfacet") {
      if (!in_facet || in_loop >= 0 || corners.size() % 3 != 0) cursor.fail("'endfacet' without a complete facet");
      in_facet = false;
    } else {
      cursor.fail("expected solid, facet, outer loop, vertex, endloop, endfacet or endsolid, found '" + keyword.substr(0, 40) +
                  "'");
    }
  }
  if (in_facet) cursor.fail("the file ends inside a facet");
  return corners;
}

std::vector<Vector3> binary_corners(const std::filesystem::path& file, std::string_view bytes) {
  constexpr std::size_t header_size = 84, facet_size = 50, normal_size = 12;
  const std::uint64_t facets = little_endian_word(bytes, header_size - 4);
  const std::uint64_t whole_facets = (bytes.size() - header_size) / facet_size;
  if (whole_facets < facets) {
    throw InputError(file.string() + ": byte " + std::to_string(bytes.size()) + ": the file ends in facet " +
                     std::to_string(whole_facets + 1) + " of " + std::to_string(facets));
  }
  std::vector<Vector3> corners(3 * facets);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const std::size_t offset = header_size + i / 3 * facet_size + normal_size + i % 3 * 12;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[i][static_cast<Eigen::Index>(k)] = std::bit_cast<float>(little_endian_word(bytes, offset + 4 * k));
    }
    if (!corners[i].allFinite()) {
      throw InputError(file.string() + ": byte " + std::to_string(offset) + ": a vertex coordinate is not finite");
    }
  }
  return corners;
}

}  // namespace

PolygonMesh parse_stl(const std::filesystem::path& file, std::string_view bytes) {
  // The headers of some binary files start with "solid" too, so that only the size tells for certain.
  const bool has_binary_header = bytes.size() >= 84;
  const bool binary_size = has_binary_header && bytes.size() == 84 + 50 * std::uint64_t{little_endian_word(bytes, 80)};
  const bool says_solid = lower_case(TextCursor(file, bytes.substr(0, 256)).word_anywhere()) == "solid";
  if (!has_binary_header && !says_solid) {
    throw InputError(file.string() + ": not an STL file: it neither starts with 'solid' nor has room for the binary header");
  }
  const bool binary = binary_size || !says_solid;
  const std::vector<Vector3> corners = binary ? binary_corners(file, bytes) : ascii_corners(file, bytes);

  PolygonMesh mesh;
  const std::vector<int> first = coincident_vertices(corners);
  std::vector<int> welded(corners.size());
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (first[i] == static_cast<int>(i)) {
      welded[i] = static_cast<int>(mesh.vertices.size());
      mesh.vertices.push_back(corners[i]);
    } else {
      welded[i] = welded[static_cast<std::size_t>(first[i])];
    }
  }
  mesh.corners = std::move(welded);
  for (std::size_t end = 3; end <= mesh.corners.size(); end += 3) mesh.polygon_ends.push_back(end);
  return mesh;
}

}  // namespace cleave::scene
