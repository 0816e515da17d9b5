#pragma once

#include "study/plan.hpp"

#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace cleave::test {

/// A directory with a small scene and a study of it.
class StudyFiles {
 public:
  /// A scene that still lacks what fills its body.
  inline static const std::string block_of_nothing = R"(
[simulation]
dimension = 2
cell_size = 0.1
end_time = 0.1
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "rubber"
)";

  StudyFiles() {
    std::string name = (std::filesystem::temp_directory_path() / "cleave-study-XXXXXX").string();
    directory = mkdtemp(name.data());
    write("scene.toml", block_of_nothing + "shape = { type = \"box\", size = [0.4, 0.4] }\n");
  }
  ~StudyFiles() { std::filesystem::remove_all(directory); }
  StudyFiles(const StudyFiles&) = delete;
  StudyFiles& operator=(const StudyFiles&) = delete;

  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(directory / name) << text;
    return directory / name;
  }

  /// A study of this text; "scene" is that above.
  study::Study study(const std::string& text, const std::vector<std::string>& added = {}) const {
    return study::load_study(write("study.toml", "scene = \"scene.toml\"\n" + text), added, *config::catalog_of(registry));
  }

  std::filesystem::path directory;
  plugins::Registry registry{{CLEAVE_PLUGINS}};
};

inline const std::string error_table = "[error]\nvalue = \"momentum_x / mass\"\nformula = \"0\"\nrelative = false\n";

}  // namespace cleave::test
