#pragma once

#include "study/run_results.hpp"
#include "study/study.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace cleave::study {

/// A vector for each sample; samples are frames, particles or bins.
using Samples = std::vector<std::vector<double>>;

/// Of the lengths of the vectors: root of the mean square, largest, or the last one.
double norm_of(const Samples&, Norm);
/// |actual - expected|, divided by `scale` or by |expected| if the measure is relative. Throws InputError where the numbers of
/// samples differ, or where what is expected is 0 and no scale is given.
double error_between(const Samples& actual, const Samples& expected, Norm, bool relative, std::optional<double> scale);

/// `values` over ascending `at`, linearly between them, at `wanted`. Throws InputError where `wanted` lies outside.
Samples interpolated(std::span<const double> at, const Samples& values, std::span<const double> wanted);

/// What a study compares, of one run. `reference` is the directory of the reference's results where the measure has one.
/// `constants` are values of Study::names().
double measure_error(const Study&, const std::vector<double>& constants, const std::filesystem::path& run,
                     const std::optional<std::filesystem::path>& reference);

}  // namespace cleave::study
