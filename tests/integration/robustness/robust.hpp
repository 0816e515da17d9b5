#pragma once

#include "../../sanitized.hpp"
#include "program.hpp"

namespace cleave::test {

/// A scene of one small block, which other tests break.
inline const std::string sound_scene = R"(
[simulation]
dimension = 3
cell_size = 0.1
end_time = 0.02
frame_rate = 100
[[material]]
name = "rubber"
density = 1000
elasticity = { plugin = "split-neo-hookean", youngs_modulus = 1e5, poissons_ratio = 0.3 }
[[body]]
name = "block"
material = "rubber"
shape = { type = "box", center = [0, 0.5, 0], size = [0.3, 0.3, 0.3] }
[output]
formats = ["ply"]
)";

class Robust : public Program {
 protected:
  static constexpr bool memory_can_be_limited = !sanitized;
  /// What comes before a command that is to get no more address space than this.
  static std::string with_kilobytes(long limit) {
    return memory_can_be_limited ? "ulimit -v " + std::to_string(limit) + ";" : "";
  }
  /// The scene with its first `before` made `after`.
  std::string changed(const std::string& before, const std::string& after) const {
    std::string scene = sound_scene;
    const auto at = scene.find(before);
    EXPECT_NE(at, std::string::npos) << before;
    return scene.replace(at, before.size(), after);
  }
  std::string with_shape(const std::string& shape) const {
    return changed("{ type = \"box\", center = [0, 0.5, 0], size = [0.3, 0.3, 0.3] }", shape);
  }
  std::string with_particles(const std::string& file) const {
    return changed("shape = { type = \"box\", center = [0, 0.5, 0], size = [0.3, 0.3, 0.3] }", "particles = \"" + file + "\"");
  }
  /// A run of this scene ends with this status and says this on stderr.
  void expect(const std::string& scene, int status, const std::string& message, const std::string& before = "") {
    write("scene.toml", scene);
    expect_command("run scene.toml --quiet --out run", status, message, before);
  }
  void expect_command(const std::string& arguments, int status, const std::string& message, const std::string& before = "") {
    const Outcome run = cleave(arguments, before);
    EXPECT_EQ(run.status, status) << arguments << '\n' << run.err;
    EXPECT_NE(run.err.find(message), std::string::npos) << "expected: " << message << "\nfound: " << run.err.substr(0, 2000);
  }
};

}  // namespace cleave::test
