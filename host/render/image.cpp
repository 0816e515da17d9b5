#include "render/image.hpp"

#include "common/error.hpp"
#include "output/atomic_file.hpp"

#include <png.h>

#include <algorithm>
#include <cmath>

namespace cleave::render {
namespace {

float linear(std::uint8_t value) {
  const float x = float(value) / 255;
  return x <= 0.04045f ? x / 12.92f : std::pow((x + 0.055f) / 1.055f, 2.4f);
}

std::uint8_t encoded(float x) {
  x = std::isnan(x) ? 0 : std::clamp(x, 0.f, 1.f);
  return std::uint8_t(std::lround(255 * (x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f)));
}

}  // namespace

Eigen::Vector3f to_linear(Color c) { return {linear(c[0]), linear(c[1]), linear(c[2])}; }
Color from_linear(const Eigen::Vector3f& x) { return {encoded(x[0]), encoded(x[1]), encoded(x[2])}; }

void write_png(const std::filesystem::path& path, const Image& image) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = png_uint_32(image.width);
  png.height = png_uint_32(image.height);
  png.format = PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::vector<char> bytes(size);
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, image.pixels.data(), 0, nullptr))
    throw InputError("cannot write " + path.string() + ": " + png.message);
  output::AtomicFile file(path);
  file.stream().write(bytes.data(), std::streamsize(size));
  file.commit();
}

Image read_png(const std::filesystem::path& path) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_file(&png, path.c_str()))
    throw InputError("cannot read " + path.string() + ": " + png.message);
  png.format = PNG_FORMAT_RGB;
  Image image(int(png.width), int(png.height));
  if (!png_image_finish_read(&png, nullptr, image.pixels.data(), 0, nullptr))
    throw InputError("cannot read " + path.string() + ": " + png.message);
  return image;
}

Image shrunk(const Image& image, int width, int height) {
  Image small(width, height);
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      const auto range = [](int i, int count, int of) {
        const int begin = int(std::int64_t(i) * of / count);
        return std::pair(begin, std::max(begin + 1, int(std::int64_t(i + 1) * of / count)));
      };
      const auto [x0, x1] = range(x, width, image.width);
      const auto [y0, y1] = range(y, height, image.height);
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      for (int v = y0; v < y1; v++)
        for (int u = x0; u < x1; u++) sum += to_linear(image.at(u, v));
      small.at(x, y) = from_linear(sum / float((x1 - x0) * (y1 - y0)));
    }
  return small;
}

Image contact_sheet(const std::vector<Image>& pictures, int width) {
  if (pictures.empty()) return {};
  const int count = int(pictures.size()), columns = int(std::ceil(std::sqrt(double(count)))),
            rows = (count + columns - 1) / columns, gap = 2,
            height = std::max(1, int(std::lround(double(width) * pictures[0].height / pictures[0].width)));
  Image sheet(columns * (width + gap) - gap, rows * (height + gap) - gap);
  for (int n = 0; n < count; n++) {
    const Image small = shrunk(pictures[std::size_t(n)], width, height);
    const int left = n % columns * (width + gap), top = n / columns * (height + gap);
    for (int y = 0; y < height; y++) std::copy_n(&small.at(0, y), width, &sheet.at(left, top + y));
  }
  return sheet;
}

}  // namespace cleave::render
