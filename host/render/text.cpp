#include "render/text.hpp"

#include <stdexcept>

#define STB_TRUETYPE_IMPLEMENTATION
#define STBTT_STATIC
#include <stb/stb_truetype.h>

// The font file is part of the program: DejaVu Sans, which may be embedded in software.
asm(".section .rodata\n"
    "cleave_font_begin: .incbin \"" CLEAVE_FONT
    "\"\n"
    ".byte 0\n"
    ".previous\n");
extern "C" {
extern const unsigned char cleave_font_begin[] __attribute__((visibility("hidden")));
}

namespace cleave::render {
namespace {

const stbtt_fontinfo& font() {
  static const stbtt_fontinfo info = [] {
    stbtt_fontinfo result{};
    if (!stbtt_InitFont(&result, cleave_font_begin, 0)) throw std::logic_error("the font cannot be read");
    return result;
  }();
  return info;
}

/// The next character, and the text without it.
int next(const char*& text) {
  const auto first = static_cast<unsigned char>(*text++);
  const int more = first >= 0xf0 ? 3 : first >= 0xe0 ? 2 : first >= 0xc0 ? 1 : 0;
  int code = more == 3 ? first & 7 : more == 2 ? first & 15 : more == 1 ? first & 31 : first;
  for (int n = 0; n < more && (*text & 0xc0) == 0x80; n++) code = code << 6 | (*text++ & 63);
  return code;
}

/// each(character, x of its origin), and the end of the line.
template <class Each>
float walk(const std::string& text, float scale, const Each& each) {
  float x = 0;
  for (const char* c = text.c_str(); *c != '\0';) {
    const int code = next(c);
    each(code, x);
    int advance = 0, bearing = 0;
    stbtt_GetCodepointHMetrics(&font(), code, &advance, &bearing);
    x += scale * float(advance);
    const char* after = c;
    if (*c != '\0') x += scale * float(stbtt_GetCodepointKernAdvance(&font(), code, next(after)));
  }
  return x;
}

}  // namespace

int text_width(const std::string& text, int size) {
  return int(walk(text, stbtt_ScaleForPixelHeight(&font(), float(size)), [](int, float) {}) + 0.5f);
}

void draw_text(Image& image, const std::string& text, int left, int base, int size, Color color) {
  const float scale = stbtt_ScaleForPixelHeight(&font(), float(size));
  const Eigen::Vector3f ink = to_linear(color);
  walk(text, scale, [&](int code, float x) {
    int width = 0, height = 0, dx = 0, dy = 0;
    const float whole = std::floor(x);
    unsigned char* const cover =
        stbtt_GetCodepointBitmapSubpixel(&font(), scale, scale, x - whole, 0, code, &width, &height, &dx, &dy);
    for (int v = 0; v < height; v++)
      for (int u = 0; u < width; u++) {
        const int px = left + int(whole) + dx + u, py = base + dy + v;
        if (px < 0 || py < 0 || px >= image.width || py >= image.height) continue;
        const float part = float(cover[v * width + u]) / 255;
        image.at(px, py) = from_linear((1 - part) * to_linear(image.at(px, py)) + part * ink);
      }
    stbtt_FreeBitmap(cover, nullptr);
  });
}

}  // namespace cleave::render
