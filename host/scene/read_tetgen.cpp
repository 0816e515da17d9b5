#include "scene/tetrahedra_formats.hpp"

#include <spdlog/fmt/fmt.h>

#include <limits>

namespace cleave::scene {
namespace {

constexpr std::int64_t most = std::numeric_limits<std::uint32_t>::max() - 1;

/// Goes to the first line with words.
void begin(CommentedText& text, const char* expected) {
  CommentedText ahead = text;
  if (ahead.word().empty() && !text.next_row()) text.fail(fmt::format("the file is empty; it must begin with {}", expected));
}

struct Name {
  const char *one, *many;
};

/// The number that row `row` of `count` begins with: rows are numbered in order from that of the first, 0 or 1.
void read_number(CommentedText& text, std::int64_t row, std::int64_t count, std::int64_t& first, const Name& what) {
  if (!text.next_row())
    text.fail(fmt::format("the file ends after {} of the {} {} that its first line counts", row, count, what.many));
  if (row == 0) {
    first = text.integer(fmt::format("the number of the first {}", what.one).c_str(), 0, 1);
  } else if (const auto number = text.integer("a number", 0, most + 1); number != first + row) {
    text.fail(fmt::format("{} must be numbered in order, this is {} and should be {}", what.many, number, first + row));
  }
}

}  // namespace

TetrahedraFile parse_tetgen(const std::filesystem::path& node_file, std::string_view nodes,
                            const std::filesystem::path& ele_file, std::string_view elements) {
  TetrahedraFile result;
  CommentedText node(node_file, nodes);
  begin(node, "the number of vertices");
  const auto vertices = node.integer("the number of vertices", 1, most);
  node.integer("the dimension", 3, 3);
  std::int64_t first_vertex = 0;
  for (std::int64_t i = 0; i < vertices; i++) {
    read_number(node, i, vertices, first_vertex, {"vertex", "vertices"});
    Vector3 x;
    for (double& component : x) component = node.number("a vertex coordinate");
    result.mesh.vertices.push_back(x);
  }
  CommentedText element(ele_file, elements);
  begin(element, "the number of tetrahedra");
  const auto count = element.integer("the number of tetrahedra", 1, most);
  if (const auto corners = element.integer("the number of nodes per tetrahedron", 1, 1000); corners != 4)
    element.fail(fmt::format("tetrahedra of {} nodes are not read; write linear ones, of 4 nodes", corners));
  for (std::int64_t i = 0; i < count; i++) {
    read_number(element, i, count, result.first_number, {"tetrahedron", "tetrahedra"});
    auto& corners = result.mesh.tetrahedra.emplace_back();
    for (auto& corner : corners)
      corner = std::uint32_t(element.integer("a vertex of the tetrahedron", first_vertex, first_vertex + vertices - 1) -
                             first_vertex);
  }
  return result;
}

}  // namespace cleave::scene
