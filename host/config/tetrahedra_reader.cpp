#include "config/tetrahedra_reader.hpp"

#include "config/geometry_reader.hpp"
#include "scene/tetrahedra_io.hpp"

namespace cleave::config {

using scene::TetrahedraSpec;

std::optional<TetrahedraSpec> read_tetrahedra(TableReader table) {
  TetrahedraSpec tetrahedra;
  bool usable = true;
  if (table.has("file")) {
    for (const char* key : {"edge_length", "method"})
      table.refuse(key, "is only used to cut a shape into tetrahedra; those of a file are taken as they are");
    scene::ShapeSpec& file = tetrahedra.file.emplace();
    file.type = scene::ShapeSpec::Type::mesh;
    const auto path = table.file("file", scene::tetrahedra_extensions);
    usable = path.has_value();
    if (path) file.file = *path;
    read_place_of_file(table, file);
  } else {
    tetrahedra.edge_length = table.number("edge_length", "m", Range::positive()).value_or(table.context().cell_size);
    if (tetrahedra.edge_length == 0) {
      table.require("edge_length", "a number (m), or simulation.cell_size");
      tetrahedra.edge_length = 1;  // for what else is to be read
    }
    if (const auto method = table.choice("method", method_names())) tetrahedra.method = TetrahedraSpec::Method(*method);
    for (const char* key : {"file_size", "centered", "center", "scale", "rotate", "translate"})
      table.refuse(key, "is only used with 'file'; the place of a shape is given with the shape");
  }
  table.finish();
  return usable ? std::optional(tetrahedra) : std::nullopt;
}

const std::vector<std::string>& method_names() {
  static const std::vector<std::string> names = {"lattice", "tetgen"};
  return names;
}

}  // namespace cleave::config
