#pragma once

#include "output/frame.hpp"
#include "output/names.hpp"

#include <array>
#include <bit>
#include <ostream>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

/// What VTK's XML formats share: arrays as inline base64, little endian, each with a 64-bit header.
namespace cleave::output::vtk {

static_assert(std::endian::native == std::endian::little,
              "frames are written in the machine's byte order, which must be little endian");

inline std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return result;
}

class Base64 {
 public:
  explicit Base64(std::ostream& out) : out_(out) {}

  void write(std::span<const std::byte> bytes) {
    for (const std::byte byte : bytes) {
      triple_[filled_++] = std::to_integer<unsigned>(byte);
      if (filled_ == 3) encode();
    }
  }

  void finish() {
    if (filled_ > 0) {
      const std::size_t padding = 3 - filled_;
      for (std::size_t i = filled_; i < 3; ++i) triple_[i] = 0;
      encode();
      std::fill_n(text_.begin() + static_cast<std::ptrdiff_t>(used_ - padding), padding, '=');
    }
    flush();
  }

 private:
  void encode() {
    static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const unsigned bits = triple_[0] << 16 | triple_[1] << 8 | triple_[2];
    if (used_ == text_.size()) flush();
    for (const int shift : {18, 12, 6, 0}) text_[used_++] = digits[bits >> shift & 63];
    filled_ = 0;
  }

  void flush() {
    out_.write(text_.data(), static_cast<std::streamsize>(used_));
    used_ = 0;
  }

  std::ostream& out_;
  std::array<unsigned, 3> triple_{};
  std::array<char, 4 * 4096> text_{};
  std::size_t filled_ = 0, used_ = 0;
};

template <class T>
constexpr const char* type_name() {
  if constexpr (std::is_same_v<T, float>) return "Float32";
  if constexpr (std::is_same_v<T, double>) return "Float64";
  if constexpr (std::is_same_v<T, std::int32_t>) return "Int32";
  if constexpr (std::is_same_v<T, std::int64_t>) return "Int64";
  if constexpr (std::is_same_v<T, std::uint8_t>) return "UInt8";
}

/// `tuple(i, values)` fills the components of tuple i.
template <class T, class Tuple>
void write_array(std::ostream& out, const std::string& name, const std::vector<std::string>& components, std::size_t tuples,
                 const Tuple& tuple, const std::string& extra = "") {
  const std::size_t width = components.size();
  out << "<DataArray type=\"" << type_name<T>() << "\" Name=\"" << escaped(name) << "\"";
  if (width > 1) out << " NumberOfComponents=\"" << width << "\"";
  for (std::size_t c = 0; width > 1 && c < width; ++c) out << " ComponentName" << c << "=\"" << components[c] << "\"";
  out << extra << " format=\"binary\">\n";
  Base64 base64(out);
  const std::uint64_t bytes = tuples * width * sizeof(T);
  base64.write(std::as_bytes(std::span(&bytes, 1)));
  std::vector<T> values(width);
  for (std::size_t i = 0; i < tuples; ++i) {
    tuple(i, values.data());
    base64.write(std::as_bytes(std::span<const T>(values)));
  }
  base64.finish();
  out << "\n</DataArray>\n";
}

/// VTK's strings are arrays of character codes, each string ended by a zero.
inline void write_body_names(std::ostream& out, const std::vector<std::string>& bodies) {
  out << "<DataArray type=\"String\" Name=\"bodies\" NumberOfTuples=\"" << bodies.size() << "\" format=\"ascii\">\n";
  for (const std::string& body : bodies) {
    for (const char c : body) out << static_cast<int>(static_cast<unsigned char>(c)) << ' ';
    out << "0\n";
  }
  out << "</DataArray>\n";
}

/// Opening of a file of one data set and its FieldData.
inline void write_start(std::ostream& out, const char* type, const ParticleFrame& frame) {
  const std::vector<std::string> scalar{""};
  const std::string one_tuple = " NumberOfTuples=\"1\"";
  out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"" << type
      << "\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<" << type << ">\n<FieldData>\n";
  write_array<double>(
      out, "TimeValue", scalar, 1, [&](std::size_t, double* value) { *value = frame.time; }, one_tuple);
  write_array<std::int32_t>(
      out, "frame", scalar, 1, [&](std::size_t, std::int32_t* value) { *value = frame.index; }, one_tuple);
  write_array<double>(
      out, "cell_size", scalar, 1, [&](std::size_t, double* value) { *value = frame.cell_size; }, one_tuple);
  write_body_names(out, frame.bodies);
  out << "</FieldData>\n";
}

inline void write_end(std::ostream& out, const char* type) { out << "</Piece>\n</" << type << ">\n</VTKFile>\n"; }

}  // namespace cleave::output::vtk
