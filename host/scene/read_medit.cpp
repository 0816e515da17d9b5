#include "scene/tetrahedra_formats.hpp"

#include <spdlog/fmt/fmt.h>

#include <cctype>
#include <limits>

namespace cleave::scene {
namespace {

constexpr std::int64_t most = std::numeric_limits<std::uint32_t>::max() - 1;

bool is_keyword(std::string_view word) { return std::isalpha(static_cast<unsigned char>(word.front())) != 0; }

}  // namespace

TetrahedraFile parse_medit(const std::filesystem::path& file, std::string_view bytes) {
  CommentedText text(file, bytes);
  if (text.word_anywhere() != "MeshVersionFormatted") text.fail("a Medit file must begin with 'MeshVersionFormatted'");
  text.integer_anywhere("the version of the format", 1, 4);
  TetrahedraFile result;
  result.first_number = 1;
  bool has_vertices = false, has_tetrahedra = false, has_dimension = false;
  std::int64_t vertices = 0;
  std::string_view keyword = text.word_anywhere();
  while (!keyword.empty() && keyword != "End") {
    if (keyword == "Dimension") {
      text.integer_anywhere("the dimension", 3, 3);
      has_dimension = true;
      keyword = text.word_anywhere();
    } else if (keyword == "Vertices") {
      if (has_vertices) text.fail("there is a second section 'Vertices'");
      if (!has_dimension) text.fail("'Dimension 3' must come before 'Vertices'");
      has_vertices = true;
      vertices = text.integer_anywhere("the number of vertices", 1, most);
      for (std::int64_t i = 0; i < vertices; i++) {
        Vector3 x;
        for (double& component : x) component = text.number_anywhere("a vertex coordinate");
        text.number_anywhere("the reference of a vertex");
        result.mesh.vertices.push_back(x);
      }
      keyword = text.word_anywhere();
    } else if (keyword == "Tetrahedra") {
      if (!has_vertices) text.fail("'Vertices' must come before 'Tetrahedra'");
      has_tetrahedra = true;
      const auto count = text.integer_anywhere("the number of tetrahedra", 0, most);
      for (std::int64_t i = 0; i < count; i++) {
        auto& corners = result.mesh.tetrahedra.emplace_back();
        for (auto& corner : corners)
          corner = std::uint32_t(text.integer_anywhere("a vertex of a tetrahedron", 1, vertices) - 1);
        text.number_anywhere("the reference of a tetrahedron");
      }
      keyword = text.word_anywhere();
    } else {
      if (!is_keyword(keyword)) text.fail(fmt::format("expected the name of a section, found '{}'", keyword.substr(0, 40)));
      do keyword = text.word_anywhere();
      while (!keyword.empty() && !is_keyword(keyword));
    }
  }
  for (const auto& [has, section] : {std::pair{has_vertices, "Vertices"}, std::pair{has_tetrahedra, "Tetrahedra"}})
    if (!has) text.fail(fmt::format("the file has no section '{}'", section));
  return result;
}

}  // namespace cleave::scene
