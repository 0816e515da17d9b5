#include "bench/gnuplot.hpp"

#include "common/error.hpp"

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <system_error>

namespace cleave::bench {
namespace {

bool is_executable(const std::filesystem::path& file) {
  std::error_code error;
  return std::filesystem::is_regular_file(file, error) && access(file.c_str(), X_OK) == 0;
}

/// A file that goes with its owner.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& text) {
    path_ = (std::filesystem::temp_directory_path() / "cleave-chart-XXXXXX").string();
    const int descriptor = mkstemp(path_.data());
    if (descriptor < 0) throw InputError("cannot write " + path_);
    close(descriptor);
    if (!(std::ofstream(path_, std::ios::binary) << text)) throw InputError("cannot write " + path_);
  }
  ~TemporaryFile() { std::remove(path_.c_str()); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace

bool gnuplot_is_installed() {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (is_executable(std::filesystem::path(folder) / "gnuplot")) return true;
  return false;
}

std::string gnuplot_text(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '"' || c == '\\' || c == '`') escaped += '\\';
    escaped += c;
  }
  return '"' + escaped + '"';
}

namespace {

std::string output_of(const std::string& script_text) {
  const TemporaryFile script(script_text);
  std::FILE* gnuplot = popen(("gnuplot '" + script.path() + "'").c_str(), "r");
  if (!gnuplot) throw InputError("gnuplot cannot be started");
  std::string drawn;
  char buffer[4096];
  for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, gnuplot)) > 0;) drawn.append(buffer, n);
  if (pclose(gnuplot) != 0) throw InputError("gnuplot could not draw the chart");
  return drawn;
}

}  // namespace

std::string draw_svg(const std::string& script) {
  const std::string svg = output_of(script);
  if (svg.find("</svg>") == std::string::npos) throw InputError("gnuplot could not draw the chart");
  return svg;
}

std::string draw_png(const std::string& script) {
  const std::string png = output_of(script);
  if (!png.starts_with("\x89PNG")) throw InputError("gnuplot could not draw the chart");
  return png;
}

}  // namespace cleave::bench
