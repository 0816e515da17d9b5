#pragma once

#include <filesystem>

namespace cleave::render {

/// Makes the pictures frame_*.png of a directory, in the order of their names, into a film, or a GIF with a palette of its own,
/// by the name's ending. Throws InputError where the program ffmpeg is missing or fails.
void make_movie(const std::filesystem::path& pictures, const std::filesystem::path& movie, double frame_rate);

bool ffmpeg_is_installed();

}  // namespace cleave::render
