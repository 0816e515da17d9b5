#pragma once

#include "output/frame.hpp"
#include "output/vtp.hpp"

#include <filesystem>
#include <map>

namespace cleave::output {

/// A frame as a USD layer (ASCII): under /cleave UsdGeomPoints per body, and a UsdGeomMesh where the body has a surface. All
/// values are time samples at the frame's time code, so that the layer is complete by itself and a value clip of the series.
void write_usd(const std::filesystem::path&, const ParticleFrame&);

/// The stage of a time series: prims as in the first frame, values from the layer of each frame, brought in as value clips.
void write_usd_series(const std::filesystem::path&, const std::map<int, SeriesEntry>&, const Playback&);

}  // namespace cleave::output
