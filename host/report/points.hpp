#pragma once

#include "report/page.hpp"

#include <nlohmann/json_fwd.hpp>

#include <cstddef>
#include <span>
#include <string>

namespace cleave::report {

std::string base64(std::span<const std::byte>);

/// The frames of a run for the view of points, or null if it has none that can be read:
///
///   total, shown      particles of the bodies and those that are in the view: those whose ids come first when scattered
///   low, high         corners of the box that places are fractions of, in m; particles beyond it lie in its sides
///   radius            of the median particle, m
///   bodies            names
///   attributes        name, unit, least, most; "numbered": true for numbers of bodies and pieces
///   frames            index, time, data
///
/// `data` is base64 of little-endian numbers: for each coordinate a uint16 per particle, of 65535 parts of the box; then for
/// each attribute a uint8 per particle, of 255 parts from least to most, or the number modulo 255, and 255 for none.
nlohmann::json points_of(const std::filesystem::path& run, const Limits&);

}  // namespace cleave::report
