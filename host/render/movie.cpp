#include "render/movie.hpp"

#include "common/error.hpp"

#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

namespace cleave::render {

bool ffmpeg_is_installed() {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (access((std::filesystem::path(folder) / "ffmpeg").c_str(), X_OK) == 0) return true;
  return false;
}

void make_movie(const std::filesystem::path& pictures, const std::filesystem::path& movie, double frame_rate) {
  if (!ffmpeg_is_installed())
    throw InputError("error: a film needs the program ffmpeg, which is not in PATH (Debian: apt-get install ffmpeg)");
  std::filesystem::path partial = movie;
  partial.replace_filename(movie.stem().string() + ".partial" + movie.extension().string());
  std::vector<std::string> command = {"ffmpeg",
                                      "-nostdin",
                                      "-loglevel",
                                      "error",
                                      "-y",
                                      "-framerate",
                                      fmt::format("{}", frame_rate),
                                      "-pattern_type",
                                      "glob",
                                      "-i",
                                      (pictures / "frame_*.png").string()};
  const std::vector<std::string> encoding =
      movie.extension() == ".gif"
          ? std::vector<std::string>{"-vf", "split[a][b];[a]palettegen[p];[b][p]paletteuse=dither=bayer:bayer_scale=4"}
          : std::vector<std::string>{"-vf",    "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-crf", "18", "-pix_fmt",
                                     "yuv420p"};
  command.insert(command.end(), encoding.begin(), encoding.end());
  command.push_back(partial.string());
  std::vector<char*> arguments;
  for (std::string& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  pid_t child = 0;
  int status = 0;
  if (posix_spawnp(&child, "ffmpeg", nullptr, nullptr, arguments.data(), environ) != 0 || waitpid(child, &status, 0) != child ||
      !WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    throw InputError("error: ffmpeg could not make " + movie.string() + "; the pictures are in " + pictures.string());
  }
  std::filesystem::rename(partial, movie);
}

}  // namespace cleave::render
