#include "fuzzing.hpp"
#include "scene/mesh_closing.hpp"
#include "scene/mesh_formats.hpp"

using namespace cleave;

/// The first byte chooses .obj, .ply or .stl, the others are the file: read, triangulated and closed.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto bytes = fuzz::view(data + 1, size - 1);
  return fuzz::expect_input_error([&] {
    const char* names[] = {"mesh.obj", "mesh.ply", "mesh.stl"};
    decltype(&scene::parse_obj) parsers[] = {scene::parse_obj, scene::parse_ply, scene::parse_stl};
    const int format = data[0] % 3;
    auto polygons = parsers[format](names[format], bytes);
    if (polygons.polygon_ends.empty()) return;
    scene::close_mesh(scene::triangulate(std::move(polygons)), names[format]);
  });
}
