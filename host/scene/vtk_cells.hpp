#pragma once

#include "scene/tetrahedra_formats.hpp"

#include <functional>
#include <vector>

namespace cleave::scene {

/// Cells of an unstructured grid of VTK: the corners of cell i are those from offsets[i] to offsets[i + 1]. Numbers as a file
/// gives them, checked by nobody.
struct VtkCells {
  std::vector<double> offsets, corners, types;
};

/// Takes the tetrahedra among them; points, lines and faces are left out with a note. `fail` throws: cells of other volumes,
/// corners that `result` has no vertex for, arrays that do not go together.
void take_tetrahedra(const VtkCells&, TetrahedraFile& result, const std::function<void(const std::string&)>& fail);

}  // namespace cleave::scene
