#include "fuzzing.hpp"
#include "scene/tetrahedra_formats.hpp"

#include <algorithm>

using namespace cleave;

/// The first byte chooses TetGen (.node, a NUL, .ele), Medit, legacy VTK or VTK's XML, the others are the file: read, made
/// valid and measured.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto bytes = fuzz::view(data + 1, size - 1);
  return fuzz::expect_input_error([&] {
    scene::TetrahedraFile file;
    if (data[0] % 4 == 0) {
      const auto end = std::min(bytes.find('\0'), bytes.size());
      file = scene::parse_tetgen("mesh.node", bytes.substr(0, end), "mesh.ele", bytes.substr(std::min(end + 1, bytes.size())));
    } else {
      file = data[0] % 4 == 1   ? scene::parse_medit("mesh.mesh", bytes)
             : data[0] % 4 == 2 ? scene::parse_vtk("mesh.vtk", bytes)
                                : scene::parse_vtu("mesh.vtu", bytes);
    }
    if (file.mesh.tetrahedra.empty()) return;
    scene::make_valid(file.mesh, "mesh", file.first_number);
    scene::surface_of(file.mesh);
    scene::measure(file.mesh);
  });
}
