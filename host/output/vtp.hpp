#pragma once

#include "output/frame.hpp"

#include <filesystem>
#include <map>

namespace cleave::output {

/// VTK XML PolyData with one vertex cell per particle, so that viewers show the points at once and cell filters select single
/// particles. Arrays are inline base64, which keeps the file valid XML; little endian, 64-bit headers.
/// Symmetric tensors are reordered to VTK's xx yy zz xy yz xz.
void write_vtp(const std::filesystem::path&, const ParticleFrame&);

/// ParaView's index of a time series: the file of each frame, relative to the index, at its time.
struct SeriesEntry {
  double time = 0;
  std::string file;
};
void write_pvd(const std::filesystem::path&, const std::map<int, SeriesEntry>&);

}  // namespace cleave::output
