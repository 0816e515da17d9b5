#pragma once

#include "output/frame.hpp"

#include <cstdint>
#include <filesystem>
#include <vector>

namespace cleave::render {

using output::Color;

/// Rows from the top.
struct Image {
  int width = 0, height = 0;
  std::vector<Color> pixels;

  Image() = default;
  Image(int w, int h, Color c = {255, 255, 255}) : width(w), height(h), pixels(std::size_t(w) * std::size_t(h), c) {}
  Color& at(int x, int y) { return pixels[std::size_t(y) * std::size_t(width) + std::size_t(x)]; }
  const Color& at(int x, int y) const { return pixels[std::size_t(y) * std::size_t(width) + std::size_t(x)]; }
};

/// Light per area, of the red, green and blue of sRGB, and back.
Eigen::Vector3f to_linear(Color);
Color from_linear(const Eigen::Vector3f&);

/// The whole file or none. Throws InputError naming it.
void write_png(const std::filesystem::path&, const Image&);
Image read_png(const std::filesystem::path&);

/// Each pixel the mean of those it covers.
Image shrunk(const Image&, int width, int height);

/// Pictures of one size side by side, row by row, each shrunk to this width.
Image contact_sheet(const std::vector<Image>&, int width);

}  // namespace cleave::render
