#pragma once

#include <filesystem>
#include <string>

namespace cleave::report {

struct Limits {
  int points = 200000;    ///< of the view, the most
  int frames = 60;        ///< of the view, the most: first, last and others evenly between
  double megabytes = 24;  ///< of the view's data: points are fewer where there would be more
  double pictures = 16;   ///< megabytes of pictures
};

/// What is known of a run from the files in its directory, as one HTML page that needs no other file and no network: of a run
/// that is done, failed, interrupted or still going on. Throws InputError if the directory is not one that `cleave run` has
/// written.
std::string page(const std::filesystem::path& run, const Limits&);

}  // namespace cleave::report
