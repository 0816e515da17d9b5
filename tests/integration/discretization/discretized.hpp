#pragma once

// Scenes with discretized bodies, run with `cleave run`.

#include "program.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace cleave::test {

inline constexpr const char* dust = "discretization = { plugin = \"failing\", largest_step = 0.002 }";

/// A cube of edge 0.4 m, 8 points to a cell: 64 points.
inline std::string block(const std::string& name, const std::string& material, const std::string& more = "") {
  return "[[body]]\nname = \"" + name + "\"\nmaterial = \"" + material + "\"\nsampling = \"regular\"\n" +
         "shape = { type = \"box\", center = [0, 1, 0], size = [0.4, 0.4, 0.4] }\n" + more;
}

inline std::string material(const std::string& name, const std::string& law) {
  return "[[material]]\nname = \"" + name + "\"\ndensity = 1000\n" + law + "\n";
}

inline const std::string rubber = "elasticity = { plugin = \"split-neo-hookean\", youngs_modulus = 1e5, poissons_ratio = 0.3 }";

inline std::string scene(const std::string& rest, const std::string& simulation = "") {
  return "[simulation]\ncell_size = 0.2\nend_time = 0.2\nframe_rate = 10\ngravity = [0, -10, 0]\n" + simulation + rest +
         "[output]\nformats = [\"ply\"]\n";
}

/// Columns of a binary PLY file by name.
inline std::map<std::string, std::vector<double>> ply(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<std::pair<std::string, std::string>> properties;
  std::size_t count = 0;
  for (std::string line; std::getline(in, line) && line != "end_header";) {
    std::istringstream words(line);
    std::string first, second, third;
    words >> first >> second >> third;
    if (first == "element") count = std::stoul(third);
    if (first == "property") properties.emplace_back(third, second);
  }
  std::map<std::string, std::vector<double>> columns;
  const auto read = [&](auto number) {
    in.read(reinterpret_cast<char*>(&number), sizeof number);
    return double(number);
  };
  for (std::size_t i = 0; i < count; i++)
    for (const auto& [name, type] : properties) columns[name].push_back(type == "int" ? read(std::int32_t()) : read(float()));
  EXPECT_TRUE(in) << file;
  return columns;
}

class Discretization : public Program {
 protected:
  Outcome with_plugins(const std::string& arguments) const {
    return cleave(arguments, "CLEAVE_PLUGIN_PATH='" CLEAVE_DISCRETIZATIONS "'");
  }
  /// Runs a scene and gives its frames.csv.
  std::map<std::string, std::vector<std::string>> run(const std::string& text, const std::string& out = "run",
                                                      const std::string& options = "") const {
    write("scene.toml", text);
    const Outcome outcome = with_plugins("run scene.toml --quiet --out " + out + " " + options);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return table(directory / out / "frames.csv");
  }
  std::string frame(const std::string& out, int index) const {
    return (directory / out / fmt::format("ply/frame_{:04}.ply", index)).string();
  }
  static double last(const std::map<std::string, std::vector<std::string>>& frames, const std::string& column) {
    return numbers(frames.at(column)).back();
  }
};

}  // namespace cleave::test
